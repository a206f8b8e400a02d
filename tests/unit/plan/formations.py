"""Flights of formations that change their shape, small enough to be planned in a second or two."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import Report
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.problems import meadow

# 500 mm frames: strong enough to change their shape while they fly 40 m.
STRONG = {
    "mass_kg": 2.0,
    "power": None,  # the battery of the small one would not carry it
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
    "roll_pitch_force_N": [0.4, 0.4],
    "yaw_moment_Nm": 0.08,
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


def block(scenario: Scenario, changes: tuple[dict[str, Any], ...] = (), **tables: Any) -> Scenario:
    """Sixty vehicles, 28 m wide, over four hills and past a disk."""
    hills = {
        "north_m": [45.0, 70.0, 60.0, 35.0],
        "east_m": [-12.0, 10.0, 30.0, 14.0],
        "height_m": [9.0, 11.0, 14.0, 6.0],
        "spread_north_m": [9.0, 8.0, 12.0, 6.0],
        "spread_east_m": [8.0, 9.0, 12.0, 6.0],
    }
    there: dict[str, Any] = {
        "terrain": {"ripple": None, "mountains": hills},
        "time": {"flight_s": 60.0},
        "start": {"position_m": [0.0, 0.0, 6.0]},
        "end": {"position_m": [110.0, 0.0, 6.0]},
        "limits": {"height_m": [0.0, 14.0]} | tables.pop("limits", {}),
        "no_fly": [{"north_m": 50.0, "east_m": -27.0, "radius_m": 14.0}],
        "ground_phases": {"takeoff_s": 12.0, "landing_s": 12.0, "hover_s": 2.0},
    }
    shapes = ({"name": "block", "generator": "grid", "spacing_m": 4.0},)
    return fleet(scenario, 60, "block", changes, shapes, **there | tables)


TURN = {"kind": "rotate", "angle_deg": 90.0}
SHRINK = {"kind": "shrink", "scale": 0.5}
TO_ROW = {"kind": "reshape", "to": "row"}
TO_FILE = {"kind": "reshape", "to": "file"}

GATE = [[15.0, -20.0], [15.0, 40.0]]
BEYOND = [[25.0, 60.0], [25.0, -20.0]]
# A flight on which speed, acceleration and the shape's own limits all bind.
TIGHT: dict[str, Any] = {
    "limits": {"accel_max_mps2": 0.5, "speed_ned_mps": [2.2, 1.4, 1.5]},
    "formation": {"change_speed_mps": 0.6, "change_accel_mps2": 0.25},
}
SWAPPED = (
    {"name": "a", "offsets_m": [[0, 0, 0], [0, 4, 0], [0, -4, 0]]},
    {"name": "b", "offsets_m": [[0, 0, 0], [0, -4, 0], [0, 4, 0]]},
)
COURSE: dict[str, Any] = {"frame": "course", "change_speed_mps": 2.0, "change_accel_mps2": 0.6}
# Between two mountains under a low ceiling a row of five, 12 m wide, does not pass; nor round them, in this box.
PASS: dict[str, Any] = {
    "no_fly": [],
    "terrain": {
        "ripple": None,
        "mountains": {
            "north_m": [40.0, 40.0],
            "east_m": [-26.0, 26.0],
            "height_m": [60.0, 60.0],
            "spread_north_m": [15.0, 15.0],
            "spread_east_m": [14.0, 14.0],
        },
    },
    "limits": {"height_m": [0.0, 7.0]},
}

FLIGHTS: dict[str, Callable[[Scenario], Scenario]] = {
    "turn": lambda s: fleet(s, changes=(at(TURN, 2.0),)),
    "shrink": lambda s: fleet(s, changes=(at(SHRINK, 0.0),), time={"flight_s": 25.0}),
    "reshape": lambda s: fleet(s, 5, changes=(at(TO_ROW, 2.0),)),
    "reshape and turn": lambda s: fleet(s, 5, changes=(at(TO_ROW, 2.0), at(TURN, 16.0)), time={"flight_s": 45.0}),
    "tight turn": lambda s: fleet(s, changes=(at(TURN, 2.0),), **TIGHT),
    "tight shrink": lambda s: fleet(s, changes=(at({**SHRINK, "scale": 3.0}, 4.0),), **TIGHT),
    "lanes": lambda s: fleet(
        s, 3, "a", (at({"kind": "reshape", "to": "b", "assignment": "fixed"}, 2.0),), SWAPPED, time={"flight_s": 50.0}
    ),
    "gates": lambda s: fleet(
        s, changes=({**TURN, "gate_m": GATE}, {**SHRINK, "gate_m": BEYOND}), time={"flight_s": 50.0}
    ),
    "course": lambda s: fleet(s, 5, formation=COURSE, time={"flight_s": 50.0}, end={"position_m": [50.0, 35.0, 5.0]}),
    "course and schedule": lambda s: fleet(
        s,
        5,
        changes=(at(TO_ROW, 10.0),),
        formation=COURSE,
        time={"flight_s": 40.0},
        end={"position_m": [40.0, 30.0, 5.0]},
    ),
    "auto shrink": lambda s: gap(s, 5.0, (auto(SHRINK),)),
    "auto turn": lambda s: gap(s, 5.0, (auto(TURN),)),
    "auto reshape": lambda s: gap(s, 5.0, (auto(TO_FILE),)),
    "auto shrink in a pass": lambda s: gap(s, 5.0, (auto(SHRINK),), **PASS),
    "scheduled shrink before a gap": lambda s: gap(s, 5.0, (at(SHRINK, 2.0),)),
}

Planned = Callable[[str], tuple[Plan, Report]]
