"""The texts of constraints, which reports, `--json` and plan files have had since 0.1, and what does not read them."""

from __future__ import annotations

import itertools

import pytest

from gcs.plan.formation.coordinates import CoordinateName
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.constraint_id import CONTROLS, STATES, ConstraintId, Form, Kind, PointName
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.scenario.environment.no_fly import ZoneName

ZONE, AREA, GATE, PLAIN = ZoneName(2), ZoneName(1, keep_in=True), PointName(3, "gate"), PointName(12)
SCALE = CoordinateName.SCALE


@pytest.mark.parametrize(
    ("constraint", "text"),
    [
        (ConstraintId(Kind.NORTH), "north position"),
        (ConstraintId(Kind.NORTH, Form.BOUND), "limit of north position"),
        (ConstraintId(Kind.NORTH, Form.MOTION), "Eq. 1 for north position"),
        (ConstraintId(Kind.NORTH, Form.ROW, vehicle=7), "north of vehicle 7"),
        (ConstraintId(Kind.NORTH_SPEED, Form.ROW, vehicle=7), "north speed of vehicle 7"),
        (ConstraintId(Kind.CLEARANCE), "clearance above ground"),
        (ConstraintId(Kind.CLEARANCE, Form.ROW, vehicle=7), "clearance of vehicle 7"),
        (ConstraintId(Kind.CLEARANCE, Form.ROW, part=1, vehicle=7), "clearance of vehicle 7, other side"),
        (ConstraintId(Kind.TURNING, Form.ROW, vehicle=7), "turning radius of vehicle 7"),
        (ConstraintId(Kind.JERK, Form.ROW), "jerk of the formation"),
        (ConstraintId(Kind.COURSE), "heading along the course"),
        (ConstraintId(Kind.COURSE, Form.ROW), "heading of the formation along its course"),
        (ConstraintId(Kind.FORWARDS), "flight towards the formation's front"),
        (ConstraintId(Kind.ZONE, of=ZONE), "no-fly zone 2"),
        (ConstraintId(Kind.ZONE, Form.ROW, ZONE, vehicle=7), "no-fly zone 2 for vehicle 7"),
        (ConstraintId(Kind.ZONE, Form.ROW, AREA, 4, 7), "keep-in area 1, part 4 for vehicle 7"),
        (ConstraintId(Kind.COORDINATE, of=SCALE), "scale"),
        (ConstraintId(Kind.COORDINATE, Form.MOTION, SCALE, 1), "Eq. 1 for scale's rate"),
        (ConstraintId(Kind.COORDINATE, Form.BOUND, SCALE, 4), "limit of scale's snap"),
        (ConstraintId(Kind.LEG_DURATION, Form.BOUND, 13), "limit of the duration of leg 13"),
        (ConstraintId(Kind.FLIGHT_TIME, Form.BOUND), "limit of the time of flight"),
        (ConstraintId(Kind.FLIGHT_TIME), "time of flight"),
        (ConstraintId(Kind.THRUST_FALL), "rate of the falling thrust"),
        (ConstraintId(Kind.POINT_TIME, Form.ROW, GATE), 'time of point 3 ("gate")'),
        (ConstraintId(Kind.POINT_DISTANCE, Form.ROW, PLAIN), "distance to point 12"),
        (ConstraintId(Kind.HOLD_SPEED, of=GATE), 'route point 3 ("gate"): speed during the hold'),
    ],
)
def test_a_constraint_has_the_name_that_reports_and_files_know(constraint: ConstraintId, text: str) -> None:
    assert str(constraint) == text


def test_braces_in_the_name_of_a_point_are_printed() -> None:
    assert str(ConstraintId(Kind.POINT_SPEED, of=PointName(1, "{of}"))) == 'route point 1 ("{of}"): speed'


def test_states_and_controls_have_the_order_of_their_columns() -> None:
    assert [kind.value for kind in (*STATES[::3], *CONTROLS)] == [
        *("north position", "north speed", "roll", "roll rate"),
        *("thrust U1", "control U2", "control U3", "control U4"),
    ]


def test_rewording_every_constraint_changes_no_plan_and_no_verdict(
    meadow_plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    report, words = verify(meadow_plan), itertools.count()
    monkeypatch.setattr(ConstraintId, "__str__", lambda _: f"limit of {next(words)}")
    again = make_plan(meadow_plan.scenario)
    assert again.hash == meadow_plan.hash
    assert verify.__wrapped__(again) == report  # type: ignore[attr-defined]
