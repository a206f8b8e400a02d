"""A vehicle whose motor dies on the plan: it comes down, and does not go on turning its motors there."""

import numpy as np
import pytest

from gcs.errors import FlightError
from gcs.plan.trajectory.plan import Plan
from tests.bridge.flying import fly
from tests.bridge.test_mishaps import flew_on


@pytest.mark.slow
def test_a_vehicle_that_came_down_stops_its_motors_and_the_others_fly_on(hop: Plan) -> None:
    """A real ArduCopter took itself for flying, and turned its motors on the ground for 100 s."""
    flown = fly(hop, "2:motor=1@25")
    assert isinstance(flown.error, FlightError)
    assert "on the ground with its motors running" in flown.happened(2)
    assert flown.orders(2) == ["land"]
    down_s = flown.t_s[np.argmax((flown.t_s > 0.0) & (flown.places[1, :, 2] > -0.5))]
    assert flown.at_s(2, "ordered to land") - down_s < 4.0
    assert not any(vehicle.autopilot.armed for vehicle in flown.world.vehicles)
    flew_on(flown, 1)
    flew_on(flown, 3)
