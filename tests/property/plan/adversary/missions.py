"""Short flights for the adversary: each has what hides violations: kinks of ground, corners, shear, moving shapes."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.heightmap import Relief, packed
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from tests.unit.plan.formations import SHRINK, TO_FILE, TURN, at, auto, fleet, gap
from tests.unit.plan.problems import meadow

_MISSIONS = Path(__file__).resolve().parents[4] / "missions"
_SLOWLY = {"takeoff_s": 12.0, "hover_s": 2.3, "landing_s": 15.0}
STAIRS = ({"name": "stairs", "offsets_m": [[0, 0, 0], [-3, -3, 2], [-3, 3, 4], [-6, 0, 1]]},)
PIXEL_M = 1.0


def _relief(north_m: tuple[float, float], east_m: tuple[float, float]) -> Relief:
    """Waves of 1.5 m, bilinear between pixels 1 m apart."""
    north, east = (np.arange(low, high + 0.5, PIXEL_M) for low, high in (north_m, east_m))
    heights = 2.0 + 1.5 * np.sin(north[:, None] / 7.0) * np.cos(east[None, :] / 9.0)
    row, column = np.zeros(10), np.zeros(10)
    row[:2], column[[0, 2]] = (-north_m[0], 1.0), (-east_m[0], 1.0)
    return Relief(
        rows=len(north),
        columns=len(east),
        heights=packed(heights),
        centre_m=(0.0, 0.0),
        reach_m=1.0,
        row=tuple(row.tolist()),
        column=tuple(column.tolist()),
        spacing_m=PIXEL_M,
        north_m=(north_m[0] + 1.0, north_m[1] - 1.0),
        east_m=(east_m[0] + 1.0, east_m[1] - 1.0),
    )


def _three(scenario: Scenario, **tables: Any) -> Scenario:
    return meadow(scenario, formation={"vehicle": [v.model_dump() for v in scenario.formation.vehicle[:3]]}, **tables)


def _ripple(scenario: Scenario) -> Scenario:
    """Three over the paper's ripple (Eq. 52)."""
    assert scenario.terrain.ripple is not None
    return _three(
        scenario,
        terrain={"ripple": scenario.terrain.ripple.model_dump()},
        start={"position_m": [2.0, 1.0, 3.0]},
        ground_phases=_SLOWLY,
    )


def _stairs(scenario: Scenario) -> Scenario:
    """Four at four heights, in wind that grows with height, turn between a polygon and a disk that comes near."""
    turn = {"kind": "rotate", "angle_deg": 40.0}
    zones = [
        {"polygon_m": [[18.0, -3.0], [24.0, -3.0], [24.0, 2.0], [18.0, 2.0]]},
        {"north_m": 21.0, "east_m": 60.0, "radius_m": 5.0, "moves": [[7.0, 0.0, 0.0], [13.0, 0.0, -25.0]]},
    ]
    return fleet(
        scenario,
        4,
        "stairs",
        (at(turn, 3.0),),
        STAIRS,
        time={"flight_s": 24.0},
        wind={"speed_mps": 4.0, "from_deg": 250.0, "shear": 0.3},
        no_fly=zones,
        ground_phases=_SLOWLY,
        limits={"clearance_min_m": 0.4},
        formation={"change_speed_mps": 1.5, "change_accel_mps2": 0.6},
    )


def _hills(scenario: Scenario) -> Scenario:
    """Three over an elevation model shrink to half their size."""
    ground = {"ripple": None, "mountains": {}, "relief": _relief((-40.0, 80.0), (-40.0, 40.0)).model_dump()}
    ends: dict[str, Any] = {"start": {"position_m": [0.0, 0.0, 6.0]}, "end": {"position_m": [45.0, 0.0, 6.0]}}
    return fleet(
        scenario,
        3,
        "wedge",
        (at(SHRINK, 2.0),),
        terrain=ground,
        time={"flight_s": 20.0},
        ground_phases=_SLOWLY,
        limits={"north_m": [-20.0, 60.0], "east_m": [-20.0, 20.0], "clearance_min_m": 0.4},
        **ends,
    )


MISSIONS: dict[str, Callable[[Scenario], Scenario]] = {
    "meadow": _three,
    "ripple": _ripple,
    "stairs": _stairs,
    "hills": _hills,
}


def _course(scenario: Scenario) -> Scenario:
    """Three that turn with their course."""
    frame = {"frame": "course", "change_speed_mps": 2.0, "change_accel_mps2": 0.6}
    return fleet(scenario, 3, formation=frame, time={"flight_s": 24.0}, end={"position_m": [40.0, 25.0, 5.0]})


def _automatic(change: dict[str, Any]) -> Callable[[Scenario], Scenario]:
    """A row of five that passes a gap as the planner likes, by one kind of change."""
    return lambda scenario: gap(scenario, 5.0, (auto(change),))


# Their planning takes longer.
LONGER: dict[str, Callable[[Scenario], Scenario]] = {
    "course": _course,
    "breathing": _automatic(SHRINK),
    "swinging": _automatic(TURN),
    "folding": _automatic(TO_FILE),
}


@cache
def mission(name: str) -> Plan:
    """The plan of one of MISSIONS; each is made once in a process."""
    return make_plan((MISSIONS | LONGER)[name](load_scenario(_MISSIONS / "simulation1")))
