"""The table of behaviour, held against the modes and habits that the emulated vehicles have from recordings."""

from __future__ import annotations

import math

import pytest

from gcs.autopilots.flight_modes import ARDUPILOT, PX4, FlightBehaviour, flight_behaviour
from gcs.errors import PeerError
from sim_bridge.personality import Intent, by_name

BOTH = pytest.mark.parametrize("behaviour", [ARDUPILOT, PX4], ids=["ardupilot", "px4"])


@BOTH
def test_modes_are_what_they_are_for(behaviour: FlightBehaviour) -> None:
    modes = by_name(behaviour.firmware.key).modes
    wanted = {
        behaviour.guided: Intent.GUIDED,
        behaviour.mission: Intent.MISSION,
        behaviour.hold: Intent.HOLD,
        behaviour.land: Intent.LAND,
        behaviour.returning: Intent.RETURN,
    }
    for number, intent in wanted.items():
        mode = modes.numbered(number)
        assert mode is not None
        assert mode.intent is intent
        assert behaviour.mode_name(number).lower() == mode.name.lower()
    armed_in = modes.numbered(behaviour.armed_in)
    assert armed_in is not None
    assert armed_in.armable
    assert behaviour.two_part_modes == modes.two_part


def test_modes_as_commands() -> None:
    assert ARDUPILOT.mode_parameters(ARDUPILOT.land) == (1.0, 9.0)
    assert PX4.mode_parameters(PX4.land) == (1.0, 4.0, 6.0)
    assert PX4.mode_parameters(PX4.guided) == (1.0, 6.0, 0.0)


def test_heights_of_take_off() -> None:
    assert ARDUPILOT.takeoff_parameters(3.0, 488.0)[6] == 3.0
    assert PX4.takeoff_parameters(3.0, 488.0)[6] == 491.0
    assert math.isnan(PX4.takeoff_parameters(3.0, 488.0)[4])  # where it stands


@BOTH
def test_ready_as_the_recordings_show_it(behaviour: FlightBehaviour) -> None:
    health = by_name(behaviour.firmware.key).health
    assert not behaviour.position_is_known(behaviour.estimator[0], {"flags": int(health.before_ready)})
    assert behaviour.position_is_known(behaviour.estimator[0], {"flags": int(health.ready)})
    assert not behaviour.position_is_known("HEARTBEAT", {})


def test_an_autopilot_that_nobody_knows() -> None:
    assert flight_behaviour(1, 3) is ARDUPILOT
    assert flight_behaviour(1, 12) is PX4
    with pytest.raises(PeerError, match="vehicle 7 runs autopilot number 4"):
        flight_behaviour(7, 4)
