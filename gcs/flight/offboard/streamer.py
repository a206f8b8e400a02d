"""The streaming part of a flight: every vehicle gets its setpoints, all timed from one T0.

Knows: schedule, courses, sessions, the event loop. Does not know: take-off, landing, what to do when things fail.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping
from contextlib import suppress

import numpy as np

from gcs.aio import each, sleep_sharply
from gcs.flight.contingency.manoeuvres import RejoinReference
from gcs.flight.monitor import VehicleView
from gcs.flight.offboard.deadlines import Grid, Scheduler
from gcs.flight.offboard.leader_follower import FollowReference, LeaderDeviation
from gcs.flight.offboard.reference_trajectory import PlanReference, ReferenceTrajectory
from gcs.flight.offboard.setpoint_messages import Streamed, numbered_message, send_due, wait_s
from gcs.flight.options import FlightMode, FlightOptions
from gcs.flight.sequence.fleet_time import FleetTime
from gcs.flight.sequence.takeoff_landing import FlightVehicle, set_mode
from gcs.link.microservices.command import CommandRefused
from gcs.link.wire.message import Message
from gcs.mission.model import SetpointStream
from gcs.plan.trajectory.plan import Plan

_LONGEST_WAIT_S = 0.05
# Emulated time at any speed may have run on since it was last heard of: look often, and send what it may still need.
_EMULATED_WAIT_S, _EMULATED_KEEP_S = 0.002, 0.5
_AHEAD_S = 0.5  # between the decision to start and the first setpoint
_EMULATED_AHEAD_S = 3.0  # ten times as fast, and on a machine that has other things to do
_EMULATED_SOON_S = 0.6
_NEVER_S = 1e6


class Streamer:
    """Streams to the vehicles of `crews` (by system id). `vehicles` holds who is streamed to, and what."""

    def __init__(
        self,
        plan: Plan,
        stream: SetpointStream,
        crews: Mapping[int, FlightVehicle],
        time: FleetTime,
        options: FlightOptions,
    ) -> None:
        self.vehicles: dict[int, Streamed] = {
            crew.sysid: Streamed(
                crew.session.station, crew.session.clock, plan.pads_ned_m[crew.row], PlanReference(stream, crew.row)
            )
            for crew in crews.values()
        }
        self.scheduler: Scheduler | None = None
        self._plan = plan
        self._crews = crews
        self._time = time
        self._options = options
        self._stream = stream
        self._leader: LeaderDeviation | None = None
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
                await asyncio.sleep(_EMULATED_WAIT_S)
            else:
                await self._turn(self.scheduler)

    async def begin(self) -> float:
        """Have everybody obey setpoints, and let the plan's stream begin for all at once; returns T0.

        T0 is chosen when the last one has said that it obeys, so nobody can be late. `run` must go on beside it.
        Raises PeerError.
        """
        if any(crew.behaviour.stream_first_s for crew in self._crews.values()):
            self._schedule(self._time.sure_s() + _NEVER_S, ends=False)
        await each(self._crews.values(), self._switch)
        first_s = float(self._stream.t_s[0])
        ahead_s = _EMULATED_AHEAD_S if self._emulated else _AHEAD_S
        t0_unix_s = math.ceil(self._time.sure_s() + self._options.lead_s + ahead_s) - first_s
        if self._options.follow:
            self._let_follow(t0_unix_s)
        self._schedule(t0_unix_s, ends=True)
        if self._emulated:
            self._announce()
        return t0_unix_s

    def _announce(self) -> None:
        """Tell everybody what is next now: from its instant on, emulated time waits for the ones that follow."""
        assert self.scheduler is not None
        for sysid in self.scheduler.streams:
            if (first := self.scheduler.advance(sysid)) is not None:
                message = numbered_message(self.scheduler, self.vehicles[sysid], first)
                if message is not None:
                    self._send(sysid, message)

    async def take_over(self, crew: FlightVehicle, course: ReferenceTrajectory) -> None:
        """Have one vehicle fly this course from now on, whatever it flies now. Raises as switching modes does."""
        assert self.scheduler is not None
        self.vehicles[crew.sysid].course = course
        if crew.sysid not in self.scheduler.streams or self.scheduler.streams[crew.sysid].finished:
            now_s = self._time.sure_s() - self.scheduler.t0_unix_s
            self.scheduler.start(crew.sysid, self.scheduler.grid.ahead_of(now_s), None)
        self.scheduler.streams[crew.sysid].end = None
        await self._switch(crew)

    def go_on(self, t_s: float, fade_s: float | None) -> float:
        """Have the plan go on a second from now with its instant `t_s`, from where everybody is; returns T0.

        With `fade_s` everybody is streamed to at once, and in its place after that time.
        """
        t0_unix_s = self._time.sure_s() + self._options.lead_s + 1.0 - t_s
        self.scheduler = self._scheduler(t0_unix_s)
        if fade_s is not None:
            if self._options.follow:
                self._let_follow(t0_unix_s)
            for crew in self._crews.values():
                base = self.vehicles[crew.sysid].course
                values = base.at(self.scheduler.grid.ahead_of(t_s), t_s)
                if values is not None:
                    off_m = crew.view.position_ned_m - np.array(values[:3])
                    off_mps = crew.view.velocity_ned_mps - np.array(values[3:6])
                    course = RejoinReference(base, off_m, off_mps, t_s, fade_s)
                    self.vehicles[crew.sysid].course = course
                now_s = self._time.sure_s() - t0_unix_s
                end = None if crew.behaviour.stream_first_s else len(self._stream.t_s)
                self.scheduler.start(crew.sysid, self.scheduler.grid.ahead_of(now_s), end)
        return t0_unix_s

    async def obey(self, crew: FlightVehicle) -> None:
        """Have it obey setpoints, if it does not. Raises as switching modes does."""
        await self._switch(crew)

    def rejoin(self, crew: FlightVehicle, view: VehicleView, begin_s: float, fade_s: float) -> None:
        """Have a vehicle go on with its course from where it is, and be on it in `fade_s`."""
        assert self.scheduler is not None
        vehicle, t0_unix_s = self.vehicles[crew.sysid], self.scheduler.t0_unix_s
        base = vehicle.course.base if isinstance(vehicle.course, RejoinReference) else vehicle.course
        seen_s = view.unix_s - t0_unix_s
        values = base.at(self.scheduler.grid.ahead_of(seen_s) - 1, seen_s)
        if values is not None:
            off_m = view.position_ned_m - np.array(values[:3])
            vehicle.course = RejoinReference(
                base, off_m, view.velocity_ned_mps - np.array(values[3:6]), begin_s, fade_s
            )

    def leave(self, sysid: int) -> None:
        """Send it nothing any more."""
        if self.scheduler is not None:
            self.scheduler.stop(sysid)

    def stand_by(self, t0_unix_s: float) -> None:
        """Vehicles fly on their own, by the plan's clock; be ready to take over."""
        self.scheduler = self._scheduler(t0_unix_s)

    def promote(self, sysid: int, begin_s: float, fade_s: float) -> None:
        """From plan time `begin_s` on this one leads: it goes back to the plan in `fade_s`, the others follow it."""
        leader = self._leader
        if leader is None:
            return
        leader.advance(begin_s)
        timed = PlanReference(self._stream, self._crews[sysid].row)
        self.vehicles[sysid].course = RejoinReference(timed, leader.position_m, leader.velocity_mps, begin_s, fade_s)
        leader.lead(self._crews[sysid].view)

    def _let_follow(self, t0_unix_s: float) -> None:
        sysid = self._plan.sysids[self._plan.leader]
        self._leader = LeaderDeviation(self._plan, t0_unix_s)
        self._leader.lead(self._crews[sysid].view)
        for crew in self._crews.values():
            if crew.sysid != sysid:
                timed = PlanReference(self._stream, crew.row)
                self.vehicles[crew.sysid].course = FollowReference(timed, self._leader, len(self._stream.t_s) - 1)

    def _schedule(self, t0_unix_s: float, *, ends: bool) -> None:
        """Stream from now on: points before the first one are the first one, at rest."""
        self.scheduler = self._scheduler(t0_unix_s)
        grid = self.scheduler.grid
        for crew in self._crews.values():
            if crew.behaviour.stream_first_s:  # it needs a stream to stay in its mode, until it lands
                soon_s = _EMULATED_SOON_S if self._emulated else 0.0
                self.scheduler.start(crew.sysid, grid.ahead_of(self._time.sure_s() + soon_s - t0_unix_s), None)
            elif ends:
                self.scheduler.start(crew.sysid, 0, len(grid.t_s))

    def _scheduler(self, t0_unix_s: float) -> Scheduler:
        grid = Grid.of(self._stream.t_s, self._plan.scenario.mission.setpoint_rate_hz)
        keep_s = _EMULATED_KEEP_S if self._emulated else 0.0
        # Who goes by the stamp needs no such help.
        lags_s = {} if self._emulated else {crew.sysid: crew.behaviour.lag_s for crew in self._crews.values()}
        return Scheduler(grid, t0_unix_s, lead_s=self._options.lead_s, keep_s=keep_s, lags_s=lags_s)

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

    async def _switch(self, crew: FlightVehicle) -> None:
        """To the mode that obeys setpoints, where need be once they have come for long enough."""
        if crew.session.custom_mode == crew.behaviour.guided and crew.options.mode is FlightMode.STREAM:
            return
        end_s = self._loop.time() + crew.options.phase_timeout_s
        while True:
            await self._time.until(self._time.sure_s() + crew.behaviour.stream_first_s)
            try:
                await set_mode(crew, crew.behaviour.guided)
                return
            except CommandRefused:  # a gap in the stream
                if self._loop.time() > end_s:
                    raise
