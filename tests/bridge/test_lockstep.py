"""Station and emulated vehicles in lock-step: a flight that is flown again is the same to the last bit."""

from __future__ import annotations

import asyncio
import math
import random
import socket
import threading
import time
from contextlib import suppress

import numpy as np
import pytest

from gcs.link.endpoints.lockstep_endpoint import LockstepEndpoint
from gcs.link.protocols.command import CommandRefused
from gcs.link.session.linked_fleet import LinkedFleet
from gcs.mavlink import CopterMode, MavCommand
from gcs.util.aio import Stoppable, ended
from gcs.util.steady_loop import host_s
from sim_bridge.faults.fault_spec import parse_faults
from sim_bridge.fleet import plain_scenario
from sim_bridge.protocol.endpoint_address import parse_link
from sim_bridge.sim.world import World, WorldOptions
from tests.fleets import EPOCH_UNIX_S


async def hop(ours: socket.socket, delay_s: float) -> list[float]:
    """Take off and land, beside work of up to `delay_s` that this machine does meanwhile; return what was timed."""
    loop, drawn, timed = asyncio.get_running_loop(), random.Random(1), []

    async def dawdle() -> None:
        while True:
            await asyncio.sleep(drawn.uniform(0.01, 0.3))
            time.sleep(delay_s * drawn.random())

    async with LinkedFleet([LockstepEndpoint(ours)]).open() as fleet:
        dawdling = asyncio.ensure_future(dawdle())
        session = (await fleet.vehicles([1], 30.0))[1]
        armed = False
        while not armed:
            await asyncio.to_thread(time.sleep, 10.0 * delay_s)
            with suppress(CommandRefused):
                await session.command(MavCommand.DO_SET_MODE, 1.0, float(CopterMode.GUIDED))
                await session.command(MavCommand.COMPONENT_ARM_DISARM, 1.0)
                armed = True
            await asyncio.sleep(0.3)
        timed.append(loop.time())
        with suppress(CommandRefused):  # the second one, where the acknowledgement of the first was lost
            await session.command(MavCommand.NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 3.0)
        await asyncio.sleep(2.0 * math.pi)
        timed += [loop.time(), session.clock.now_unix_s(host_s(loop)) or 0.0]
        await ended(dawdling)
    return timed


def flown(delay_s: float, speedup: float = math.inf) -> tuple[np.ndarray, list[float]]:
    """True states, and the times that the station took."""
    ours, theirs = socket.socketpair()
    options = WorldOptions(
        links=[parse_link(f"lockstep:{theirs.detach()}")],
        speedup=speedup,
        seed=7,
        faults=parse_faults(["1:loss=0.2"], (1,)),
        epoch_unix_s=EPOCH_UNIX_S,
        record_truth=True,
    )
    with World(plain_scenario(1), options) as world:
        flying = threading.Thread(target=world.run, daemon=True)
        flying.start()
        timed = Stoppable().run(hop(ours, delay_s))
        flying.join(10.0)
        assert not flying.is_alive()
        assert world.truth is not None
        return world.truth.state, timed


def test_a_slow_station_flies_the_same_flight_to_the_last_bit() -> None:
    at_once, late = flown(0.0), flown(0.003)
    assert at_once[1] == late[1]
    assert at_once[0].shape == late[0].shape
    assert np.ptp(at_once[0][0, :, 2]) > 1.0  # it flew
    assert at_once[0].tobytes() == late[0].tobytes()


@pytest.mark.slow
def test_so_does_one_at_another_speed() -> None:
    fast, slow = flown(0.0), flown(0.0, 5.0)
    assert fast[0].tobytes() == slow[0].tobytes()
    assert fast[1] == slow[1]


def test_a_station_whose_vehicles_are_gone_goes_on_in_real_time() -> None:
    ours, theirs = socket.socketpair()

    async def wait() -> float:
        loop = asyncio.get_running_loop()
        async with LinkedFleet([LockstepEndpoint(ours)]).open():
            assert loop.time() == 0.0
            theirs.close()
            began_s = time.monotonic()
            await asyncio.sleep(0.2)
            assert loop.time() == pytest.approx(0.2, abs=0.1)
            return time.monotonic() - began_s

    assert Stoppable().run(wait()) == pytest.approx(0.2, abs=0.15)
