"""Streams setpoints to every vehicle, all timed from one T0."""

import asyncio
import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from gcs.flight.contingency.choices import FlightMode
from gcs.flight.contingency.manoeuvres import (
    MotionReference,
    PlanReference,
    ReferenceTrajectory,
    RejoinReference,
    Values,
)
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.execution.leader_follower import FollowerState, FollowReference, FormationFollowing, LinkChange
from gcs.flight.execution.setpoint_schedule import Grid, Scheduler, Streamed, numbered_message, send_due, wait_s
from gcs.flight.execution.takeoff_landing import FlightVehicle, set_mode
from gcs.flight.monitoring.fleet_time import FleetTime
from gcs.link.protocols.command import CommandRefused
from gcs.link.wire.message import Message
from gcs.mission.export.setpoint_stream import spliced
from gcs.mission.model import SetpointStream
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array
from gcs.util.aio import each, set_within, sleep_sharply
from gcs.util.steady_loop import follows, host_s, stalls_of

_LONGEST_WAIT_S = 0.05
# Emulated time that is not shared may have advanced since the last report: check often, send what may be needed yet.
_EMULATED_WAIT_S, _EMULATED_KEEP_S = 0.002, 0.5
_AHEAD_S = 0.5  # between the decision to start and the first setpoint
_EMULATED_AHEAD_S = 3.0  # ten times as fast, and on a busy machine
_EMULATED_SOON_S = 0.6
_NEVER_S = 1e6
_PAUSE_S = 3.0
_REJOIN_S = 8.0


class Streamer:
    """Streams to the vehicles of `fleet` (by system id). `streamed` has the reference trajectory of each."""

    def __init__(
        self,
        plan: Plan,
        stream: SetpointStream,
        fleet: Mapping[int, FlightVehicle],
        time: FleetTime,
        options: FlightOptions,
    ) -> None:
        # Emulated vehicles wait for setpoints.
        unheard_s = 0.0 if options.lead_s > 0.0 else options.limits.vehicle_lost_s
        self._timed = {v.sysid: PlanReference(stream, v.row) for v in fleet.values()}
        self.streamed: dict[int, Streamed] = {
            v.sysid: Streamed(
                v.session.station,
                v.session.clock,
                v.view.frame,
                timed,
                unheard_s,
                time.now_s,
            )
            for v, timed in zip(fleet.values(), self._timed.values(), strict=True)
        }
        self.scheduler: Scheduler | None = None
        self._planned = {sysid: one.reference for sysid, one in self.streamed.items()}
        self._plan = plan
        self._fleet = fleet
        self._time = time
        self._options = options
        self._stream = stream
        self._following: FormationFollowing | None = None
        self._emulated = options.lead_s > 0.0
        self._loop = asyncio.get_running_loop()
        self._stalls = stalls_of(self._loop)
        self._stalls_seen = self._stalls.count
        self._woken = asyncio.Event()
        self._paused_until_s = -math.inf  # local time

    def wake(self) -> None:
        """Look for due setpoints now: a message may have advanced the vehicle's time. No effect on real vehicles."""
        if self._emulated:
            self._woken.set()

    async def run(self) -> None:
        """Send what is due until cancelled."""
        while True:
            self.pause_if_stalled()
            if self.scheduler is None or self.paused:
                await self._until_woken(_LONGEST_WAIT_S)
            else:
                await self._turn(self.scheduler)

    async def begin(self) -> float:
        """Switch all vehicles to obey setpoints, begin the plan's stream for all at once, and return T0.

        T0 is chosen when the last vehicle obeys setpoints, so none can be late. `run` must run beside it.
        Raises PeerError.
        """
        if any(vehicle.behaviour.stream_first_s for vehicle in self._fleet.values()):
            self._schedule(self._time.sure_s() + _NEVER_S, ends=False)
        await each(self._fleet.values(), self.enter_setpoint_mode)
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
        """Send all vehicles their first setpoint now: from its time on, emulated time waits for the next ones."""
        assert self.scheduler is not None
        for sysid in self.scheduler.streams:
            if (first := self.scheduler.advance(sysid)) is not None:
                message = numbered_message(self.scheduler, self.streamed[sysid], first)
                if message is not None:
                    self._send(sysid, message)

    async def take_over(self, vehicle: FlightVehicle, reference: ReferenceTrajectory) -> None:
        """Have one vehicle fly this reference from now on. Raises as switching modes does."""
        self.follow(vehicle, reference)
        await self.enter_setpoint_mode(vehicle)

    def pause_if_stalled(self) -> None:
        """After a pause of this program, send nothing until `resume`, or for `_PAUSE_S` at most.

        Until what has waited is read, the vehicles' clocks and positions are old.
        """
        if self._stalls.count > self._stalls_seen:
            self._stalls_seen = self._stalls.count
            self._paused_until_s = self._loop.time() + _PAUSE_S

    @property
    def paused(self) -> bool:
        """Whether what is due is not sent."""
        return self._loop.time() < self._paused_until_s

    def resume(self) -> None:
        """Send what is due again."""
        self._paused_until_s = -math.inf
        self._woken.set()

    def missing_s(self, now_s: float) -> float:
        """Return for how long the vehicles have flown past their newest setpoint, at fleet time `now_s`.

        Emulated vehicles faster than real time wait for setpoints: they have not.
        """
        return 0.0 if self.scheduler is None else self.scheduler.missing_s(now_s)

    def follow(self, vehicle: FlightVehicle, reference: ReferenceTrajectory) -> None:
        """Stream this reference to a vehicle from now on, without end."""
        assert self.scheduler is not None
        self.streamed[vehicle.sysid].follow(reference)
        self.scheduler.stream_on(vehicle.sysid, self._time.sure_s())

    def follow_plan(self, plan: Plan, stream: SetpointStream) -> None:
        """Stream another plan from its first setpoint on; every deviation from the plan stays what it is."""
        assert self.scheduler is not None
        self._plan, self._stream = plan, spliced(self._stream, stream)
        for timed in self._timed.values():
            timed.follow(self._stream)
        if self._following is not None:
            self._following.follow(plan)
        self.scheduler.follow(Grid.of(self._stream.t_s, plan.scenario.mission.setpoint_rate_hz))

    def replace(self, sysid: int, reference: ReferenceTrajectory) -> None:
        """Stream another reference to a vehicle, for as long as the one before."""
        self.streamed[sysid].follow(reference)

    def continue_plan(self, t_s: float, fade_s: float | None) -> float:
        """Continue the plan a second from now at its time `t_s`, from the vehicles' positions; return T0.

        With `fade_s` all vehicles are streamed to at once, and are on the plan after that time.
        """
        t0_unix_s = self._time.sure_s() + self._options.lead_s + 1.0 - t_s
        self.scheduler = self._scheduler(t0_unix_s)
        if fade_s is not None:
            if self._options.follow:
                self._let_follow(t0_unix_s)
            for vehicle in self._fleet.values():
                base = self.streamed[vehicle.sysid].reference
                motion = vehicle.view.position_ned_m, vehicle.view.velocity_ned_mps
                self._lead_back(vehicle, base, base.at(self.scheduler.grid.ahead_of(t_s), t_s), motion, t_s, fade_s)
                self._stream_on(vehicle, t0_unix_s)
        return t0_unix_s

    def rejoin(self, vehicle: FlightVehicle, begin_s: float) -> None:
        """Lead a vehicle from its position back to its reference within 8 s."""
        assert self.scheduler is not None
        streamed, t0_unix_s = self.streamed[vehicle.sysid], self.scheduler.t0_unix_s
        base = streamed.reference.base if isinstance(streamed.reference, RejoinReference) else streamed.reference
        view = vehicle.view
        seen_s = view.unix_s - t0_unix_s
        values = base.at(self.scheduler.grid.ahead_of(seen_s) - 1, seen_s)
        self._lead_back(vehicle, base, values, (view.position_ned_m, view.velocity_ned_mps), begin_s, _REJOIN_S)

    def rejoin_together(
        self, vehicles: Sequence[FlightVehicle], t0_unix_s: float, t_s: float, fade_s: float, leader: int
    ) -> None:
        """Lead vehicles from their positions back to the plan within `fade_s` from its time `t_s` on, with this T0.

        All other references keep their times, whatever T0 becomes.
        """
        assert self.scheduler is not None
        later_s = t0_unix_s - self.scheduler.t0_unix_s
        if later_s:
            self.scheduler.move(t0_unix_s, self._time.sure_s())
            for streamed in self.streamed.values():
                if isinstance(streamed.reference, MotionReference):
                    streamed.reference.delay(-later_s)
        if self._options.follow:
            self._let_follow(t0_unix_s, leader)
        for vehicle in vehicles:
            base = self._planned[vehicle.sysid]
            values = base.at(self.scheduler.grid.ahead_of(t_s), t_s)
            self._lead_back(vehicle, base, values, vehicle.view.predicted(t0_unix_s + t_s), t_s, fade_s)
            self._stream_on(vehicle, t0_unix_s)

    def _lead_back(
        self,
        vehicle: FlightVehicle,
        base: ReferenceTrajectory,
        values: Values | None,
        motion: tuple[Array, Array],
        begin_s: float,
        fade_s: float,
    ) -> None:
        """Stream `base`, from a motion to its `values` of that time, within `fade_s` from `begin_s` on."""
        if values is not None:
            off_m, off_mps = motion[0] - np.array(values[:3]), motion[1] - np.array(values[3:6])
            self.streamed[vehicle.sysid].follow(RejoinReference(base, off_m, off_mps, begin_s, fade_s))

    def _stream_on(self, vehicle: FlightVehicle, t0_unix_s: float) -> None:
        assert self.scheduler is not None
        end = None if vehicle.behaviour.stream_first_s else len(self._stream.t_s)
        self.scheduler.start(vehicle.sysid, self.scheduler.grid.ahead_of(self._time.sure_s() - t0_unix_s), end)

    def leave(self, sysid: int) -> None:
        """Stop the stream to a vehicle."""
        if self.scheduler is not None:
            self.scheduler.stop(sysid)

    def stand_by(self, t0_unix_s: float) -> None:
        """Vehicles fly their own missions from this T0; be ready to stream to one of them."""
        self.scheduler = self._scheduler(t0_unix_s)

    def promote(self, sysid: int, begin_s: float) -> None:
        """Make a vehicle the leader from plan time `begin_s` on; it is back on the plan after 8 s."""
        following = self._following
        if following is None:
            return
        off_m, off_mps, _ = following.at(sysid, begin_s)
        self.streamed[sysid].follow(RejoinReference(self._timed[sysid], off_m, off_mps, begin_s, _REJOIN_S))
        following.lead(self._fleet[sysid].view)

    def heed(self, flying: Collection[int], now_s: float) -> list[LinkChange]:
        """Have followers listen to these vehicles alone, less those led back to the plan or not heard; return changes.

        `now_s` is fleet time. None where nobody flies or follows.
        """
        if self._following is None or self.scheduler is None or not flying:
            return []
        t_s = now_s - self.scheduler.t0_unix_s
        references = {sysid: self.streamed[sysid].reference for sysid in flying}
        settled = [i for i, one in references.items() if not (isinstance(one, RejoinReference) and one.fades(t_s))]
        return self._following.heed(settled, t_s)

    def _let_follow(self, t0_unix_s: float, leader: int | None = None) -> None:
        leader = self._plan.sysids[self._plan.leader] if leader is None else leader
        followers = [vehicle for vehicle in self._fleet.values() if vehicle.sysid != leader]
        states = {one.sysid: FollowerState(one.view, self.streamed[one.sysid].sent) for one in followers}
        following = self._following = FormationFollowing(self._plan, t0_unix_s, states)
        following.lead(self._fleet[leader].view)
        for one in followers:
            reference = FollowReference(self._timed[one.sysid], following, one.sysid)
            self.streamed[one.sysid].follow(reference)
            self._planned[one.sysid] = reference
        self._planned[leader] = self._timed[leader]

    def _schedule(self, t0_unix_s: float, *, ends: bool) -> None:
        """Stream from now on; before the plan's first setpoint, that setpoint at rest."""
        self.scheduler = self._scheduler(t0_unix_s)
        grid = self.scheduler.grid
        for vehicle in self._fleet.values():
            if vehicle.behaviour.stream_first_s:  # it leaves its mode without a stream, until it lands
                soon_s = _EMULATED_SOON_S if self._emulated else 0.0
                self.scheduler.start(vehicle.sysid, grid.ahead_of(self._time.sure_s() + soon_s - t0_unix_s), None)
            elif ends:
                self.scheduler.start(vehicle.sysid, 0, len(grid.t_s))

    def _scheduler(self, t0_unix_s: float) -> Scheduler:
        grid = Grid.of(self._stream.t_s, self._plan.scenario.mission.setpoint_rate_hz)
        keep_s = _EMULATED_KEEP_S if self._emulated else 0.0
        # Emulated vehicles act at a setpoint's stamp, so they have no lag.
        lags_s = {} if self._emulated else {vehicle.sysid: vehicle.behaviour.lag_s for vehicle in self._fleet.values()}
        return Scheduler(grid, t0_unix_s, lead_s=self._options.lead_s, keep_s=keep_s, lags_s=lags_s)

    async def _turn(self, scheduler: Scheduler) -> None:
        send_due(scheduler, self.streamed.values(), self._send, host_s(self._loop))
        longest_s = _EMULATED_WAIT_S if self._emulated and not follows(self._loop) else _LONGEST_WAIT_S
        pause_s = wait_s(scheduler, self.streamed.values(), host_s(self._loop), longest_s)
        if not self._emulated:
            await sleep_sharply(pause_s)
            return
        await self._until_woken(pause_s)

    async def _until_woken(self, at_most_s: float) -> None:
        self._woken.clear()
        await set_within(self._woken, at_most_s)

    def _send(self, sysid: int, message: Message) -> None:
        self._fleet[sysid].session.send(message)

    async def enter_setpoint_mode(self, vehicle: FlightVehicle) -> None:
        """Switch to the mode that obeys setpoints, after as much of the stream as the autopilot requires.

        Raises as switching modes does.
        """
        if vehicle.session.custom_mode == vehicle.behaviour.guided and vehicle.options.mode is FlightMode.STREAM:
            return
        end_s = self._loop.time() + vehicle.options.phase_timeout_s
        while True:
            await self._time.until(self._time.sure_s() + vehicle.behaviour.stream_first_s)
            try:
                await set_mode(vehicle, vehicle.behaviour.guided)
                return
            except CommandRefused:  # a gap in the stream
                if self._loop.time() > end_s:
                    raise
