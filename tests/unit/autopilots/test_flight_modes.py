"""The table of autopilots, compared with the modes and health flags that recorded vehicles have."""

from __future__ import annotations

import math

import pytest

from gcs.autopilots.ardupilot import ARDUPILOT
from gcs.autopilots.flight_modes import flight_behaviour
from gcs.autopilots.px4 import PX4
from gcs.autopilots.traits import Autopilot
from gcs.errors import PeerError
from sim_bridge.personality import Intent, by_name

BOTH = pytest.mark.parametrize("firmware", list(Autopilot))
OTHER_NAMES = {"return": "rtl", "position": "posctl", "altitude": "altctl"}  # of PX4's modes, on the wire


@BOTH
def test_modes_have_the_intent_of_the_recorded_modes(firmware: Autopilot) -> None:
    modes, behaviour = by_name(firmware.key).modes, firmware.traits.flight
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
    armed_in = modes.numbered(behaviour.armed_in)
    assert armed_in is not None
    assert armed_in.armable
    assert behaviour.two_part_modes == modes.two_part


@BOTH
def test_every_recorded_mode_has_its_name(firmware: Autopilot) -> None:
    for mode in by_name(firmware.key).modes.known:
        name = mode.name.lower()
        assert firmware.traits.flight.mode_name(mode.number).lower() == OTHER_NAMES.get(name, name)


def test_modes_as_commands() -> None:
    ardupilot, px4 = ARDUPILOT.flight, PX4.flight
    assert ardupilot.mode_parameters(ardupilot.land) == (1.0, 9.0)
    assert px4.mode_parameters(px4.land) == (1.0, 4.0, 6.0)
    assert px4.mode_parameters(px4.guided) == (1.0, 6.0, 0.0)


def test_altitudes_of_take_off() -> None:
    assert ARDUPILOT.flight.takeoff_parameters(3.0, 488.0)[6] == 3.0
    assert PX4.flight.takeoff_parameters(3.0, 488.0)[6] == 491.0
    assert math.isnan(PX4.flight.takeoff_parameters(3.0, 488.0)[4])  # at the position it has


@BOTH
def test_ready_as_the_recordings_show_it(firmware: Autopilot) -> None:
    health, behaviour = by_name(firmware.key).health, firmware.traits.flight
    name = behaviour.estimator.message.name
    assert not behaviour.position_is_known(name, {"flags": int(health.before_ready)})
    assert behaviour.position_is_known(name, {"flags": int(health.ready)})
    assert not behaviour.position_is_known("HEARTBEAT", {})


def test_an_autopilot_that_is_not_in_the_table() -> None:
    assert flight_behaviour(1, 3) is ARDUPILOT.flight
    assert flight_behaviour(1, 12) is PX4.flight
    with pytest.raises(PeerError, match="vehicle 7 runs autopilot number 4"):
        flight_behaviour(7, 4)
