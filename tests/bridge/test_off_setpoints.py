"""Vehicles that do not follow what is streamed to them, as real ones whose speed limit another station had changed."""

import numpy as np
import pytest

from gcs.plan.trajectory.plan import Plan
from tests.bridge.flying import fly
from tests.bridge.test_mishaps import flew_on

OFF = "off its predicted track"


@pytest.mark.slow
def test_a_slow_vehicle_holds_one_that_is_dragged_away_lands_and_the_third_flies_on(hop: Plan) -> None:
    """A real PX4 was 182 m behind the plan before its own fence stopped it."""
    flown = fly(hop, "2:slow=0.5@20", "3:push=0,6@20")
    assert flown.error is not None and "off its setpoints; limit 5 m" in flown.error.message
    assert flown.happened(2) == [OFF]
    assert flown.orders(2) == ["hold", "return"]
    assert flown.happened(3) == [OFF, OFF]
    assert flown.orders(3) == ["hold", "land"]
    flew_on(flown, 1)
    off_m = np.linalg.norm(flown.places - flown.planned, axis=2)
    for sysid, most_m in ((2, 14.0), (3, 40.0)):
        assert off_m[sysid - 1, np.argmax(flown.t_s > flown.at_s(sysid, OFF))] < most_m
