"""The table of autopilots, compared with the modes and health flags that recorded vehicles have."""

from __future__ import annotations

import math

import pytest

from gcs.autopilots.ardupilot import ARDUPILOT
from gcs.autopilots.columns import AutopilotTraits
from gcs.autopilots.flight_modes import flight_behaviour
from gcs.autopilots.px4 import PX4
from gcs.autopilots.traits import Autopilot
from gcs.errors import PeerError
from sim_bridge.personality import Intent, by_name

BOTH = pytest.mark.parametrize("firmware", list(Autopilot))
OTHER_NAMES = {"return": "rtl"}  # of PX4's modes, on the wire


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


def test_every_published_mode_has_its_own_name() -> None:
    """Copter 4.5 to 4.7 use all numbers up to 29 but these; PX4's are those of its `px4_custom_mode.h`."""
    for firmware, numbers in (
        (ARDUPILOT, sorted({*range(30)} - {8, 10, 12})),
        (
            PX4,
            [main << 16 for main in range(1, 12)]
            + [3 << 16 | sub << 24 for sub in (1, 2)]
            + [4 << 16 | sub << 24 for sub in range(1, 19)],
        ),
    ):
        names = [firmware.flight.mode_name(number) for number in numbers]
        assert not [name for name in names if "mode" in name.lower()]
        assert len(set(names)) == len(names)
        assert sorted(firmware.flight.mode_names) == sorted(numbers)


@pytest.mark.parametrize(
    ("firmware", "number", "name"),
    [
        (PX4, 196608, "POSITION"),  # its failsafe's mode after a lost setpoint stream
        (PX4, 3 << 16 | 1 << 24, "ORBIT"),
        (PX4, 4 << 16 | 9 << 24, "PRECLAND"),
        (PX4, 4 << 16 | 18 << 24, "EXTERNAL8"),
        (PX4, 10 << 16, "TERMINATION"),
        (PX4, 4 << 16 | 99 << 24, "AUTO"),
        (PX4, 99 << 16 | 1 << 24, "mode 99.1"),
        (ARDUPILOT, 27, "AUTO_RTL"),
        (ARDUPILOT, 29, "RATE_ACRO"),
        (ARDUPILOT, 30, "mode 30"),
    ],
)
def test_names_of_modes(firmware: AutopilotTraits, number: int, name: str) -> None:
    assert firmware.flight.mode_name(number) == name


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
    health, estimator = by_name(firmware.key).health, firmware.traits.link.estimator
    name = estimator.message.name
    assert not estimator.is_ready(name, {"flags": int(health.before_ready)})
    assert estimator.is_ready(name, {"flags": int(health.ready)})
    assert not estimator.is_ready("HEARTBEAT", {})


def test_an_autopilot_that_is_not_in_the_table() -> None:
    assert flight_behaviour(1, 3) is ARDUPILOT.flight
    assert flight_behaviour(1, 12) is PX4.flight
    with pytest.raises(PeerError, match="vehicle 7 runs autopilot number 4"):
        flight_behaviour(7, 4)
