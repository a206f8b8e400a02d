"""What time it is for a whole fleet: GNSS time on board of whoever is furthest ahead.

Knows: every vehicle's clock, the event loop's time. Does not know: plans.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from gcs.errors import FlightError
from gcs.link.session.vehicle_session import VehicleSession

_PUMP_S = 0.002


class FleetTime:
    """The common time of vehicles that may run faster than the wall's clock."""

    def __init__(self, sessions: Mapping[int, VehicleSession]) -> None:
        self._sessions = sessions
        self._loop = asyncio.get_running_loop()

    def now_s(self) -> float | None:
        """GNSS unix time; None before anybody told it. It stands still when nobody reports any more."""
        now_s = self._loop.time()
        known = (s.clock.now_unix_s(now_s) for s in self._sessions.values())
        return max((t for t in known if t is not None), default=None)

    def sure_s(self) -> float:
        """The same where it must be known. Raises FlightError."""
        now_s = self.now_s()
        if now_s is None:
            raise FlightError("the vehicles' clocks were lost in flight.")
        return now_s

    async def until(self, unix_s: float) -> None:
        """Wait for an instant."""
        while self.sure_s() < unix_s:
            await asyncio.sleep(_PUMP_S)
