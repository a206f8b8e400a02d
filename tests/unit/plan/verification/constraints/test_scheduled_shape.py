"""The scheduled shape as the verifier lays it out: against the timeline, which knows nothing of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gcs.plan.formation.timeline import lay
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.constraints.scheduled_shape import Stretch, stretches
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.formations import SHRINK, SWAPPED, TO_ROW, TURN, Planned, at, auto, fleet

TILTED = {"kind": "rotate", "angle_deg": 50.0, "axis": [1.0, 0.5, 2.0]}
LANES = {"kind": "reshape", "to": "b", "assignment": "fixed"}
SCHEDULES: dict[str, tuple[str, tuple[dict[str, Any], ...]]] = {
    "turn": ("wedge", (at(TURN, 2.0),)),
    "tilted turn": ("wedge", (at(TILTED, 2.0),)),
    "shrink, reshape": ("wedge", (at({**SHRINK, "scale": 1.5}, 1.0), at(TO_ROW, 20.0))),
    "lanes": ("a", (at(LANES, 2.0),)),
}


END_S = 90.0


def laid(planned: Planned, scenario: Scenario) -> Plan:
    """The flight of another plan with the schedule of this scenario."""
    starts = tuple(c.at_s for c in scenario.formation.change if c.at_s is not None)
    timeline = lay(scenario, starts, 0.0, END_S)
    return replace(planned("turn")[0], scenario=scenario, shape=timeline.shape, moves=timeline.moves)


@pytest.mark.parametrize("name", SCHEDULES)
def test_it_is_the_shape_of_the_timeline(planned: Planned, simulation1: Scenario, name: str) -> None:
    begin, changes = SCHEDULES[name]
    still = auto({"kind": "shrink", "scale": 0.9})
    shapes = (*SWAPPED, *fleet(simulation1).model_dump()["formation"]["shape"])
    scenario = fleet(simulation1, 3, begin, (*changes, still), shapes, time={"flight_s": END_S})
    plan = laid(planned, scenario)
    parts = stretches(plan)
    assert len(parts) > 2 * len(changes)
    for part in parts:
        low, high = max(part.start_s, 0.0), min(part.end_s, END_S)
        edges = np.linspace(low, high, 12)
        found = part.functions(edges[:-1], edges[1:], 4)
        places = np.einsum("kn,kva->vna", np.stack([f.middle for f in found]), part.tables_ned_m)
        expected = plan.shape.offsets(0.5 * (edges[:-1] + edges[1:]))
        np.testing.assert_allclose(places, expected, atol=1e-9)
        assert np.linalg.norm(places, axis=-1).max() <= part.widest_m + 1e-9


def test_functions_enclose_what_lies_between(simulation1: Scenario) -> None:
    """A quarter turn in 8 s, by the septic step written down here."""
    part = Stretch(2.0, 10.0, "rotate", np.zeros((3, 1, 3)), np.pi / 2.0)
    times = np.linspace(5.0, 5.5, 101)
    s = (times - 2.0) / 8.0
    angle = 0.5 * np.pi * (35.0 * s**4 - 84.0 * s**5 + 70.0 * s**6 - 20.0 * s**7)
    one, cosine, sine = part.functions(np.array([5.0]), np.array([5.5]), 4)
    for found, exact in ((one, np.ones(101)), (cosine, np.cos(angle)), (sine, np.sin(angle))):
        low, high = found.range()
        assert low[0] <= exact.min() <= low[0] + 2e-3
        assert high[0] - 2e-3 <= exact.max() <= high[0]


def test_without_a_schedule_all_is_rigid(planned: Planned) -> None:
    plan = planned("auto shrink")[0]
    (only,) = stretches(plan)
    assert only.law == "rigid"
    assert not np.isfinite([only.start_s, only.end_s]).any()
