"""Changes that do not fit into the flight are answered before anything is optimised, and every proposed value helps."""

from __future__ import annotations

import re
from typing import Any

import pytest

from gcs.errors import Infeasible
from gcs.plan.formation.schedule_fit import ScheduleMisfit, check_schedule
from gcs.plan.ocp.problem import flight_problem
from gcs.plan.search.infeasibility import check_time
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.formations import COURSE, GATE, SHRINK, TO_FILE, TURN, at, fleet

KEY = re.compile(r"([a-z_0-9.\[\]]+) to (-?[\d.]+)")


def refusal(scenario: Scenario) -> Infeasible:
    with pytest.raises(Infeasible) as caught:
        check_time(flight_problem(scenario))
    return caught.value


def every_proposal(error: Infeasible) -> list[dict[str, float]]:
    """The keys and values of each alternative in the hint."""
    return [
        {key: float(value) for key, value in KEY.findall(part)}
        for part in error.hint.removeprefix("set ").split(", or ")
    ]


def changed(scenario: Scenario, values: dict[str, float]) -> Scenario:
    """The scenario with other values, by the keys that a message names."""
    data: dict[str, Any] = scenario.model_dump(mode="json")
    for key, value in values.items():
        place: Any = data
        *tables, last = [part for part in re.split(r"[.\[\]]+", key) if part]
        for part in tables:
            place = place[int(part)] if part.isdigit() else place[part]
        place[int(last) if last.isdigit() else last] = value
    return Scenario.model_validate(data)


CASES: dict[str, tuple[tuple[dict[str, Any], ...], dict[str, Any], set[str]]] = {
    "too late": (
        (at(TO_FILE, 22.0),),
        {},
        {"formation.change[0].at_s", "time.flight_s", "formation.shape[0].spacing_m"},
    ),
    "turning with the course": (
        (at(TO_FILE, 5.0),),
        COURSE | {"change_speed_mps": 0.25},
        {"time.flight_s", "formation.change_speed_mps"},
    ),
    "complete too soon": (({**TO_FILE, "done_at_s": 3.0},), {}, {"formation.change[0].done_at_s"}),
    "complete before there is room": (
        (at(TURN, 2.0), {**SHRINK, "done_at_s": 14.0}),
        {},
        {"formation.change[1].done_at_s"},
    ),
    "two that overlap": ((at(TURN, 2.0), at(SHRINK, 6.0)), {}, {"formation.change[1].at_s"}),
    "a gate": (({**TURN, "gate_m": GATE}, at(SHRINK, 20.0)), {"change_speed_mps": 0.3}, {"formation.change_speed_mps"}),
}


@pytest.mark.parametrize("case", CASES)
def test_changes_that_do_not_fit_name_every_key_that_helps(simulation1: Scenario, case: str) -> None:
    changes, formation, keys = CASES[case]
    scenario = fleet(simulation1, changes=changes, formation=formation)
    error = refusal(scenario)
    assert isinstance(error, ScheduleMisfit)
    assert error.message.startswith("no plan: the change ")
    proposals = every_proposal(error)
    assert keys <= {key for proposal in proposals for key in proposal}
    for proposal in proposals:
        mended = changed(scenario, proposal)
        check_schedule(mended, mended.time.flight_s)


def test_a_change_that_fits_is_not_refused(simulation1: Scenario) -> None:
    check_time(flight_problem(fleet(simulation1, changes=(at(TURN, 2.0),))))
    check_time(flight_problem(fleet(simulation1, changes=({**TURN, "gate_m": GATE},))))


def test_a_formation_that_cannot_turn_to_its_course_in_time_is_told_what_helps(simulation1: Scenario) -> None:
    away: dict[str, Any] = {"start": {"roll_pitch_yaw_deg": [0.0, 0.0, -160.0], "velocity_mps": [0.0, 0.0, 0.0]}}
    scenario = fleet(simulation1, formation=COURSE | {"change_speed_mps": 0.1}, **away)
    error = refusal(scenario)
    assert "the formation faces -160 degrees at the start" in error.message
    proposals = every_proposal(error)
    assert {"start.roll_pitch_yaw_deg[2]", "formation.change_speed_mps", "time.flight_s"} <= {
        key for proposal in proposals for key in proposal
    }
    for proposal in proposals:
        check_time(flight_problem(changed(scenario, proposal)))
