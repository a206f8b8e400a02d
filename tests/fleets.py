"""Emulated fleets for tests: in this process, on a port that nobody uses."""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Self
from unittest.mock import patch

from gcs.link.wire.message import Message
from gcs.scenario.schema.scenario import Scenario
from sim_bridge.dynamics.airframes import CONTROL_PERIOD_S
from sim_bridge.fleet import Fleet
from sim_bridge.sim.world import World, WorldOptions
from tests.virtual_clock import VirtualClock, VirtualLoop

EPOCH_UNIX_S = 1_700_000_000.0


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def running_fleet(scenario: Scenario, options: WorldOptions, *, paused: bool = False) -> Iterator[World]:
    """A fleet that flies in a thread of its own until the block ends; its failure is the test's.

    Paused, it has taken its first 5 s (it is ready then) and waits to be `run` by the test.
    """
    with World(scenario, replace(options, epoch_unix_s=EPOCH_UNIX_S)) as fleet:
        if paused:
            while fleet.t_s < 5.0:
                fleet.step()
            yield fleet
            return
        failures: list[BaseException] = []

        def fly() -> None:
            try:
                fleet.run()
            except BaseException as failure:
                failures.append(failure)

        thread = threading.Thread(target=fly)
        thread.start()
        try:
            yield fleet
        finally:
            fleet.stop()
            thread.join(60.0)
        assert not thread.is_alive()
        assert not failures, failures


class Moved:
    """Emulated vehicles as something that moves with a virtual clock, in the thread of whoever lets it pass."""

    def __init__(self, world: World, clock: VirtualClock) -> None:
        self._world = world
        self._began_s = clock.now_s - world.t_s

    @property
    def due_s(self) -> float:
        return self._began_s + self._world.t_s + CONTROL_PERIOD_S

    def hear(self) -> None:
        self._world.traffic.listen(0.0, self._world.t_s)

    def move(self) -> None:
        while self._world._calls:
            self._world._calls.popleft()()
        self._world.step()


@contextmanager
def emulated(scenario: Scenario, options: WorldOptions, clock: VirtualClock) -> Iterator[World]:
    """A fleet that moves with this clock until the block ends."""
    with World(scenario, replace(options, epoch_unix_s=EPOCH_UNIX_S, clock=clock)) as world:
        moved = Moved(world, clock)
        clock.moving.append(moved)
        try:
            yield world
        finally:
            clock.moving.remove(moved)


CLOCK = VirtualClock()  # of `StillFleet`s, of the scenes with them, and of commands (the fixture `make_fleet`)
TURN_S = 1e-3  # a turn of the loop takes time: a setpoint may be due in less than a loop can wait


def still_loop() -> VirtualLoop:
    """An event loop whose time is that of the fleets."""
    return VirtualLoop(TURN_S, CLOCK)


@contextmanager
def still_commands() -> Iterator[None]:
    """Commands that this process runs have the time of the fleets; what they would compute beside it, they do first."""

    async def at_once(work: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        return work(*arguments, **options)

    with (
        patch("gcs.util.aio.SteadyLoop", still_loop),
        patch("gcs.flight.execution.flight.in_own_process", at_once),
        patch("gcs.flight.setup.build_loads.in_own_process", at_once),
    ):
        yield


def in_their_time(scene: Coroutine[Any, Any, None], patience_s: float = 90.0) -> None:
    """Run `scene` as `asyncio.run` does, in the time of the fleets; fails after `patience_s` of it."""

    async def bounded() -> None:
        async with asyncio.timeout(patience_s):
            await scene

    with asyncio.Runner(loop_factory=still_loop) as runner:
        runner.run(bounded())


class StillFleet(Fleet):
    """A fleet without a thread: it moves when a loop waits, or `wait_until` does."""

    def __enter__(self) -> Self:
        self._world.options = replace(self._world.options, clock=CLOCK)
        self._world.traffic._clock = CLOCK
        self._moved = Moved(self._world, CLOCK)
        CLOCK.moving.append(self._moved)
        return self

    def __exit__(self, *_: object) -> None:
        CLOCK.moving.remove(self._moved)
        self._world.close()

    def wait_until(self, condition: Callable[[], bool], patience_s: float = 60.0) -> None:
        CLOCK.wait_until(condition, patience_s)


def ask(world: World, row: int, number: int, rate_hz: float) -> None:
    """Have a vehicle send message `number` so often, as if a ground station had asked for it over a good link."""
    fields = {"target_system": 0, "target_component": 0, "command": 511, "confirmation": 0}
    params = {"param1": float(number), "param2": 1e6 / rate_hz} | {f"param{n}": 0.0 for n in range(3, 8)}
    (ack,) = world.vehicles[row].receive(Message("COMMAND_LONG", fields | params, 255, 190), 0.0)
    assert ack.fields["result"] == 0


def wait_until(condition: Callable[[], bool], patience_s: float = 120.0) -> None:
    """Wait for something that another thread brings about; fails after `patience_s`."""
    end_s = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < end_s, "it did not happen"
        time.sleep(0.005)
