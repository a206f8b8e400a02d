"""A vehicle that drifts towards another one at the take-off is seen in time, and all vehicles land on their pads."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from gcs.errors import FlightError
from gcs.flight.contingency.choices import FlightMode
from gcs.flight.monitoring.progress import FlightPart
from gcs.plan.trajectory.plan import Plan
from tests.bridge.flying import fly
from tests.bridge.test_mishaps import flew_on

DRIFT = "2:push=0,2.5@3..10"  # more than its controller holds against, towards vehicle 3


@pytest.mark.parametrize("mode", [FlightMode.STREAM, pytest.param(FlightMode.MISSION, marks=pytest.mark.slow)])
def test_a_vehicle_that_drifts_at_the_take_off_lands_before_it_meets_another(hop: Plan, mode: FlightMode) -> None:
    flown = fly(hop, DRIFT, mode=mode)
    assert isinstance(flown.error, FlightError)
    assert "the start was aborted: vehicle 2" in flown.error.message
    assert flown.happened(2) == ["separation in danger"]
    assert [flown.orders(sysid) for sysid in (1, 2, 3)] == [["land"]] * 3
    assert flown.world.airframes.landed.all()
    apart_m = [pdist(flown.places[:, n]).min() for n in range(flown.places.shape[1])]
    assert min(apart_m) > hop.scenario.judge.separation_min_m
    nearest = flown.flight.monitor.nearest[FlightPart.TAKEOFF]
    assert nearest.pair == (2, 3)
    assert nearest.distance_m < 0.9 * pdist(hop.pads_ned_m).min()


@pytest.mark.long
def test_an_undisturbed_flight_tells_its_separations_from_the_take_off_to_the_ground(hop: Plan) -> None:
    flown = fly(hop)
    assert flown.error is None
    assert flown.events == []
    for sysid in (1, 2, 3):
        flew_on(flown, sysid)
    assert list(flown.flight.monitor.nearest) == list(FlightPart)
    for part in flown.flight.monitor.nearest.values():
        assert part.distance_m == pytest.approx(pdist(hop.pads_ned_m).min(), abs=0.3)
        assert np.isfinite(part.unix_s)
