"""Flights of formations that change their shape, small enough to be planned in a second or two."""

from __future__ import annotations

from typing import Any

from gcs.scenario.model import Scenario
from tests.unit.plan.problems import meadow

# 500 mm frames: strong enough to change their shape while they fly 40 m.
STRONG = {
    "mass_kg": 2.0,
    "arm_m": 0.25,
    "inertia_kgm2": [0.0217, 0.0217, 0.040],
    "thrust_coeff_Ns2": 8.55e-6,
    "moment_coeff_Nms2": 1.37e-7,
    "drag_Nspm": [0.3, 0.3, 0.3],
    "drag_moment_Nms": [0.02, 0.02, 0.02],
    "rotor_max_radps": 1070.0,
}
ROOMY = {
    "north_m": [-50.0, 250.0],
    "east_m": [-100.0, 100.0],
    "height_m": [0.0, 30.0],
    "speed_ned_mps": [4.0, 4.0, 1.5],
    "roll_pitch_yaw_deg": [25.0, 25.0, 180.0],
    "rates_degps": [45.0, 45.0, 30.0],
    "thrust_N": [4.0, 38.0],
    "torque": [0.4, 0.4, 0.08],
    "clearance_min_m": 1.0,
    "load_factor_max": 0.2,
    "accel_max_mps2": 1.5,
    "separation_min_m": 1.0,
}
SHAPES = (
    {"name": "row", "generator": "line", "spacing_m": 3.0},
    {"name": "file", "generator": "column", "spacing_m": 3.0},
    {"name": "wedge", "generator": "vee", "spacing_m": 3.0},
)


def fleet(
    scenario: Scenario,
    count: int = 3,
    begin: str = "wedge",
    changes: tuple[dict[str, Any], ...] = (),
    shapes: tuple[dict[str, Any], ...] = SHAPES,
    **tables: Any,
) -> Scenario:
    """The meadow in 30 s for `count` strong vehicles that begin in one of the shapes and change it."""
    formation = {"vehicle": (), "count": count, "start_shape": begin, "shape": shapes, "change": changes}
    return meadow(
        scenario,
        formation=formation | tables.pop("formation", {}),
        limits=ROOMY | tables.pop("limits", {}),
        vehicle=STRONG,
        **({"time": {"flight_s": 30.0}} | tables),
    )


def at(change: dict[str, Any], at_s: float) -> dict[str, Any]:
    """The change at a time."""
    return {**change, "at_s": at_s}


def auto(change: dict[str, Any], **more: Any) -> dict[str, Any]:
    """The change whenever the planner finds it worth its while."""
    return {**change, "auto": True, **more}


def gap(scenario: Scenario, half_m: float, changes: tuple[dict[str, Any], ...], **tables: Any) -> Scenario:
    """A row of five, 12 m wide, on its way north through a gap between two disks that fill the box otherwise."""
    disks = [{"north_m": 40.0, "east_m": east, "radius_m": 40.0 - half_m} for east in (-40.0, 40.0)]
    far: dict[str, Any] = {
        "time": {"flight_s": 45.0},
        "start": {"position_m": [0.0, 0.0, 3.0]},
        "end": {"position_m": [80.0, 0.0, 3.0]},
        "no_fly": disks,
        "limits": {"east_m": [-30.0, 30.0], "north_m": [-30.0, 110.0]} | tables.pop("limits", {}),
    }
    return fleet(scenario, 5, "row", changes, **far | tables)


TURN = {"kind": "rotate", "angle_deg": 90.0}
SHRINK = {"kind": "shrink", "scale": 0.5}
TO_ROW = {"kind": "reshape", "to": "row"}
TO_FILE = {"kind": "reshape", "to": "file"}
