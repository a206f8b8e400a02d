"""The streaming part of a flight: every vehicle gets its setpoints, all timed from one T0.

Knows: schedule, courses, sessions, the event loop. Does not know: take-off, landing, what to do when things fail.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from contextlib import suppress

from gcs.flight.courses import TimedCourse
from gcs.flight.fleet_time import FleetTime
from gcs.flight.options import FlightOptions
from gcs.flight.prologue import Crew, set_mode
from gcs.flight.schedule import Grid, Scheduler
from gcs.flight.stream import Streamed, due_messages, wait_s
from gcs.flight.together import each, ended
from gcs.mission.model import SetpointStream
from gcs.plan.trajectory import Plan

_LONGEST_WAIT_S = 0.05
# Emulated time at any speed may have run on since it was last heard of: look often, and send what it may still need.
_EMULATED_WAIT_S, _EMULATED_KEEP_S = 0.002, 0.5
_AHEAD_S = 0.5  # between the decision to start and the first setpoint


class Pilot:
    """Streams to the vehicles of `crews` (by system id). `vehicles` holds who is streamed to, and what."""

    def __init__(
        self,
        plan: Plan,
        stream: SetpointStream,
        crews: Mapping[int, Crew],
        time: FleetTime,
        options: FlightOptions,
    ) -> None:
        self.vehicles: dict[int, Streamed] = {
            crew.sysid: Streamed(
                crew.session.station, crew.session.clock, plan.pads_ned_m[crew.row], TimedCourse(stream, crew.row)
            )
            for crew in crews.values()
        }
        self.scheduler: Scheduler | None = None
        self._plan = plan
        self._crews = crews
        self._time = time
        self._options = options
        self._stream = stream
        self._emulated = options.lead_s > 0.0
        self._loop = asyncio.get_running_loop()
        self._woken = asyncio.Event()

    def wake(self) -> None:
        """Something came from a vehicle: its time may have run on."""
        if self._emulated:
            self._woken.set()

    def choose_t0(self) -> float:
        """T0 in whole seconds, near enough that nobody waits and far enough for everybody to be told."""
        first_s = max(self._first_s(crew) for crew in self._crews.values())
        begin_s = self._time.sure_s() + self._options.lead_s + _AHEAD_S
        return float(-(-(begin_s + first_s) // 1)) - float(self._stream.t_s[0])

    async def fly(self, t0_unix_s: float) -> None:
        """Stream until cancelled, at rest once the plan is over. Raises as switching modes does."""
        grid = Grid.of(self._stream.t_s, self._plan.scenario.mission.setpoint_rate_hz)
        keep_s = _EMULATED_KEEP_S if self._emulated else 0.0
        self.scheduler = Scheduler(grid, t0_unix_s, lead_s=self._options.lead_s, keep_s=keep_s)
        for crew in self._crews.values():
            before = round(self._first_s(crew) / grid.period_s)
            # Who needs a stream to stay in its mode gets one until it lands.
            end = None if crew.manners.stream_first_s else len(grid.t_s)
            self.scheduler.start(crew.sysid, -before, end)
        switching = asyncio.ensure_future(each(self._crews.values(), self._switch))
        try:
            while True:
                if switching.done():
                    switching.result()
                await self._turn()
        finally:
            await ended(switching)

    async def _turn(self) -> None:
        """Send what is due, and wait for what is next."""
        assert self.scheduler is not None
        now_s = self._loop.time()
        for sysid, vehicle in self.vehicles.items():
            session = self._crews[sysid].session
            for message in due_messages(self.scheduler, vehicle, now_s):
                session.send(message)
        longest_s = _EMULATED_WAIT_S if self._emulated else _LONGEST_WAIT_S
        pause_s = wait_s(self.scheduler, list(self.vehicles.values()), self._loop.time(), longest_s)
        if not self._emulated:
            await asyncio.sleep(pause_s)
            return
        self._woken.clear()
        with suppress(TimeoutError):
            await asyncio.wait_for(self._woken.wait(), pause_s)

    def _first_s(self, crew: Crew) -> float:
        """How long its first point is repeated before the stream begins."""
        return crew.manners.stream_first_s + crew.manners.switch_s

    async def _switch(self, crew: Crew) -> None:
        """To the mode that obeys setpoints, once they have come for long enough."""
        assert self.scheduler is not None
        manners, session = crew.manners, crew.session
        if session.custom_mode == manners.guided:
            return
        began_s = self.scheduler.t0_unix_s + float(self._stream.t_s[0]) - self._first_s(crew)
        await self._time.until(began_s + manners.stream_first_s)
        await set_mode(crew, manners.guided)
