"""Courses of missions: whole, smooth, and worked out no further than they are flown."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from gcs.autopilots.waypoint_models.calibration import ARDUPILOT, PX4
from gcs.autopilots.waypoint_models.navigator import Navigator
from gcs.mission.model import Command, MissionItem
from sim_bridge.autopilot.guidance.mission_guidance import fly_mission
from sim_bridge.autopilot.guidance.path_generator import PathGenerator, PiecePath
from sim_bridge.autopilot.guidance.piece import Mark, Piece, hold
from sim_bridge.cli import run
from tests.unit.sim_bridge.bodies import HOME, ORIGIN, item
from tests.unit.sim_bridge.timed_missions import LIMITS as STRONG

ALL = pytest.mark.parametrize("navigator", [None, ARDUPILOT, PX4], ids=["ideal", "ardupilot", "px4"])
ON_THE_GROUND = hold(0.0, np.append(HOME, 0.4)).at(0.0)
ITEMS: tuple[MissionItem, ...] = (
    item(Command.NAV_WAYPOINT, (0, 0, 0)),
    item(Command.NAV_TAKEOFF, (0, 0, 8)),
    item(Command.DO_CHANGE_SPEED, p1=1.0, p2=3.0, p3=-1.0),
    item(Command.NAV_WAYPOINT, (30, 0, 8)),
    item(Command.NAV_WAYPOINT, (30, 30, 10), p1=2.0),
    item(Command.NAV_WAYPOINT, (0, 30, 10)),
    item(Command.NAV_DELAY, p1=3.0, p2=-1.0, p3=-1.0, p4=-1.0),
    item(Command.NAV_WAYPOINT, (0, 0, 8)),
    item(Command.NAV_LAND, (0, 0, 0)),
)


def path_generator(navigator: Navigator | None) -> PathGenerator:
    return PathGenerator(
        STRONG, ORIGIN, HOME, speed_mps=3.0, land_mps=0.5, descend_mps=1.5, rtl_height_m=15.0, navigator=navigator
    )


def whole(course: PiecePath) -> tuple[list[Piece], list[Mark], PiecePath]:
    """All pieces and marks, and the last part."""
    pieces, marks = list(course.pieces), list(course.marks)
    for part in course.continuation or ():
        pieces += part.pieces
        marks += part.marks
        course = part
    return pieces, marks, course


@ALL
def test_every_piece_goes_on_where_the_last_ended(navigator):
    pieces, marks, last = whole(fly_mission(path_generator(navigator), 5.0, ON_THE_GROUND, ITEMS, 1, landed=True))
    assert pieces[0].start_s == 5.0
    for before, after in itertools.pairwise(pieces):
        ended, begins = before.at(before.end_s), after.at(before.end_s)
        np.testing.assert_allclose(begins[:2], ended[:2], atol=1e-6)
        assert after.end_s >= before.end_s
    assert last.landing_from_s < np.inf
    assert np.isinf(pieces[-1].end_s)
    times = [mark.t_s for mark in marks]
    assert times == sorted(times)
    assert [mark.reached for mark in marks] == [None, 2, 3, 4, 5, 6, 7]
    assert [mark.current for mark in marks] == [1, 3, 4, 5, 6, 7, 8]


@ALL
def test_holds_and_delays_last(navigator):
    _, marks, _ = whole(fly_mission(path_generator(navigator), 0.0, ON_THE_GROUND, ITEMS, 1, landed=True))
    at_s = {mark.reached: mark.t_s for mark in marks}
    if navigator is None:  # on time: 30 m at 3 m/s, a hold of 2 s, and a delay that is part of the curve
        assert at_s[4] - at_s[3] == pytest.approx(np.hypot(30.0, 2.0) / 3.0 + 2.0, abs=0.05)
        assert at_s[6] - at_s[5] == pytest.approx(3.0, abs=0.01)
    else:
        assert at_s[4] - at_s[3] > 30.0 / 3.0 + 2.0
        assert at_s[6] - at_s[5] == pytest.approx(3.0, abs=1e-9)


@pytest.mark.parametrize("navigator", [ARDUPILOT, PX4], ids=["ardupilot", "px4"])
def test_a_mission_that_ends_at_a_waypoint_comes_to_rest_there(navigator):
    pieces, _, _ = whole(fly_mission(path_generator(navigator), 0.0, ON_THE_GROUND, ITEMS[:4], 1, landed=True))
    end = pieces[-1].at(pieces[-1].end_s)
    np.testing.assert_allclose(end[0, :3], HOME + np.array([30.0, 0.0, -8.0]), atol=0.5)
    np.testing.assert_allclose(end[1:3], 0.0, atol=1e-6)


@pytest.mark.parametrize("navigator", [ARDUPILOT, PX4], ids=["ardupilot", "px4"])
def test_only_what_is_flown_is_worked_out(navigator):
    course = fly_mission(path_generator(navigator), 0.0, ON_THE_GROUND, ITEMS, 1, landed=True)
    known_s = course.pieces[-1].end_s
    assert course.continuation is not None
    for _ in range(3):
        part = next(course.continuation)
        assert part.pieces[0].start_s == known_s
        known_s = part.pieces[-1].end_s
    assert known_s < 25.0


def test_a_navigator_nobody_knows_is_refused(capsys):
    assert run(["missions/field", "--nav", "best"]) == 2
    assert "--nav must be own or ideal" in capsys.readouterr().err
