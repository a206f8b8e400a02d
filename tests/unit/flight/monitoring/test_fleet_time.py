"""The common time of a fleet on an event loop: waits, agreement, refusals and what the slowest link may hide.

The clocks hear SYSTEM_TIME once and then answer from what they know, on a loop whose time is its own.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any, cast

import pytest

from gcs.errors import FlightError, PeerTimeout
from gcs.flight.monitoring.fleet_time import AGREE_S, FleetTime
from gcs.link.protocols.clock import VehicleClock
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.message import Message
from gcs.util.aio import LOOK_S
from tests.virtual_clock import VirtualLoop

EPOCH_S = 1_700_000_000.0
EVERY_S = 0.1
PATIENCE_S = 3.0  # while clocks may come to agree


@dataclass
class RoundTrip:
    mean_s: float | None = 0.0


@dataclass
class Vehicle:
    """A clock and a round trip, which is all that the common time looks at; its messages come by `Fleet.hear`."""

    ahead_s: float = 0.0
    boot_s: float = 50.0  # its boot clock as the fleet began
    clock: VehicleClock = field(default_factory=VehicleClock)
    round_trip: RoundTrip = field(default_factory=RoundTrip)
    listeners: list[Callable[[Message], None]] = field(default_factory=list)

    def subscribe(self, listener: Callable[[Message], None]) -> Callable[[], None]:
        self.listeners.append(listener)
        return lambda: self.listeners.remove(listener)


class Fleet:
    """Vehicles on the running loop that report their time until they are silent; rate 1 unless told."""

    def __init__(self, *ahead_s: float, rate: float = 1.0, sysids: tuple[int, ...] | None = None) -> None:
        self.loop = asyncio.get_running_loop()
        self.began_s = self.loop.time()
        self.rate = rate
        self.vehicles = {sysid: Vehicle(ahead) for sysid, ahead in enumerate(ahead_s, start=1)}
        self.time = FleetTime(cast(dict[int, VehicleSession], self.vehicles), sysids)
        self.silent: set[int] = set()

    @property
    def true_s(self) -> float:
        return EPOCH_S + self.rate * (self.loop.time() - self.began_s)

    def hear(self) -> None:
        now_s = self.loop.time()
        for sysid, vehicle in self.vehicles.items():
            if sysid not in self.silent:
                boot_ms = round(1e3 * (self.true_s - EPOCH_S + vehicle.boot_s))
                stamps = {"time_boot_ms": boot_ms, "time_unix_usec": round(1e6 * (self.true_s + vehicle.ahead_s))}
                report = Message("SYSTEM_TIME", stamps)
                vehicle.clock.receive(report, now_s)
                for listener in tuple(vehicle.listeners):
                    listener(report)

    async def report(self) -> None:
        while True:
            self.hear()
            await asyncio.sleep(EVERY_S)

    async def run(self, seconds: float) -> None:
        await asyncio.sleep(seconds)


def on_a_loop(work: Callable[[], Awaitable[None]], monkeypatch: pytest.MonkeyPatch) -> None:
    """Run it in virtual time; the host's clock is the loop's."""
    monkeypatch.setattr("gcs.flight.monitoring.fleet_time.host_s", lambda loop: loop.time())
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        runner.run(cast(Any, work()))


async def reporting(fleet: Fleet, work: Awaitable[Any]) -> Any:
    reports = asyncio.ensure_future(fleet.report())
    try:
        return await work
    finally:
        reports.cancel()


def test_time_is_unknown_before_the_first_report(monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        fleet = Fleet(0.0, 0.0)
        assert fleet.time.now_s() is None
        with pytest.raises(FlightError, match=r"^the vehicles' clocks were lost in flight\.$"):
            fleet.time.sure_s()
        fleet.hear()
        assert fleet.time.now_s() == fleet.time.sure_s() == pytest.approx(fleet.true_s, abs=1e-3)

    on_a_loop(work, monkeypatch)


def test_a_report_counts_at_the_instant_of_the_last_question(monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        fleet = Fleet(0.0, 0.0, 0.0)
        fleet.hear()
        first_s = fleet.time.sure_s()
        assert fleet.time.sure_s() == first_s
        fleet.began_s -= 0.3
        fleet.hear()
        assert fleet.time.sure_s() == pytest.approx(first_s + 0.3, abs=2e-3)

    on_a_loop(work, monkeypatch)


@pytest.mark.parametrize("rate", [1.0, 10.0])
def test_a_wait_ends_at_the_vehicles_time(rate: float, monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        fleet = Fleet(0.0, 0.0, rate=rate)
        await reporting(fleet, fleet.run(2.0))

        async def wait() -> None:
            end_s = fleet.true_s + 5.0
            await fleet.time.until(end_s)
            assert fleet.true_s == pytest.approx(end_s, abs=0.02 * rate)
            await fleet.time.until(end_s)  # already past: no wait at all

        await reporting(fleet, wait())

    on_a_loop(work, monkeypatch)


@pytest.mark.parametrize(
    ("at_s", "takes_s"),
    [(0.02, 0.02), (60.0, LOOK_S), (-1.0, 0.03)],  # it is predicted; it is far; after it the next report counts
)
def test_a_wait_for_a_time_ends_when_it_is_predicted_or_reported(
    at_s: float, takes_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def work() -> None:
        fleet = Fleet(0.0, 0.0)
        await reporting(fleet, fleet.run(2.0))
        fleet.loop.call_later(0.03, fleet.hear)
        began_s = fleet.loop.time()
        await fleet.time.comes_to(fleet.time.sure_s() + at_s)
        assert fleet.loop.time() - began_s == pytest.approx(takes_s, abs=1e-3)
        assert not any(vehicle.listeners for vehicle in fleet.vehicles.values())

    on_a_loop(work, monkeypatch)


def test_a_wait_ends_with_the_report_of_a_vehicle_that_flies_faster_than_predicted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def work() -> None:
        fleet = Fleet(0.0, 0.0)
        await reporting(fleet, fleet.run(2.0))
        end_s = fleet.time.sure_s() + 0.3
        fleet.began_s -= 0.4
        fleet.loop.call_later(0.01, fleet.hear)
        began_s = fleet.loop.time()
        await fleet.time.comes_to(end_s)
        assert fleet.loop.time() - began_s == pytest.approx(0.01, abs=1e-3)

    on_a_loop(work, monkeypatch)


def test_a_wait_for_vehicles_that_all_fell_silent_ends_with_a_word(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their time stands then: an order that waits by it would never end, nor the landing that waits for the order."""

    async def work() -> None:
        fleet = Fleet(0.0, 0.0)
        began_s = fleet.loop.time()

        async def fall_silent() -> None:
            await asyncio.sleep(8.0)
            fleet.silent |= {1, 2}

        silence = asyncio.ensure_future(fall_silent())
        fleet.hear()
        with pytest.raises(PeerTimeout, match=r"^no vehicle has reported its time for 10 s"):
            await reporting(fleet, fleet.time.until(fleet.time.sure_s() + 60.0))
        assert fleet.loop.time() - began_s == pytest.approx(18.0, abs=1.0)
        await silence

    on_a_loop(work, monkeypatch)


def test_clocks_that_agree_need_no_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        fleet = Fleet(0.0, 0.9 * AGREE_S, 0.0)
        fleet.hear()
        began_s = fleet.loop.time()
        assert await fleet.time.settle() == {}
        await fleet.time.agree()
        assert fleet.loop.time() == began_s

    on_a_loop(work, monkeypatch)


def test_clocks_that_never_agree_are_named_after_three_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        fleet = Fleet(0.0, 20.0, 0.0, -7.0, 0.0)
        fleet.hear()

        async def settle() -> None:
            began_s = fleet.loop.time()
            off_s = await fleet.time.settle()
            assert off_s == pytest.approx({2: 20.0, 4: -7.0}, abs=0.05)
            assert PATIENCE_S <= fleet.loop.time() - began_s < PATIENCE_S + 2.0 * LOOK_S
            with pytest.raises(FlightError) as caught:
                await fleet.time.agree()
            assert caught.value.message == (
                "the vehicles' GNSS times differ: that of vehicle 2 is off by +20.0 s, "
                "that of vehicle 4 is off by -7.0 s."
            )
            assert (
                caught.value.hint
                == "wait until the vehicle's receiver has the right time, or restart it, then fly again"
            )

        await reporting(fleet, settle())

    on_a_loop(work, monkeypatch)


def test_a_clock_that_is_set_right_meanwhile_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        fleet = Fleet(0.0, 20.0, 0.0)
        fleet.hear()
        fleet.loop.call_later(1.0, setattr, fleet.vehicles[2], "ahead_s", 0.0)

        async def agree() -> None:
            began_s = fleet.loop.time()
            await fleet.time.agree()
            assert 1.0 <= fleet.loop.time() - began_s < PATIENCE_S

        await reporting(fleet, agree())

    on_a_loop(work, monkeypatch)


@pytest.mark.parametrize(
    ("mean_s", "rate", "named"), [(2.0, 1.0, True), (3.0, 1.0, False), (0.4, 10.0, False), (None, 1.0, True)]
)
def test_a_slow_link_explains_a_difference_in_vehicle_time(
    mean_s: float | None, rate: float, named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A clock 3.9 s off: 1 s is always allowed, and the slowest round trip at the vehicles' rate on top."""

    async def work() -> None:
        fleet = Fleet(0.0, 3.9, 0.0, rate=rate)
        fleet.vehicles[3].round_trip.mean_s = mean_s
        await reporting(fleet, fleet.run(2.0))
        assert list(await reporting(fleet, fleet.time.settle())) == ([2] if named else [])
        fleet.time.hold()
        set_right = abs(cast(float, fleet.vehicles[2].clock.now_unix_s(fleet.loop.time())) - fleet.true_s) < 0.2 * rate
        assert set_right == named

    on_a_loop(work, monkeypatch)


@pytest.mark.parametrize("mean_s", [None, 0.0])
def test_a_link_of_unknown_delay_explains_nothing(mean_s: float | None, monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        fleet = Fleet(0.0, 1.5, 0.0)
        for vehicle in fleet.vehicles.values():
            vehicle.round_trip.mean_s = mean_s
        await reporting(fleet, fleet.run(2.0))
        assert list(await reporting(fleet, fleet.time.settle())) == [2]

    on_a_loop(work, monkeypatch)


@pytest.mark.parametrize(("ahead_s", "set_right"), [(2.5, False), (3.5, True)])
def test_a_slow_link_explains_the_time_of_a_vehicle_that_restarted(
    ahead_s: float, set_right: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A round trip of 2 s hides 2 s, and 1 s is always allowed: 2.5 s may be the link's, 3.5 s are the clock's."""

    async def work() -> None:
        fleet = Fleet(0.0, 0.0, 0.0)
        fleet.vehicles[3].round_trip.mean_s = 2.0
        await reporting(fleet, fleet.run(30.0))
        fleet.time.hold()
        assert fleet.time.changes() == []
        fleet.vehicles[2].boot_s, fleet.vehicles[2].ahead_s = -25.0, ahead_s
        await reporting(fleet, fleet.run(2.0))
        assert fleet.vehicles[2].clock.restarts == 1
        fleet.time.changes()
        shown_s = cast(float, fleet.vehicles[2].clock.now_unix_s(fleet.loop.time()))
        assert shown_s - fleet.true_s == pytest.approx(0.0 if set_right else ahead_s, abs=0.15)

    on_a_loop(work, monkeypatch)


@pytest.mark.parametrize("ahead_s", [(), (0.0,)], ids=["no vehicle", "none that counts"])
def test_without_vehicles_there_is_no_time_and_nothing_changes(
    ahead_s: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def work() -> None:
        fleet = Fleet(*ahead_s, sysids=(9,))
        fleet.hear()
        fleet.time.hold()
        assert fleet.time.now_s() is None
        assert fleet.time.changes() == []
        assert await fleet.time.settle() == {}

    on_a_loop(work, monkeypatch)


def test_only_those_that_count_are_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        fleet = Fleet(500.0, 0.0, 0.0, sysids=(2, 3, 9))
        fleet.hear()
        assert await fleet.time.settle() == {}
        assert fleet.time.sure_s() == pytest.approx(fleet.true_s, abs=1e-3)

    on_a_loop(work, monkeypatch)


def test_a_jump_of_held_clocks_is_told_once_and_refuses_missions(monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        fleet = Fleet(0.0, 0.0, 0.0)
        await reporting(fleet, fleet.run(3.0))
        assert fleet.time.changes() == []
        fleet.time.hold()
        fleet.time.refuse_jumped()
        fleet.vehicles[2].ahead_s = 30.0

        async def look() -> list[tuple[int, str, float]]:
            found = []
            for _ in range(200):
                await asyncio.sleep(EVERY_S)
                found += [(change.sysid, change.rule, change.off_s) for change in fleet.time.changes()]
            return found

        ((sysid, rule, off_s),) = await reporting(fleet, look())
        assert (sysid, rule) == (2, "GNSS time more than 0.5 s off is not followed")
        assert off_s == pytest.approx(30.0, abs=0.1)
        with pytest.raises(FlightError) as caught:
            fleet.time.refuse_jumped()
        assert caught.value.message == (
            "missions cannot start together: that of vehicle 2 is off by +30.0 s, and a mission waits by GNSS time."
        )
        assert caught.value.hint == "fly with --mode stream, in which vehicles fly by their boot clocks"

    on_a_loop(work, monkeypatch)


def test_the_start_is_watched_until_it_and_no_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    async def work() -> None:
        fleet = Fleet(0.0, 0.0, 0.0)
        await reporting(fleet, fleet.run(3.0))
        fleet.time.hold()

        async def watch(ahead_s: float, jump_s: float) -> None:
            start_s = fleet.true_s + ahead_s
            fleet.loop.call_later(jump_s, setattr, fleet.vehicles[1], "ahead_s", 30.0)
            await asyncio.wait_for(fleet.time.watch_start(start_s), 20.0)

        with pytest.raises(TimeoutError):
            await reporting(fleet, watch(5.0, 6.0))  # after the start it is no reason to stop
        fleet.vehicles[1].ahead_s = 0.0
        await reporting(fleet, fleet.run(10.0))
        with pytest.raises(FlightError, match="vehicle 1 is off by"):
            await reporting(fleet, watch(15.0, 0.5))

    on_a_loop(work, monkeypatch)
