"""Changes follow each other without a jump, begin when they are told to, and say what stands in their way."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gcs.errors import Infeasible
from gcs.plan.formation.time_scaling import budget, least_duration
from gcs.plan.formation.timeline import Timeline, gate_crossing_s, in_turn, lay, made_changes, scheduled
from gcs.plan.formation.transforms import shrinking
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import offsets_ned_m, shape_offsets_ned_m

SHAPES = [
    {"name": "line", "generator": "line", "spacing_m": 2.0},
    {"name": "row", "generator": "column", "spacing_m": 3.0},
]
TURN = {"kind": "rotate", "angle_deg": 90.0, "at_s": 20.0}
SHRINK = {"kind": "shrink", "scale": 0.9, "at_s": 60.0}
TO_LINE = {"kind": "reshape", "to": "line", "at_s": 100.0}
BACK = {"kind": "reshape", "to": "start", "assignment": "fixed", "gate_m": [[0.0, 50.0], [100.0, 50.5]]}


def scenario_with(scenario: Scenario, *changes: dict[str, Any], **formation: Any) -> Scenario:
    data = scenario.model_dump()
    data["formation"].update(shape=SHAPES, change=list(changes), **formation)
    return Scenario.model_validate(data)


def laid(scenario: Scenario, *starts_s: float, end_s: float = 300.0) -> Timeline:
    return lay(scenario, starts_s, 0.0, end_s)


def test_without_changes_the_formation_is_rigid(simulation1: Scenario) -> None:
    timeline = laid(simulation1)
    assert timeline.moves == ()
    assert timeline.shape.moving_s == ()
    np.testing.assert_array_equal(timeline.shape.at(150.0), offsets_ned_m(simulation1))


def test_automatic_changes_are_not_scheduled(simulation1: Scenario) -> None:
    auto = {"kind": "rotate", "angle_deg": 30.0, "auto": True}
    scenario = scenario_with(simulation1, TURN, auto, SHRINK)
    assert [change.kind for change in scheduled(scenario)] == ["rotate", "shrink"]
    assert len(laid(scenario, 20.0, 60.0).moves) == 2


def test_each_change_begins_where_the_one_before_has_ended(simulation1: Scenario) -> None:
    scenario = scenario_with(simulation1, TURN, SHRINK, TO_LINE, BACK)
    timeline = laid(scenario, 20.0, 60.0, 100.0, 150.0)
    shape, start = timeline.shape, offsets_ned_m(scenario)
    turned = Rotation.from_euler("z", 90.0, degrees=True).apply(start)
    line = shape_offsets_ned_m(scenario, "line")
    assert (shape.start_s, shape.end_s) == (0.0, 300.0)
    np.testing.assert_allclose(shape.at(20.0), start, atol=1e-12)
    np.testing.assert_allclose(shape.at(60.0), turned, atol=1e-12)
    np.testing.assert_allclose(shape.at(100.0), 0.9 * turned, atol=1e-12)
    after = shape.at(150.0)
    assert sorted(map(tuple, after.round(9) + 0.0)) == sorted(map(tuple, line.round(9) + 0.0))
    np.testing.assert_allclose(shape.at(300.0), start, atol=1e-12)
    assert [m.start_s for m in timeline.moves] == [20.0, 60.0, 100.0, 150.0]
    assert shape.moving_s == tuple((m.start_s, m.end_s) for m in timeline.moves)


def test_the_whole_shape_has_no_jump_up_to_its_jerk(simulation1: Scenario) -> None:
    scenario = scenario_with(simulation1, TURN, SHRINK, TO_LINE, BACK)
    shape = laid(scenario, 20.0, 60.0, 100.0, 150.0).shape
    joints = shape.joints_s[1:-1]
    for order in range(4):
        left = shape.offsets(np.nextafter(joints, 0.0), order)
        np.testing.assert_allclose(shape.offsets(joints, order), left, atol=1e-10)


def test_moves_say_what_people_want_to_know(simulation1: Scenario) -> None:
    scenario = scenario_with(simulation1, TURN, SHRINK, TO_LINE, BACK)
    turn, shrink, line, back = laid(scenario, 20.0, 60.0, 100.0, 150.0).moves
    assert [m.kind for m in (turn, shrink, line, back)] == ["rotate", "shrink", "reshape", "reshape"]
    assert [m.name for m in (turn, shrink, line, back)] == [
        "rotate 90 deg",
        "shrink to 0.9",
        'reshape to "line"',
        'reshape to "start"',
    ]
    assert (turn.trigger, back.trigger) == ("at 20 s", "gate (0, 50)-(100, 50.5)")
    start = offsets_ned_m(scenario)
    radius = np.hypot(start[:, 0], start[:, 1]).max()
    assert turn.paper_time_s == pytest.approx(np.pi / 2 * radius / scenario.formation.change_speed_mps)
    for move in (turn, shrink, line, back):
        assert move.end_s - move.start_s > move.paper_time_s
        assert move.limited_by in ("speed", "acceleration", "turn rate", "torque")
        assert move.least_gap_m >= scenario.limits.separation_min_m
    assert shrink.least_gap_m == pytest.approx(0.9 * turn.least_gap_m)
    seconds, limited_by = least_duration(shrinking(start, 0.9), budget(scenario))
    assert (shrink.end_s - shrink.start_s, shrink.limited_by) == (pytest.approx(seconds), limited_by)


def test_a_positive_angle_turns_right_and_an_axis_is_right_handed_in_the_world(simulation1: Scenario) -> None:
    """About straight up, right-handed, is to the left; about north it lifts what is to the west."""
    start = offsets_ned_m(simulation1)
    ahead = np.array([start[:, 0], start[:, 1], start[:, 2]]).T
    right = laid(scenario_with(simulation1, TURN), 20.0).shape.at(300.0)
    np.testing.assert_allclose(right, np.column_stack([-ahead[:, 1], ahead[:, 0], ahead[:, 2]]), atol=1e-12)
    left = laid(scenario_with(simulation1, {**TURN, "axis": [0.0, 0.0, 2.0]}), 20.0).shape.at(300.0)
    np.testing.assert_allclose(left, np.column_stack([ahead[:, 1], -ahead[:, 0], ahead[:, 2]]), atol=1e-12)
    rolled = laid(scenario_with(simulation1, {**TURN, "axis": [1.0, 0.0, 0.0]}), 20.0)
    np.testing.assert_allclose(-rolled.shape.at(300.0)[:, 2], -ahead[:, 1], atol=1e-12)  # up is as far as west was
    assert rolled.moves[0].name == "rotate 90 deg about (1, 0, 0)"


def test_a_way_in_lanes_is_flown_leg_by_leg(simulation1: Scenario) -> None:
    """UAV 5 and 2, everyone fixed, exchange sides: the shape's first and last places lie on one line."""
    here = offsets_ned_m(simulation1)
    table = [[float(n), float(e), float(-d)] for n, e, d in here * [-1.0, -1.0, 1.0]]
    data = simulation1.model_dump()
    data["formation"].update(
        shape=[{"name": "mirror", "offsets_m": table}],
        change=[{"kind": "reshape", "to": "mirror", "assignment": "fixed", "at_s": 10.0}],
    )
    scenario = Scenario.model_validate(data)
    timeline = laid(scenario, 10.0)
    (move,) = timeline.moves
    assert "lane" in move.way
    assert timeline.shape.moving_s == ((10.0, move.end_s),)
    up = -timeline.shape.offsets(np.linspace(10.0, move.end_s, 200))[:, :, 2]
    assert up.max() > scenario.limits.separation_min_m
    np.testing.assert_allclose(timeline.shape.at(move.end_s), here * [-1.0, -1.0, 1.0], atol=1e-12)


def test_one_change_at_a_time(simulation1: Scenario) -> None:
    scenario = scenario_with(simulation1, TURN, SHRINK)
    ends = laid(scenario, 20.0, 60.0).moves[0].end_s
    assert laid(scenario, 20.0, ends).moves[1].start_s == ends
    with pytest.raises(Infeasible) as caught:
        laid(scenario, 20.0, ends - 1.25)
    assert '"shrink to 0.9" (at 60 s)' in caught.value.message
    assert '1.25 s before "rotate 90 deg" has ended' in caught.value.message
    earliest = float(caught.value.hint.split("start it at ")[1].split(" s")[0])
    assert 0.0 <= earliest - ends < 0.011
    laid(scenario, 20.0, earliest)


def test_a_change_ends_with_the_flight(simulation1: Scenario) -> None:
    scenario = scenario_with(simulation1, TURN)
    with pytest.raises(Infeasible) as caught:
        laid(scenario, 20.0, end_s=22.0)
    assert "after the flight does" in caught.value.message
    latest = float(caught.value.hint.split("start it at ")[1].split(" s")[0])
    (move,) = laid(scenario, max(latest, 0.0), end_s=latest + 60.0).moves
    assert latest + (move.end_s - move.start_s) == pytest.approx(22.0, abs=0.011)
    (move,) = laid(scenario, 30.0, end_s=30.0 + move.end_s - move.start_s).moves
    with pytest.raises(Infeasible, match=r"5\.00 s before the flight"):
        lay(scenario, (20.0,), 25.0, 300.0)


def test_a_shrink_keeps_the_separation_and_says_how_far_it_may_go(simulation1: Scenario) -> None:
    with pytest.raises(Infeasible, match=r"shrink to 0.3: vehicles 2 and 5 would be 0.15 m apart") as caught:
        laid(scenario_with(simulation1, {**SHRINK, "scale": 0.3}), 60.0)
    assert "set scale to 0.8 or more" in caught.value.hint
    laid(scenario_with(simulation1, {**SHRINK, "scale": 0.8}), 60.0)


def test_a_shape_that_is_too_tight_is_named(simulation1: Scenario) -> None:
    data = simulation1.model_dump()
    data["formation"].update(
        shape=[{"name": "knot", "generator": "grid", "spacing_m": 0.2}], change=[{**TO_LINE, "to": "knot"}]
    )
    with pytest.raises(Infeasible, match=r'reshape to "knot": after the change vehicles 1 and \d stand 0.20 m apart'):
        laid(Scenario.model_validate(data), 100.0)


TIMES = np.array([10.0, 11.0, 12.0, 13.0])
TRACK = np.array([[0.0, 0.0, -5.0], [4.0, 0.0, -9.0], [8.0, 4.0, -9.0], [2.0, 4.0, -9.0]])


@pytest.mark.parametrize(
    ("gate", "crossed_s"),
    [
        (((1.0, -5.0), (1.0, 5.0)), 10.25),
        (((1.0, 5.0), (1.0, -5.0)), 10.25),
        (((6.0, -9.0), (6.0, 9.0)), 11.5),  # crossed again on the way back
        (((6.0, 3.0), (6.0, 9.0)), 12.0 + 1.0 / 3.0),  # only on the way back
        (((1.0, 1.0), (1.0, 5.0)), None),  # passed beside
        (((20.0, -5.0), (20.0, 5.0)), None),
        (((0.0, 0.0), (0.0, 5.0)), 10.0),  # begins on its end
        (((2.0, 4.0), (2.0, 9.0)), 13.0),  # ends on its end
        (((4.0, -1.0), (4.0, 1.0)), 11.0),  # at an instant of the track
        (((-9.0, 0.0), (-5.0, 0.0)), None),  # flown along, beside it
    ],
)
def test_a_gate_is_crossed_where_the_track_meets_it(gate: Any, crossed_s: float | None) -> None:
    found = gate_crossing_s(gate, TIMES, TRACK)
    assert found is None if crossed_s is None else found == pytest.approx(crossed_s)


def test_a_change_that_is_complete_at_a_time_begins_as_much_earlier_as_it_takes(simulation1: Scenario) -> None:
    timed = {key: value for key, value in TO_LINE.items() if key != "at_s"} | {"done_at_s": 100.0}
    scenario = scenario_with(simulation1, TURN, timed)
    first, second = made_changes(scenario)
    assert first.begins_s == 20.0
    assert second.begins_s == pytest.approx(100.0 - second.duration_s)
    assert in_turn(scenario, (20.0, 40.0), 300.0) == (20.0, 40.0)  # given times are nobody's to move
    _, move = laid(scenario, 20.0, second.begins_s or 0.0).moves
    assert move.end_s == pytest.approx(100.0, abs=1e-9)
    assert move.trigger == "complete at 100 s"
