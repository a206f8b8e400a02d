"""An emulated fleet for tests: in this process, on a port that nobody uses."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from gcs.link.wire.message import Message
from gcs.scenario.schema.scenario import Scenario
from sim_bridge.sim.world import World, WorldOptions

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
