"""The common unix time of a fleet: `FleetClock` makes it from the vehicles' clocks, `FleetTime` waits for it.

Most clocks agree: the latest of those around the median counts, because a link delays reports and never hastens them.
Without a majority, the clocks count that are nearest to the fleet's own time: the last common time, continued on the
ground's steady clock at the rate of the vehicles' boot clocks. That rate is 1 for real vehicles; emulated ones may be
faster.

Once the clocks are held, every vehicle flies by its boot clock, and a jump of its GNSS time is reported, not followed.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from statistics import median

from gcs.errors import FlightError, PeerTimeout
from gcs.link.protocols.clock import JUMP_S, VehicleClock
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.message import Message
from gcs.util.aio import LOOK_S, set_within
from gcs.util.steady_loop import host_s

_SOON_S = 0.002  # no wait is shorter
SILENT_S = 10.0  # local time
_SETTLE_S = 3.0  # local time in which clocks may still come to agree
AGREE_S = 1.0  # simulators of ArduPilot differ by up to 0.6 s from their median


class FleetTime:
    """The common time of vehicles, which may run faster than the wall clock."""

    def __init__(self, sessions: Mapping[int, VehicleSession], sysids: Collection[int] | None = None) -> None:
        """`sysids`: the vehicles that count, all by default; other sessions have no say."""
        self._sessions = sessions
        self._sysids = sysids
        self._loop = asyncio.get_running_loop()
        self._clock = FleetClock()

    def now_s(self) -> float | None:
        """Return unix time; None before the first report. It stands while no vehicle reports."""
        return self._clock.unix_s(self._clocks(), host_s(self._loop))

    def sure_s(self) -> float:
        """Return the same once it must be known. Raises FlightError."""
        now_s = self.now_s()
        if now_s is None:
            raise FlightError("the vehicles' clocks were lost in flight.")
        return now_s

    async def until(self, unix_s: float) -> None:
        """Wait until this time. Raises `PeerTimeout` if it stands, because no vehicle reports for `SILENT_S`."""
        newest_s, reported_s = -math.inf, self._loop.time()
        while self.sure_s() < unix_s:
            await self.comes_to(unix_s)
            heard_s = max((clock.heard_unix_s for clock in self._clocks().values()), default=-math.inf)
            if heard_s > newest_s:
                newest_s, reported_s = heard_s, self._loop.time()
            elif self._loop.time() - reported_s > SILENT_S:
                raise PeerTimeout(f"no vehicle has reported its time for {SILENT_S:g} s: nothing can be timed by it.")

    async def comes_to(self, unix_s: float) -> None:
        """Wait until this time may have come: a vehicle has reported it, or it is predicted; `LOOK_S` at most.

        After that time, wait for the next report of any vehicle.
        """
        came = asyncio.Event()
        clocks = self._clocks()

        def heard(sysid: int, _: Message) -> None:
            if clocks[sysid].heard_unix_s >= unix_s:
                came.set()

        stops = [self._sessions[sysid].subscribe(partial(heard, sysid)) for sysid in clocks]
        try:
            now_s = self.now_s()
            left_s = math.inf if now_s is None or now_s >= unix_s else unix_s - now_s
            rate = max([1.0, *(clock.rate for clock in clocks.values())])
            await set_within(came, min(max(left_s / rate, _SOON_S), LOOK_S))
        finally:
            for stop in stops:
                stop()

    def hold(self) -> None:
        """From now on every vehicle flies by its boot clock, and jumps of GNSS time are `changes`."""
        self._clock.hold(self._clocks(), host_s(self._loop), self._delay_s())

    def changes(self) -> list[ClockChange]:
        """Return what has happened to the vehicles' clocks since the last call."""
        return self._clock.changes(self._clocks(), host_s(self._loop), self._delay_s())

    async def settle(self) -> dict[int, float]:
        """Wait a little until the vehicles' GNSS times agree. Return those that still differ, and by how much."""
        end_s = self._loop.time() + _SETTLE_S
        while (off := disagreeing(self._clocks(), host_s(self._loop), self._delay_s())) and self._loop.time() < end_s:
            await asyncio.sleep(LOOK_S)
        return off

    async def agree(self) -> None:
        """Return once the vehicles' GNSS times agree. Raises FlightError that names those that differ."""
        off = await self.settle()
        if off:
            raise FlightError(
                f"the vehicles' GNSS times differ: {_off_words(off)}.",
                hint="wait until the vehicle's receiver has the right time, or restart it, then fly again",
            )

    def refuse_jumped(self) -> None:
        """Raises FlightError if a vehicle's GNSS time has jumped: its mission waits by that time."""
        clocks = self._clocks()
        off = {sysid: clock.gnss_off_s for sysid, clock in clocks.items() if clock.jumped}
        if off:
            raise FlightError(
                f"missions cannot start together: {_off_words(off)}, and a mission waits by GNSS time.",
                hint="fly with --mode stream, in which vehicles fly by their boot clocks",
            )

    async def watch_start(self, unix_s: float) -> None:
        """Until this time, raise as `refuse_jumped` does; then wait to be cancelled."""
        while self.sure_s() < unix_s:
            self.refuse_jumped()
            await asyncio.sleep(LOOK_S)
        await asyncio.Event().wait()

    def _clocks(self) -> dict[int, VehicleClock]:
        chosen = self._sessions if self._sysids is None else self._sysids
        return {sysid: self._sessions[sysid].clock for sysid in chosen if sysid in self._sessions}

    def _delay_s(self) -> float:
        """Vehicle time that the slowest link may hide."""
        slowest_s = max((s.round_trip.mean_s or 0.0 for s in self._sessions.values()), default=0.0)
        return slowest_s * max((clock.rate for clock in self._clocks().values()), default=1.0)


def _off_words(off_s: Mapping[int, float]) -> str:
    return ", ".join(f"that of vehicle {sysid} is off by {off:+.1f} s" for sysid, off in off_s.items())


@dataclass(frozen=True)
class ClockChange:
    """One vehicle's clock did something that the operator must know. `off_s` is its GNSS time minus its clock."""

    sysid: int
    what: str
    rule: str
    off_s: float


class FleetClock:
    """The common time of vehicles whose clocks may differ, stand, jump or begin anew."""

    def __init__(self) -> None:
        self._last_s: float | None = None  # common time, and the local time of it
        self._last_now_s = 0.0
        self._last_readings: list[tuple[float, bool] | None] = []  # of the clocks, at that local time
        self._held = False
        self._reported: dict[int, bool] = {}  # vehicles whose GNSS time had jumped when it was last looked at
        self._restarts: dict[int, int] = {}

    def unix_s(self, clocks: Mapping[int, VehicleClock], now_s: float) -> float | None:
        """Return the common time at local time `now_s`; None before the first report.

        It stands while no vehicle reports. Once the clocks are held it never runs back.
        """
        readings = [clock.reading(now_s) for clock in clocks.values()]
        if now_s == self._last_now_s and readings == self._last_readings:  # asked for every frame
            return self._last_s
        heard = [reading for reading in readings if reading is not None]
        known = [unix_s for unix_s, stands in heard if not stands] or [unix_s for unix_s, _ in heard]
        if not known:
            return self._last_s
        common_s = max(known)
        if common_s - min(known) > AGREE_S:  # else all agree
            common_s = common_time_s(known, self._expected_s(clocks, now_s))
        self._last_readings = readings
        if self._last_s is None or common_s > self._last_s or (not self._held and common_s < self._last_s - AGREE_S):
            self._last_s = common_s
        self._last_now_s = now_s
        return self._last_s

    def hold(self, clocks: Mapping[int, VehicleClock], now_s: float, delay_s: float = 0.0) -> None:
        """From now on every vehicle flies by its boot clock; one that disagrees with the others is set to their time.

        `delay_s` is what links may explain.
        """
        off_s = {} if self._held else disagreeing(clocks, now_s, delay_s)
        common_s = self.unix_s(clocks, now_s)
        self._held = True
        for sysid, clock in clocks.items():
            clock.hold()
            if sysid in off_s and common_s is not None:
                clock.set_unix_s(common_s, now_s)

    def changes(self, clocks: Mapping[int, VehicleClock], now_s: float, delay_s: float = 0.0) -> list[ClockChange]:
        """Return what has happened to held clocks since the last call, and set those right that began anew."""
        common_s = self.unix_s(clocks, now_s)
        if common_s is None or not self._held:
            return []
        found = []
        for sysid, clock in clocks.items():
            shown_s = clock.now_unix_s(now_s)
            if shown_s is None:
                continue
            if clock.restarts != self._restarts.setdefault(sysid, clock.restarts):
                self._restarts[sysid] = clock.restarts
                if abs(shown_s - common_s) > AGREE_S + delay_s:
                    clock.set_unix_s(common_s, now_s)
            elif clock.jumped and abs(shown_s - common_s) > AGREE_S >= abs(shown_s + clock.gnss_off_s - common_s):
                ahead_s = -clock.gnss_off_s
                clock.follow_gnss()
                what = f"has a boot clock that jumped by {ahead_s:+.1f} s: it flies by GNSS time"
                found.append(ClockChange(sysid, what, "its GNSS time agrees with the other vehicles", 0.0))
            reported, self._reported[sysid] = self._reported.get(sysid, False), clock.jumped
            if reported != clock.jumped:
                off_s, bound = clock.gnss_off_s, f"GNSS time {'more than' if clock.jumped else 'within'} {JUMP_S:g} s"
                what = "has a GNSS time that agrees with its boot clock again"
                if clock.jumped:
                    what = f"has a GNSS time that is off by {off_s:+.1f} s: it flies by its boot clock"
                rule = f"{bound} off is not followed" if clock.jumped else f"{bound} is followed"
                found.append(ClockChange(sysid, what, rule, off_s))
        return found

    def _expected_s(self, clocks: Mapping[int, VehicleClock], now_s: float) -> float | None:
        """The last common time, continued at the common rate of the boot clocks."""
        if self._last_s is None:
            return None
        return self._last_s + median(clock.rate for clock in clocks.values()) * (now_s - self._last_now_s)


def common_time_s(times_s: Iterable[float], expected_s: float | None) -> float:
    """Return the latest of the times around the median; without a majority, of those nearest to `expected_s`."""
    times = sorted(times_s)
    for middle_s in (median(times), expected_s):
        if middle_s is None:
            continue
        near = [t for t in times if abs(t - middle_s) <= AGREE_S]
        if 2 * len(near) > len(times):
            return near[-1]
    if expected_s is None:
        return times[-1]
    nearest_s = min(times, key=lambda t: abs(t - expected_s))
    return max(t for t in times if abs(t - nearest_s) <= AGREE_S)


def disagreeing(clocks: Mapping[int, VehicleClock], now_s: float, delay_s: float = 0.0) -> dict[int, float]:
    """Return the vehicles whose unix time is off that of the others, and by how much.

    Of two that differ it is unknown which is wrong: both are returned. `delay_s` is what links may explain.
    """
    return {sysid: off_s for sysid, off_s in differences_s(clocks, now_s).items() if abs(off_s) > AGREE_S + delay_s}


def differences_s(clocks: Mapping[int, VehicleClock], now_s: float) -> dict[int, float]:
    """Return by how much the unix time of each vehicle is off the median; of two vehicles, off the other's."""
    read = {sysid: clock.uncapped_unix_s(now_s) for sysid, clock in clocks.items()}
    times = {sysid: unix_s for sysid, unix_s in read.items() if unix_s is not None}
    found = {}
    for sysid, unix_s in times.items():
        others = [other_s for other, other_s in times.items() if other != sysid]
        if others:
            found[sysid] = unix_s - median(others if len(times) == 2 else times.values())
    return found
