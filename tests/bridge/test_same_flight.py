"""The same seed and the same stamped stream are the same flight, bit by bit, however early or late setpoints come."""

from __future__ import annotations

import math
import socket
import threading

import numpy as np
import pytest

from gcs.link.wire.codec import Codec
from gcs.link.wire.message import GROUND, Message
from gcs.mavlink import CopterMode, MavResult
from sim_bridge.fleet import plain_scenario
from sim_bridge.protocol.endpoint_address import EndpointKind, EndpointSpec, call
from sim_bridge.sim.world import World, WorldOptions
from tests.fleets import EPOCH_UNIX_S

BEGINS_S, PERIOD_S, SETPOINTS = 14.0, 0.04, 250
FULL_MASK = 0x800  # position, velocity, acceleration and yaw


def setpoint(t_s: float, boot_ms: int) -> Message:
    """On a circle that is entered at rest."""
    angle = 0.02 * t_s**2
    rate = 0.04 * t_s
    s, c = math.sin(angle), math.cos(angle)
    numbers = {"x": 5 * s, "y": 5 - 5 * c, "z": -3.0, "vx": 5 * rate * c, "vy": 5 * rate * s, "vz": 0.0}
    numbers |= {"afx": 0.2 * c - 5 * rate**2 * s, "afy": 0.2 * s + 5 * rate**2 * c, "afz": 0.0}
    numbers |= {"yaw": 0.3 * math.sin(0.7 * t_s), "yaw_rate": 0.0}
    single = {name: float(np.float32(value)) for name, value in numbers.items()}
    head = {"time_boot_ms": boot_ms, "target_system": 1, "target_component": 1, "coordinate_frame": 1}
    return Message("SET_POSITION_TARGET_LOCAL_NED", {**head, "type_mask": FULL_MASK, **single}, *GROUND)


def flown(seed: int, latest_s: float) -> np.ndarray:
    """True states; setpoints come up to 0.7 s ahead of their time, or as little as `latest_s`."""
    rng = np.random.default_rng(seed)
    options = WorldOptions(links=[EndpointSpec(EndpointKind.UDP_IN)], seed=7, epoch_unix_s=EPOCH_UNIX_S)
    with World(plain_scenario(1), options) as fleet:
        vehicle = fleet.vehicles[0]
        pilot = vehicle.autopilot
        while not pilot.readiness.ready:
            fleet.step()
        pilot.set_mode(fleet.t_s, CopterMode.GUIDED)
        assert pilot.arm(fleet.t_s, fleet.airframes.estimate[0]) == MavResult.ACCEPTED
        pilot.take_off(fleet.t_s, 3.0)
        boot_ms = vehicle.instruments.boot_offset_ms
        states, sent, ahead_s, waited = [], 0, 0.7, 0

        def send() -> None:
            stamp_ms = boot_ms + round(1000 * (BEGINS_S + sent * PERIOD_S))
            vehicle.receive(setpoint(sent * PERIOD_S, stamp_ms), 0.0)

        while fleet.t_s < BEGINS_S + SETPOINTS * PERIOD_S - 0.5:
            if rng.random() < 0.1:
                ahead_s = rng.uniform(latest_s, 0.7)
            while fleet.t_s > BEGINS_S - 1.0 and BEGINS_S + sent * PERIOD_S < fleet.t_s + ahead_s:
                send()
                sent += 1
            while pilot.path.awaits_setpoint_after_s(fleet.t_s) is not None:  # as `World.run` waits for it
                send()
                sent += 1
                waited += 1
            fleet.step()
            states.append(fleet.airframes.truth[0].copy())
        assert (waited > 0) == (latest_s < PERIOD_S)
        return np.array(states)


@pytest.mark.parametrize(
    "latest_s", [pytest.param(0.05, marks=pytest.mark.slow), 0.02, pytest.param(-0.1, marks=pytest.mark.slow)]
)
def test_when_setpoints_come_changes_nothing(latest_s: float) -> None:
    early, late = flown(1, 0.1), flown(2, latest_s)
    assert np.abs(early[-1, :2] - early[0, :2]).max() > 3.0
    np.testing.assert_array_equal(early, late)


def test_time_stands_still_for_a_late_stream_and_says_so_again() -> None:
    """What told the ground station the time may have been lost; nothing else will come while time stands."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.bind(("127.0.0.1", 0))
        ground.settimeout(60.0)
        options = WorldOptions(links=[call(ground.getsockname()[1])], speedup=math.inf, epoch_unix_s=EPOCH_UNIX_S)
        with World(plain_scenario(1), options) as fleet:
            vehicle = fleet.vehicles[0]
            pilot = vehicle.autopilot
            while not pilot.readiness.ready:
                fleet.step()
            pilot.set_mode(fleet.t_s, CopterMode.GUIDED)
            assert pilot.arm(fleet.t_s, fleet.airframes.estimate[0]) == MavResult.ACCEPTED
            pilot.take_off(fleet.t_s, 3.0)
            while fleet.t_s < BEGINS_S:
                fleet.step()

            def send(t_s: float) -> None:
                vehicle.receive(setpoint(t_s, vehicle.instruments.boot_offset_ms + round(1e3 * (BEGINS_S + t_s))), 0.0)

            send(0.2)
            flying = threading.Thread(target=fleet.run)
            flying.start()
            try:
                for newest_s in (0.2, 0.6):
                    codec, said_ms = Codec(0, 0), list[int]()
                    while len(said_ms) < 3 or len(set(said_ms[-3:])) > 1:
                        messages = codec.decode(ground.recv(4096))
                        said_ms += [m.fields["time_boot_ms"] for m in messages if m.name == "SYSTEM_TIME"]
                    assert fleet.t_s == pytest.approx(BEGINS_S + newest_s)
                    fleet.call(lambda: send(0.6))
            finally:
                fleet.stop()
                flying.join(60.0)
