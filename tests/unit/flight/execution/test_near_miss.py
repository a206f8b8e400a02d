"""The recorded near miss, flown again from its reports until the first order, and from there by what is ordered."""

from __future__ import annotations

import asyncio
from functools import partial
from itertools import combinations

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.flight.contingency import conflict_prediction
from gcs.flight.contingency.choices import FlightMode
from gcs.flight.contingency.conflict_prediction import SeparationWatch
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.contingency.policy import State
from gcs.flight.monitoring.predicted_tracks import TrackWatch
from gcs.mission.returns.rtl_altitudes import plan_returns
from gcs.scenario.values.navigation_error import judged_separation_m
from gcs.types import Array
from tests import near_miss
from tests.point_fleet import ARDUPILOT, PointFleet, flown

OFF_M = 1.3  # reports from true positions, at most, of those who flew on


def flown_again(from_s: float, seconds: float) -> tuple[PointFleet, Array, Array]:
    """The flight from plan time `from_s` on; plan times (N,) and positions (6, N, 3)."""
    times_s, places = [], []

    async def story(fleet: PointFleet) -> None:
        for row, point in enumerate(fleet.points.values()):
            point.mission = partial(lambda row: near_miss.reported(row, fleet.t_s), row)
            point.mode = ARDUPILOT.mission
        while fleet.t_s < from_s + seconds:
            await asyncio.sleep(0.1)
            times_s.append(fleet.t_s)
            places.append([point.position_ned_m for point in fleet.points.values()])

    plan, tracks = near_miss.plan(), near_miss.tracks()
    returns = plan_returns(plan, (Autopilot.ARDUPILOT,) * 6)
    options = FlightOptions(mode=FlightMode.MISSION)
    fleet = flown(plan, returns, story, options=options, t_s=from_s, tracks=tracks)
    return fleet, np.array(times_s), np.swapaxes(places, 0, 1)


def least_m(places: Array) -> float:
    return min(float(np.linalg.norm(a - b, axis=-1).min()) for a, b in combinations(places, 2))


def test_it_was_one() -> None:
    true_m, limit_m = near_miss.true_m(), judged_separation_m(near_miss.plan().scenario)
    assert (round(least_m(true_m), 2), limit_m) == (1.08, 1.54)
    nearest_s = near_miss.STEP_S * int(np.argmin(np.linalg.norm(true_m[0] - true_m[3], axis=-1)))
    assert nearest_s == pytest.approx(near_miss.NEAREST_S, abs=0.2)


def test_all_hold_a_minute_and_a_half_before_it_and_come_home_apart() -> None:
    fleet, t_s, places = flown_again(112.0, 60.0)
    first = fleet.events[0]
    assert (first.sysid, first.what) == (near_miss.LATE, "separation in danger")
    assert first.t_s < near_miss.NEAREST_S - 8.0
    assert first.t_s < 124.4 - 3.0, "4 and 6 come within 2.7 m then"
    assert {event.sysid for event in fleet.told("ordered to hold")} == set(range(1, 7))
    assert {event.sysid for event in fleet.told("ordered to return")} == set(range(1, 7))
    assert set(fleet.executor.policy.states.values()) <= {State.RETURNING, State.LANDING}
    assert least_m(places[:, t_s >= first.t_s]) > judged_separation_m(near_miss.plan().scenario) + 2.0 * OFF_M


@pytest.mark.slow
def test_without_the_conflict_the_late_vehicle_is_seen_off_its_track(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SeparationWatch, "look", lambda *_: [])
    fleet, t_s, places = flown_again(118.0, 30.0)
    first = fleet.events[0]
    assert (first.sysid, first.what) == (near_miss.LATE, "off its predicted track")
    assert first.rule.startswith("2.")
    assert first.t_s == pytest.approx(123.9, abs=0.3)
    assert {event.sysid for event in fleet.told("ordered to hold")} == set(range(1, 7))
    assert least_m(places[:, t_s >= first.t_s]) > judged_separation_m(near_miss.plan().scenario)


@pytest.mark.slow
def test_without_the_track_the_conflict_is_seen_five_seconds_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(TrackWatch, "look", lambda *_: [])
    fleet, t_s, places = flown_again(203.0, 25.0)
    first, order = fleet.events[:2]
    assert (first.what, order.what) == ("separation in danger", "ordered to hold")
    assert "vehicles 1 and 4 will be" in order.rule or "vehicles 4 and 1 will be" in order.rule
    assert near_miss.NEAREST_S - first.t_s > 5.0
    assert conflict_prediction.HORIZON_S >= 5.0
    assert least_m(places[:, t_s >= first.t_s]) > judged_separation_m(near_miss.plan().scenario)
