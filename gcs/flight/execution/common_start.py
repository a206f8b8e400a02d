"""The common start of missions on board: the GNSS second at which all vehicles leave the hover.

NAV_DELAY until a time of day is an item of the mission, so the upload needs a start before the take-off is over. That
start is provisional and late. Once all vehicles hover, an early start replaces it: this one item is rewritten on every
vehicle and read back; a later one does where upload and take-off took too long for the provisional one. All vehicles
have the same start before one of them is ordered to fly its mission: if the new one is not verified on every vehicle in
time, all get the provisional one back.
"""

import asyncio
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime

from gcs.errors import FlightError, GcsError
from gcs.flight.monitoring.fleet_time import FleetTime
from gcs.link.session.upload_fleet import Holdings, ItemChanger, change_items
from gcs.link.session.vehicle_load import VehicleLoad
from gcs.mission.waypoints.mission_items import starting_at, timed_waits
from gcs.util.aio import ended

AHEAD_S = 8.0  # of vehicle time, from the hover to the start; a second attempt gets more
LOCAL_S = 1.0  # ... but at least so much local time: emulated vehicles may be faster than the clock
ORDER_S = 3.0  # before the start, for the order to fly the missions
_TRIES = 2


class CommonStart:
    """The start of one flight. `loads` and `held` are those of the last verified start, `unix_s` is that start."""

    def __init__(
        self, sessions: Mapping[int, ItemChanger], time: FleetTime, loads: Sequence[VehicleLoad], ahead_s: float
    ) -> None:
        """Choose the provisional start, `ahead_s` from now."""
        self._sessions = sessions
        self._time = time
        self._loop = asyncio.get_running_loop()
        self._began_s = (self._loop.time(), time.sure_s())
        self.unix_s = math.ceil(self._began_s[1] + ahead_s)
        self.loads = _starting(loads, self.unix_s)
        self._indices = {load.sysid: timed_waits(load.mission) for load in self.loads}

    async def bring_forward(self, held: Holdings) -> tuple[Holdings, str]:
        """Replace the provisional start, on all vehicles or on none; return the proof, and the start in words.

        The new one is earlier, or later than a provisional one that cannot be kept any more.

        Raises FlightError if it is unknown which start a vehicle has on board.
        """
        ahead_s, reason = max(AHEAD_S, LOCAL_S * self._rate()), ""
        for _ in range(_TRIES):
            now_s = self._time.sure_s()
            start_s = math.ceil(now_s + ahead_s)
            if now_s + ORDER_S < self.unix_s <= start_s:
                break
            loads = _starting(self.loads, start_s)
            try:
                held = await self._change(held, loads, start_s - ORDER_S)
            except GcsError as failure:
                reason = failure.message
            else:
                self.loads, self.unix_s = loads, start_s
                return held, f"start their missions at {_clock(start_s)} UTC, {start_s - now_s:.0f} s after all hovered"
            ahead_s = max(AHEAD_S, 1.5 * (self._time.sure_s() - now_s) + ORDER_S)
        if reason:
            held = await self._set_back(held, reason)
        wait_s = self.unix_s - self._time.sure_s()
        return held, f"keep their start at {_clock(self.unix_s)} UTC, in {wait_s:.0f} s{': ' if reason else ''}{reason}"

    def refuse_missed(self) -> None:
        """Raise FlightError after the start: a mission that is ordered then flies late."""
        late_s = self._time.sure_s() - self.unix_s
        if late_s > 0:
            raise FlightError(
                f"the common start was missed by {late_s:.1f} s: not all vehicles were airborne in time.",
                hint="fly again; a slow link needs more time between upload and start",
            )

    async def _change(
        self, held: Holdings, loads: Sequence[VehicleLoad], until_s: float, *, look_first: bool = False
    ) -> Holdings:
        changing = change_items(self._sessions, held, loads, self._indices, look_first=look_first)
        work = asyncio.ensure_future(changing)
        limit = asyncio.ensure_future(self._time.until(until_s))
        try:
            await asyncio.wait({work, limit}, return_when=asyncio.FIRST_COMPLETED)
            if work.done() and self._time.sure_s() < until_s:
                return work.result()
        finally:
            await ended(work, limit)
        raise FlightError("another start was not verified on every vehicle in time.")

    async def _set_back(self, held: Holdings, reason: str) -> Holdings:
        try:
            return await self._change(held, self.loads, self.unix_s - ORDER_S, look_first=True)
        except GcsError as failure:
            raise FlightError(
                f"it is unknown at what time each mission would start. {reason} Then {failure.message}",
                hint="the vehicles were ordered to land; check the links, then fly again",
            ) from failure

    def _rate(self) -> float:
        local_s = self._loop.time() - self._began_s[0]
        return (self._time.sure_s() - self._began_s[1]) / local_s if local_s > 0.0 else 1.0


def _starting(loads: Sequence[VehicleLoad], unix_s: int) -> tuple[VehicleLoad, ...]:
    return tuple(replace(load, mission=starting_at(load.mission, unix_s)) for load in loads)


def _clock(unix_s: float) -> str:
    return f"{datetime.fromtimestamp(unix_s, UTC):%H:%M:%S}"
