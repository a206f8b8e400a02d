"""The common time of a fleet on the event loop's clock: `gcs.flight.clocks.fleet_clock` without waits."""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Mapping

from gcs.aio import LOOK_S
from gcs.errors import FlightError
from gcs.flight.clocks.fleet_clock import ClockChange, FleetClock, disagreeing
from gcs.link.microservices.clock import VehicleClock
from gcs.link.session.vehicle_session import VehicleSession
from gcs.steady_loop import host_s

_PUMP_S = 0.002
_SETTLE_S = 3.0  # local time in which clocks may still come to agree


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
        """Wait until this time."""
        while self.sure_s() < unix_s:
            await asyncio.sleep(_PUMP_S)

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
