"""Missions as the models of autopilots fly them: late, but through the same places and to the same end."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.mission.predicted.autopilot_flight import AutopilotFlight
from gcs.mission.predicted.planned_flight import PredictedFlight, fly
from tests.unit.mission.fleets import FLAT, at, do, mission, out_and_land, speed


def where(flight: PredictedFlight, t_s: float) -> list[float]:
    return [float(np.interp(t_s, flight.t_s, flight.ned_m[:, axis])) for axis in range(3)]


@pytest.mark.parametrize("firmware", list(Autopilot))
def test_starting_and_stopping_take_time(firmware: Autopilot) -> None:
    one = mission(out_and_land(100.0), firmware=firmware)
    planned, modelled = fly(one, FLAT), AutopilotFlight()(one, FLAT)
    assert modelled.up_s == planned.up_s
    late_s = modelled.down_s - planned.down_s
    assert 1.0 < late_s < 15.0
    assert where(modelled, 1e4) == pytest.approx([100, 0, 0], abs=2.5)
    assert modelled.ned_m[:, 0].max() < 103.0
    assert np.all(np.diff(modelled.t_s) >= 0)
    assert {0, 2, 3} == set(modelled.item.tolist())


def test_waits_are_kept() -> None:
    legs = [at(22, 0, 0, 10), do(93, 4.0, -1, -1, -1), speed(5), at(16, 60, 0, 10), do(93, 7.0, -1, -1, -1)]
    legs += [speed(4), at(16, 60, 60, 10, p1=2.0), at(21, 60, 60, 0)]
    bare = [item for item in legs if item.command != 93]
    with_waits, without = (AutopilotFlight()(mission(items), FLAT) for items in (legs, bare))
    # Without the delay at it, the first waypoint is flown through and not stopped at.
    assert 4 + 7 <= with_waits.down_s - without.down_s < 4 + 7 + 6
    standing = (with_waits.t_s > with_waits.up_s + 4 + 20) & (with_waits.t_s < with_waits.up_s + 4 + 22)
    assert np.ptp(with_waits.ned_m[standing], axis=0).max() < 1.0


def test_corners_are_cut() -> None:
    legs = [at(22, 0, 0, 10), speed(5), at(16, 60, 0, 10), at(16, 60, 60, 10), at(21, 60, 60, 0)]
    modelled = AutopilotFlight()(mission(legs), FLAT)
    miss_m = np.linalg.norm(modelled.ned_m - [60, 0, -10], axis=1).min()
    assert 0.3 < miss_m < 3.0


def test_a_return_follows_what_was_flown() -> None:
    modelled = AutopilotFlight()(mission([at(22, 0, 0, 10), speed(5), at(16, 60, 0, 10), do(20)]), FLAT)
    assert where(modelled, 1e4) == pytest.approx([0, 0, 0], abs=0.1)
    assert modelled.ned_m[:, 2].min() == pytest.approx(-15.0, abs=0.1)


def test_heights_above_ground_are_flown_as_planned() -> None:
    legs = [at(22, 0, 0, 10, frame=10), speed(5), at(16, 60, 0, 10, frame=10), at(21, 60, 0, 0, frame=10)]
    assert AutopilotFlight()(mission(legs), FLAT).down_s == pytest.approx(fly(mission(legs), FLAT).down_s)
