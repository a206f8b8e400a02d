"""Where a vehicle that left the formation may be: around its last place, along its way home, and with its track."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.flight.contingency.lost_vehicle import kept_m, on_its_way, way_home, where_it_stopped
from gcs.flight.contingency.manoeuvres import MotionStart, return_reference
from gcs.mission.returns.return_routes import ReturnRoutes
from gcs.mission.returns.rtl_altitudes import ReturnPlan
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.no_fly import nearest_zone_m


def test_a_vehicle_has_stopped_on_its_way(hop: Plan) -> None:
    """It brakes with 1.5 m/s² or more: at 3 m/s within 3 m."""
    zone = where_it_stopped(hop, np.array([10.0, 5.0, -8.0]), np.array([3.0, 0.0, 0.5]))
    for north_m in (10.0, 13.0):
        away_m = nearest_zone_m((zone,), np.zeros(1), np.array([[north_m]]), np.array([[5.0]]))
        assert away_m.max() <= -kept_m(hop) + 1e-3
    still = where_it_stopped(hop, np.array([10.0, 5.0, -8.0]), np.zeros(3))
    assert (still.north_m, still.east_m, still.radius_m) == (10.0, 5.0, pytest.approx(kept_m(hop), abs=1e-3))


def test_its_way_home_counts_where_others_fly_as_high(hop: Plan) -> None:
    place, pad = np.array([40.0, 12.0, -8.0]), hop.pads_ned_m[0]
    (zone,) = way_home(hop, 0, place, 9.0, 20.0, (2, 3))
    for share in (0.0, 0.5, 1.0):
        on_way = pad + share * (place - pad)
        away_m = nearest_zone_m((zone,), np.zeros(1), on_way[None, None, 0], on_way[None, None, 1])
        assert away_m.max() <= -kept_m(hop) + 0.5  # a polygon in place of its round ends
    assert way_home(hop, 0, place, 20.0, 20.0, (2, 3)) == ()
    assert way_home(hop, 0, place, 9.0, hop.landing_s, (2, 3)) == ()


def test_a_zone_moves_with_a_vehicle_that_returns(hop: Plan, hop_returns: ReturnPlan) -> None:
    start = MotionStart(np.array([40.0, 12.0, -8.0]), np.array([2.0, 0.7, 0.0]), 0.0, 20.0)
    track = return_reference(start, ReturnRoutes(hop), hop.pads_ned_m[0], -15.0, hop_returns.speeds, 2.0)
    assert track is not None
    zone = on_its_way(hop, track, 21.0)
    for t_s in np.linspace(21.0, track.end_s + 30.0, 50).tolist():
        north_m, east_m = track.at(0, t_s)[:2]
        away_m = nearest_zone_m((zone,), np.array([t_s]), np.array([[north_m]]), np.array([[east_m]]))
        assert away_m.max() == pytest.approx(-kept_m(hop), abs=0.1)
