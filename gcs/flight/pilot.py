"""The streaming part of a flight: every vehicle gets its setpoints, all timed from one T0.

Knows: schedule, courses, sessions, the event loop. Does not know: take-off, landing, what to do when things fail.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping
from contextlib import suppress

from gcs.flight.courses import TimedCourse
from gcs.flight.fleet_time import FleetTime
from gcs.flight.options import FlightOptions
from gcs.flight.prologue import Crew, set_mode
from gcs.flight.schedule import Grid, Scheduler
from gcs.flight.stream import Streamed, send_due, wait_s
from gcs.flight.together import each, sleep_sharply
from gcs.link.command import CommandRefused
from gcs.link.message import Message
from gcs.mission.model import SetpointStream
from gcs.plan.trajectory import Plan

_LONGEST_WAIT_S = 0.05
# Emulated time at any speed may have run on since it was last heard of: look often, and send what it may still need.
_EMULATED_WAIT_S, _EMULATED_KEEP_S = 0.002, 0.5
_AHEAD_S = 0.5  # between the decision to start and the first setpoint
_NEVER_S = 1e6


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

    async def run(self) -> None:
        """Send what is due until cancelled."""
        while True:
            if self.scheduler is None:
                await asyncio.sleep(_LONGEST_WAIT_S)
            else:
                await self._turn(self.scheduler)

    async def begin(self) -> float:
        """Have everybody obey setpoints, and let the plan's stream begin for all at once; returns T0.

        T0 is chosen when the last one has said that it obeys, so nobody can be late. `run` must go on beside it.
        Raises PeerError.
        """
        if any(crew.manners.stream_first_s for crew in self._crews.values()):
            self._schedule(self._time.sure_s() + _NEVER_S, ends=False)
        await each(self._crews.values(), self._switch)
        first_s = float(self._stream.t_s[0])
        t0_unix_s = math.ceil(self._time.sure_s() + self._options.lead_s + _AHEAD_S) - first_s
        self._schedule(t0_unix_s, ends=True)
        return t0_unix_s

    def _schedule(self, t0_unix_s: float, *, ends: bool) -> None:
        """Stream from now on: points before the first one are the first one, at rest."""
        grid = Grid.of(self._stream.t_s, self._plan.scenario.mission.setpoint_rate_hz)
        keep_s = _EMULATED_KEEP_S if self._emulated else 0.0
        self.scheduler = Scheduler(grid, t0_unix_s, lead_s=self._options.lead_s, keep_s=keep_s)
        for crew in self._crews.values():
            if crew.manners.stream_first_s:  # it needs a stream to stay in its mode, until it lands
                self.scheduler.start(crew.sysid, grid.ahead_of(self._time.sure_s() - t0_unix_s), None)
            elif ends:
                self.scheduler.start(crew.sysid, 0, len(grid.t_s))

    async def _turn(self, scheduler: Scheduler) -> None:
        """Send what is due, and wait for what is next."""
        send_due(scheduler, self.vehicles.values(), self._send, self._loop.time())
        longest_s = _EMULATED_WAIT_S if self._emulated else _LONGEST_WAIT_S
        pause_s = wait_s(scheduler, self.vehicles.values(), self._loop.time(), longest_s)
        if not self._emulated:
            await sleep_sharply(pause_s)
            return
        self._woken.clear()
        with suppress(TimeoutError):
            async with asyncio.timeout(pause_s):  # wait_for may swallow being cancelled
                await self._woken.wait()

    def _send(self, sysid: int, message: Message) -> None:
        self._crews[sysid].session.send(message)

    async def _switch(self, crew: Crew) -> None:
        """To the mode that obeys setpoints, where need be once they have come for long enough."""
        if crew.session.custom_mode == crew.manners.guided:
            return
        end_s = self._loop.time() + crew.options.phase_timeout_s
        while True:
            await self._time.until(self._time.sure_s() + crew.manners.stream_first_s)
            try:
                await set_mode(crew, crew.manners.guided)
                return
            except CommandRefused:  # a gap in the stream
                if self._loop.time() > end_s:
                    raise
