"""Missions pass the points that were drawn: a sample at each instant, a waypoint at each place, a delay for a hold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.frames import from_degE7, geodetic_to_ned
from gcs.mission.model import Command
from gcs.mission.waypoints.arrival_times import _gate_samples, corrected_legs
from gcs.mission.waypoints.mission_items import ROUNDING_M, build_missions, timed_legs
from gcs.mission.waypoints.timed_legs import with_drawn_points
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.si import local_origin
from tests.unit.plan.routed import with_route

DRAWN_S = (7.03, 23.48, 40.0)


@pytest.fixture(scope="module")
def routed(plan_of: Callable[[str], Plan]) -> Plan:
    return with_route(plan_of("field/scenario.toml"), {t_s: {} for t_s in DRAWN_S})


def test_samples_have_the_instants_of_all_points_and_no_step_is_short(routed: Plan) -> None:
    t_s, drawn = with_drawn_points(np.arange(0.0, 50.05, 0.1), routed)
    assert t_s[list(drawn)].tolist() == pytest.approx(DRAWN_S)
    assert np.diff(t_s).min() >= 0.05 - 1e-9
    assert np.diff(t_s).max() <= 0.2
    before, none = with_drawn_points(np.arange(0.0, 5.0, 0.1), routed)
    assert (len(before), none) == (50, ())


@pytest.mark.parametrize("corrected", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_every_vehicle_has_a_waypoint_where_it_is_when_the_leader_is_at_a_point(routed: Plan, corrected: bool) -> None:
    legs = corrected_legs(routed, Autopilot.ARDUPILOT) if corrected else timed_legs(routed)
    assert set(DRAWN_S) <= set(legs.t_s.tolist())
    origin, places = local_origin(routed.scenario), routed.states(np.array(DRAWN_S))[..., POSITION]
    for mission, own in zip(build_missions(routed, legs, firmware=Autopilot.ARDUPILOT), places, strict=True):
        items = [item for item in mission.items if item.command == Command.NAV_WAYPOINT]
        lat, lon = (from_degE7(np.array([getattr(item, key) for item in items])) for key in ("lat_degE7", "lon_degE7"))
        alt_m = mission.home.alt_amsl_m + np.array([item.alt_m for item in items])
        written = geodetic_to_ned(lat, lon, alt_m, origin)
        for place in own:
            away_m = np.linalg.norm((written - place)[:, :2], axis=1)
            assert away_m.min() <= ROUNDING_M
            assert written[away_m.argmin(), 2] <= place[2] + 0.01  # where the ground is near, it may be raised


def test_gates_are_neither_at_points_nor_in_holds() -> None:
    t_s = np.arange(0.0, 100.05, 0.1)
    assert _gate_samples(t_s, 1, [(49.6, 49.6)]) == [0, 510, 1000]
    assert _gate_samples(t_s, 1, [(40.0, 55.0)]) == [0, 560, 1000]
