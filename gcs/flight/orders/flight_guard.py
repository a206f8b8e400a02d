"""The one place where a flight ends early: whatever ended it, the vehicles in the air are ordered to land."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Mapping
from typing import Any, TypeVar

from gcs.aio import ended, insisted
from gcs.errors import GcsError
from gcs.flight.orders.fleet_landing import FleetLanding
from gcs.flight.progress import Step
from gcs.flight.sequence.link_watch import watch_links
from gcs.link.session.vehicle_session import VehicleSession

T = TypeVar("T")


class FlightGuard:
    """Runs a flight beside the watch of its links."""

    def __init__(
        self,
        sessions: Mapping[int, VehicleSession],
        landing: FleetLanding,
        step: Callable[[], Step],
        lost_after_s: float,
    ) -> None:
        self._sessions = sessions
        self._landing = landing
        self._step = step
        self._lost_after_s = lost_after_s

    async def run(self, flying: Coroutine[Any, Any, T]) -> T:
        """Return what `flying` returns; if it or the links fail, the vehicles land first."""
        watch = asyncio.ensure_future(watch_links(self._sessions, self._step, self._lost_after_s))
        work = asyncio.ensure_future(flying)
        try:
            done, _ = await asyncio.wait({watch, work}, return_when=asyncio.FIRST_COMPLETED)
            if watch in done:
                watch.result()
            return await work
        except (GcsError, asyncio.CancelledError) as stopped:
            work.cancel()
            self._landing.send_once(arming=self._step() is Step.TAKEOFF)  # before a second Ctrl-C can come in between
            await insisted(self._end_and_land(work))
            self._landing.raise_failed_orders(stopped)
            raise
        finally:
            await ended(watch)
            await self._landing.orders.close()

    async def _end_and_land(self, work: asyncio.Future[Any]) -> None:
        await ended(work)
        await self._landing.land_all(arming=self._step() is Step.TAKEOFF)
