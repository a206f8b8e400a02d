"""The common time of a fleet: the latest GNSS time on board of any vehicle."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from gcs.errors import FlightError
from gcs.link.session.vehicle_session import VehicleSession
from gcs.steady_loop import host_s

_PUMP_S = 0.002


class FleetTime:
    """The common time of vehicles, which may run faster than the wall clock."""

    def __init__(self, sessions: Mapping[int, VehicleSession]) -> None:
        self._sessions = sessions
        self._loop = asyncio.get_running_loop()

    def now_s(self) -> float | None:
        """Return GNSS unix time; None before the first report. It stands while no vehicle reports."""
        now_s = host_s(self._loop)
        known = (s.clock.now_unix_s(now_s) for s in self._sessions.values())
        return max((t for t in known if t is not None), default=None)

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
