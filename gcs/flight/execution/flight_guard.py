"""The one place where a flight ends early: whatever ended it, the vehicles in the air are ordered to land.

It watches the links beside the flight, which ends when vehicles are silent for too long, and reports own standstills.
"""

import asyncio
from collections.abc import Callable, Mapping
from contextlib import suppress

from gcs.errors import FlightError, GcsError, ProtocolMisuse
from gcs.flight.execution.fleet_landing import FleetLanding, named
from gcs.flight.monitoring.progress import OURSELVES, Step
from gcs.link.session.vehicle_session import VehicleSession
from gcs.util.aio import LOOK_S, T, Work, ended, insisted
from gcs.util.steady_loop import stalls_of

_ATTEMPTS = 5  # to land, each interrupted by a failure of its own
_PAUSE_S = 1.0
STOOD_RULE = "It was stopped, suspended or too busy; nothing counts as silence of vehicles for it"


class FlightGuard:
    """Runs a flight beside the watch of its links."""

    def __init__(
        self,
        sessions: Mapping[int, VehicleSession],
        landing: FleetLanding,
        step: Callable[[], Step],
        lost_after_s: float,
        report: Callable[[int, str, str], None],
        on_early_end: Callable[[str], None],
    ) -> None:
        """`on_early_end` gets the reason once the vehicles in the air have the order to land."""
        self._on_early_end = on_early_end
        self._sessions = sessions
        self._landing = landing
        self._step = step
        self._lost_after_s = lost_after_s
        self._report = report

    async def run(self, flying: Work[T]) -> T:
        """Return what `flying` returns. However it fails, and if the links fail, the vehicles land first.

        What ended the flight is raised afterwards. A vehicle that is not known to have landed is handed over by name.
        """
        watch = asyncio.ensure_future(self._watch_links())
        work = asyncio.ensure_future(flying)
        try:
            await asyncio.wait({watch, work}, return_when=asyncio.FIRST_COMPLETED)
            if watch.done():
                watch.result()
            result = await work
            if aloft := self._landing.aloft():
                raise ProtocolMisuse(f"the flight ended with armed vehicles: {', '.join(map(str, aloft))}.")
        except BaseException as stopped:
            await self._bring_down(watch, work, stopped)
            if isinstance(stopped, asyncio.CancelledError) and not _is_cancelled():
                raise ProtocolMisuse("a part of the flight was cancelled by itself.") from stopped
            if isinstance(stopped, GcsError | asyncio.CancelledError):
                self._landing.raise_failed_orders(stopped)
            raise
        finally:
            self._landing.custody.close()
            await ended(watch)
            await self._landing.orders.close()
        return result

    async def _bring_down(self, watch: asyncio.Future[None], work: asyncio.Future[T], stopped: BaseException) -> None:
        """Land the vehicles of this flight. Nothing that happens meanwhile ends this, but the landing itself."""
        work.cancel()
        self._landing.send_once()  # before a second Ctrl-C can come in between
        if self._landing.aloft():
            with suppress(Exception):  # what is told never keeps a vehicle in the air
                self._on_early_end(_reason(stopped))
        for attempt in range(_ATTEMPTS):
            try:
                await insisted(self._end_and_land(watch, work, attempt * _PAUSE_S))
            except BaseException as failure:
                self._report(0, "landing interrupted", f"{type(failure).__name__}: {failure}")
                self._landing.send_once()
            else:
                break
        self._landing.hand_over()

    async def _end_and_land(self, watch: asyncio.Future[None], work: asyncio.Future[T], pause_s: float) -> None:
        await asyncio.sleep(pause_s)
        await ended(watch, work)
        await self._landing.land_all()

    async def _watch_links(self) -> None:
        """Raises FlightError as soon as a vehicle has been silent for too long; in flight, as soon as all have.

        `report` gets each pause of this program once. In one no vehicle becomes silent: the loop's clock stands too.
        """
        stalls = stalls_of(asyncio.get_running_loop())
        reported = stalls.count
        while True:
            await asyncio.sleep(LOOK_S)
            if stalls.count > reported:
                reported = stalls.count
                self._report(OURSELVES, f"stood still for {stalls.last_s:.1f} s", STOOD_RULE)
            silent = {s.sysid: s.silent_s() for s in self._sessions.values()}
            lost = [sysid for sysid, silent_s in silent.items() if silent_s > self._lost_after_s]
            if self._step() in (Step.FLY, Step.LAND) and len(lost) < len(silent):
                continue  # the contingency policy handles this
            if lost:
                were = "was" if len(lost) == 1 else "were"
                raise FlightError(
                    f"{named(lost)} {were} lost ({self._step().value}): no message for {silent[lost[0]]:.1f} s.",
                    hint="check it and its link"
                    if self._step() in (Step.READY, Step.UPLOAD)
                    else "the others were ordered to land; search for it at its last reported position",
                )


def _reason(stopped: BaseException) -> str:
    if isinstance(stopped, asyncio.CancelledError):
        return "This program was stopped"
    return stopped.message if isinstance(stopped, GcsError) else f"{type(stopped).__name__}: {stopped}"


def _is_cancelled() -> bool:
    task = asyncio.current_task()
    return task is not None and task.cancelling() > 0
