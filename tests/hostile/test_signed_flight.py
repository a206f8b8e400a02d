"""A flight with a key on both ends: a stranger without it changes nothing, whatever it sends or repeats."""

from __future__ import annotations

import itertools
import threading
from pathlib import Path

import pytest

from gcs.errors import UsageError
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import GROUND, Message
from gcs.link.wire.signing_keys import signing_with
from tests.hostile.attacker import Attacker
from tests.hostile.conftest import MakeVehicles, all_down
from tests.hostile.ground import Ground, fly_arguments

KEY, OTHER_KEY = bytes(range(1, 33)), bytes(range(33, 65))
LAND = 9
BEAT = {"type": 2, "autopilot": 3, "base_mode": 89, "custom_mode": LAND, "system_status": 4, "mavlink_version": 3}


def orders(signed_with: bytes | None) -> list[bytes]:
    """What lands or disarms every vehicle that obeys."""
    codec, signing = Codec(*GROUND), signing_with(signed_with, 0.0, 3e9)
    found = []
    for sysid, (command, first, second) in itertools.product((1, 2, 3), ((176, 1.0, 9.0), (400, 0.0, 21196.0))):
        params = dict.fromkeys((f"param{n}" for n in range(3, 8)), 0.0) | {"param1": first, "param2": second}
        fields = {"target_system": sysid, "target_component": 1, "command": command, "confirmation": 0, **params}
        found.append(codec.encode(Message("COMMAND_LONG", fields), signing.signature(1.0) if signing else None))
    return found


def lies(signed_with: bytes | None) -> list[bytes]:
    """The heartbeats of landing vehicles."""
    codec, signing = Codec(1, 1), signing_with(signed_with, 0.0, 3e9)
    return [
        codec.encode(Message("HEARTBEAT", BEAT, sysid, 1), signing.signature(1.0) if signing else None)
        for sysid in (1, 2, 3)
    ]


def recorded(flights: Path) -> list[bytes]:
    """The frames of the flight's own log, as somebody in between would have them."""
    (log,) = flights.glob("*/telemetry.tlog")
    return [message.raw for message in Codec(0, 0).decode(log.read_bytes())]


@pytest.mark.slow
def test_a_signed_flight_is_not_changed_without_the_key(vehicles: MakeVehicles, hop_file: Path, tmp_path: Path) -> None:
    key_file = tmp_path / "key"
    key_file.touch(0o600)
    key_file.write_text(KEY.hex())
    world, port = vehicles("ardupilot", signing_key=KEY)
    flights = tmp_path / "flights"
    line = fly_arguments(hop_file, port, flights, "--signing-key-file", key_file)
    with Attacker(port) as stranger, Ground(*line) as ground:
        ground.until("flying")
        old = recorded(flights)
        assert len(old) > 100
        at_vehicles = [Attacker(place.port) for places in world.places.values() for place in places]
        stop = threading.Event()

        def attack() -> None:
            told = lies(None) + lies(OTHER_KEY) + old
            ordered = orders(None) + orders(OTHER_KEY) + old
            while not stop.is_set():
                stranger.flood(told, 2_000.0, 0.1)
                for one in at_vehicles:
                    one.flood(ordered, 500.0, 0.1)

        thread = threading.Thread(target=attack, daemon=True)
        thread.start()
        done = ground.ended()
        stop.set()
        thread.join()
    assert done.code == 0, done.output
    assert stranger.sent > 200
    assert all_down(world)
    assert abs(world.airframes.truth[0, :2] - [60.0, 20.0]).max() < 1.0
    assert KEY.hex() not in done.output


def test_a_vehicle_whose_autopilot_does_not_sign_gets_no_key(vehicles: MakeVehicles) -> None:
    with pytest.raises(UsageError, match="does not check signatures"):
        vehicles("px4", signing_key=KEY)
