"""One flight, from silent vehicles to landed ones: upload, read back, arm, take off, keep time together, land.

Knows: the order of things and what must be true before each. Does not know: sockets, screens, files, how vehicles
are found (`gcs.link.fleet`) or judged (`gcs.flight.judge`). Nothing arms before every vehicle holds its own mission
of this plan, read back equal. Whatever ends the flight early, vehicles in the air are told to land.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from gcs.errors import FlightError, GcsError, PeerError, PeerTimeout
from gcs.flight.monitor import Monitor, Snapshot
from gcs.flight.options import FlightMode, FlightOptions
from gcs.flight.stream import VehicleStream
from gcs.link.dialect import Autopilot, CopterMode, EkfFlag, MavCommand, MessageId, ModeFlag
from gcs.link.message import Message
from gcs.link.session import VehicleSession
from gcs.mission.model import SetpointStream, VehicleMission
from gcs.mission.start import starting_at
from gcs.plan.trajectory import Plan
from gcs.quadrotor import POSITION

_PUMP_S = 0.002
_LOOK_S = 0.05
_SETTLED_M, _SETTLED_MPS = 0.4, 0.25


class Step(StrEnum):
    """Where a flight stands."""

    UPLOAD = "upload and read back"
    READY = "waiting for readiness"
    TAKEOFF = "take-off"
    FLY = "flying"
    LAND = "landing"
    DONE = "landed"


@dataclass(frozen=True)
class FlightTimes:
    """When things happened, in the vehicles' common GNSS time."""

    airborne_unix_s: float  # all hover over their pads
    t0_unix_s: float  # plan time 0
    landing_unix_s: float  # told to land


class Flight:
    """One plan flown once by the vehicles of `sessions` (by system id)."""

    def __init__(
        self,
        plan: Plan,
        missions: Iterable[VehicleMission],
        stream: SetpointStream,
        sessions: dict[int, VehicleSession],
        options: FlightOptions,
    ) -> None:
        self.plan = plan
        self.missions = {m.sysid: m for m in missions}
        self.stream = stream
        self.sessions = sessions
        self.options = options
        self.monitor = Monitor(plan)
        self.step = Step.UPLOAD
        self._leaving_s = next(p for p in plan.phases if p.name in ("run-up", "mission")).start_s
        self._start_unix_s = 0
        self._loop = asyncio.get_running_loop()
        self._woken = asyncio.Event()

    async def run(self) -> FlightTimes:
        """Fly. Raises PeerError (refusals, silence), FlightError (lost in flight); vehicles aloft are landed first."""
        stops = [self._listen(row, self.sessions[sysid]) for row, sysid in enumerate(self.plan.sysids)]
        watch = asyncio.ensure_future(self._watch_links())
        work = asyncio.ensure_future(self._run())
        try:
            done, _ = await asyncio.wait({watch, work}, return_when=asyncio.FIRST_COMPLETED)
            if watch in done:
                watch.result()
            return await work
        except (GcsError, asyncio.CancelledError):
            await _ended(work)
            await self._land_whoever_flies()
            raise
        finally:
            await _ended(watch)
            for stop in stops:
                stop()

    def snapshot(self) -> Snapshot:
        """The flight now, for people to see."""
        t_s = self.monitor.plan_time_s
        span = self.plan.t_end_s - self.plan.t_start_s
        progress = 0.0 if t_s is None else min(max((t_s - self.plan.t_start_s) / span, 0.0), 1.0)
        return Snapshot(
            self.step.value,
            1.0 if self.step is Step.DONE else progress,
            t_s,
            {sysid: view.error_m for sysid, view in self.monitor.views.items()},
            {sysid: s.heartbeat_age_s() for sysid, s in self.sessions.items()},
            {sysid: s.armed for sysid, s in self.sessions.items()},
            self.monitor.separation_m(),
            self.monitor.formation_error_m(),
        )

    async def _run(self) -> FlightTimes:
        self._check_autopilots()
        await self._each(self._ask_for_telemetry)
        self.step = Step.READY
        await self._each(self._until_ready)
        self.step = Step.UPLOAD
        if self.options.mode is FlightMode.MISSION:
            self._set_common_start()
        await self._each(lambda s: s.upload_mission(self.missions[s.sysid]))
        self.step = Step.TAKEOFF
        await self._each(self._take_off)
        await self._each(self._until_hovering)
        airborne_unix_s = self._fleet_time_s()
        self.step = Step.FLY
        fly = self._fly_stream if self.options.mode is FlightMode.STREAM else self._fly_missions
        t0_unix_s = await fly()
        self.step = Step.LAND
        landing_unix_s = t0_unix_s + self.plan.phase("landing").start_s
        await self._each(self._until_landed)
        self.step = Step.DONE
        return FlightTimes(airborne_unix_s, t0_unix_s, landing_unix_s)

    def _check_autopilots(self) -> None:
        for session in self.sessions.values():
            if session.autopilot != Autopilot.ARDUPILOT:
                raise PeerError(
                    f"vehicle {session.sysid} runs autopilot number {session.autopilot}; only ArduPilot can be flown.",
                    hint="export the missions with `gcs export` and fly them with its own ground station",
                )

    async def _ask_for_telemetry(self, session: VehicleSession) -> None:
        rate_hz = self.options.telemetry_rate_hz
        await session.set_message_interval(MessageId.LOCAL_POSITION_NED, rate_hz)
        await session.set_message_interval(MessageId.EKF_STATUS_REPORT, 2.0)
        await session.set_message_interval(MessageId.EXTENDED_SYS_STATE, 2.0)
        await session.set_message_interval(MessageId.SYSTEM_TIME, 2.0)

    async def _until_ready(self, session: VehicleSession) -> None:
        """Ready means that GUIDED can be armed: the position estimate is absolute and no longer "constant position"."""
        await session.wait_for(_position_is_known, self.options.ready_timeout_s, "a position estimate", or_latest=True)
        end_s = self._loop.time() + self.options.find_timeout_s
        while not session.clock.ready:
            if self._loop.time() > end_s:
                raise PeerTimeout(
                    f"vehicle {session.sysid} does not tell the time (SYSTEM_TIME with GNSS time).",
                    hint="it needs a GNSS fix: without a common time a formation cannot start together",
                )
            await asyncio.sleep(_LOOK_S)

    async def _take_off(self, session: VehicleSession) -> None:
        row = self.plan.sysids.index(session.sysid)
        hover = self.plan.states(np.array([self.plan.phase("takeoff").end_s]))[row, 0, POSITION]
        height_m = float(self.plan.pads_ned_m[row, 2] - hover[2])
        await self._set_mode(session, CopterMode.GUIDED)
        await session.command(MavCommand.COMPONENT_ARM_DISARM, 1.0)
        await session.command(MavCommand.NAV_TAKEOFF, 0, 0, 0, math.nan, 0, 0, height_m)

    async def _set_mode(self, session: VehicleSession, mode: CopterMode) -> None:
        """Ask, and believe the HEARTBEAT only."""
        await session.command(MavCommand.DO_SET_MODE, float(ModeFlag.CUSTOM), float(mode))
        await session.wait_for(
            lambda m: m.name == "HEARTBEAT" and m.fields["custom_mode"] == mode,
            self.options.phase_timeout_s,
            f"mode {mode.name}",
            or_latest=True,
        )

    async def _until_hovering(self, session: VehicleSession) -> None:
        row = self.plan.sysids.index(session.sysid)
        hover = self.plan.states(np.array([self.plan.phase("takeoff").end_s]))[row, 0, POSITION]
        view = self.monitor.views[session.sysid]

        # A vehicle climbs by height above its own start, which it knows no better than where it will arrive.
        near_m = max(_SETTLED_M, self.plan.scenario.judge.arrival_position_m)

        def settled() -> bool:
            near = np.linalg.norm(view.position_ned_m - hover) < near_m
            return bool(near and np.linalg.norm(view.velocity_ned_mps) < _SETTLED_MPS)

        await self._until(settled, self.options.phase_timeout_s, f"vehicle {session.sysid}: hover over its pad")

    async def _fly_stream(self) -> float:
        """Send every vehicle its setpoints, all timed from one T0; returns T0."""
        t0_unix_s = math.ceil(self._fleet_time_s() + self.options.lead_s + 0.5) - float(self.stream.t_s[0])
        self.monitor.t0_unix_s = t0_unix_s
        streams = [
            VehicleStream(self.stream, row, self.plan.pads_ned_m[row], t0_unix_s, self.sessions[sysid].station)
            for row, sysid in enumerate(self.plan.sysids)
        ]
        pending = {s.station.sysid: s for s in streams}
        while pending:
            for sysid, stream in tuple(pending.items()):
                session = self.sessions[sysid]
                vehicle_unix_s = session.clock.now_unix_s(self._loop.time())
                if vehicle_unix_s is not None:
                    for message in stream.due(vehicle_unix_s, session.clock, self.options.lead_s):
                        session.send(message)
                if stream.finished:
                    del pending[sysid]
            self._woken.clear()
            with suppress(TimeoutError):
                async with asyncio.timeout(_PUMP_S):  # wait_for may swallow being cancelled
                    await self._woken.wait()
        await self._until_fleet_time(t0_unix_s + self.plan.phase("landing").start_s)
        await self._each(lambda s: self._set_mode(s, CopterMode.LAND))
        return t0_unix_s

    def _set_common_start(self) -> None:
        """Missions leave the hover at one GNSS second, far enough ahead to upload, arm and take off before it."""
        takeoff = self.plan.phase("takeoff")
        ahead_s = self.options.start_after_takeoff_s + 2.0 * (takeoff.end_s - takeoff.start_s)
        self._start_unix_s = math.ceil(self._fleet_time_s() + ahead_s)
        self.missions = {i: starting_at(m, self._start_unix_s) for i, m in self.missions.items()}

    async def _fly_missions(self) -> float:
        """Switch all to their missions, which wait in the hover for the common start; returns T0."""
        await self._each(lambda s: s.command(MavCommand.MISSION_START))
        late_s = self._fleet_time_s() - self._start_unix_s
        if late_s > 0:
            raise FlightError(
                f"the common start was missed by {late_s:.1f} s: not everyone was in the air and ready in time.",
                hint="start again; a slow link needs more time between upload and start",
            )
        t0_unix_s = self._start_unix_s - self._leaving_s
        self.monitor.t0_unix_s = t0_unix_s
        await self._until_fleet_time(t0_unix_s + self.plan.phase("landing").start_s)
        return t0_unix_s

    async def _until_landed(self, session: VehicleSession) -> None:
        await session.wait_for(
            lambda m: m.name == "HEARTBEAT" and not m.fields["base_mode"] & ModeFlag.ARMED,
            self.options.phase_timeout_s,
            "disarming after the landing",
            or_latest=True,
        )

    def _fleet_time_s(self) -> float:
        """GNSS time of the vehicle that is furthest ahead."""
        now_s = self._loop.time()
        times = [s.clock.now_unix_s(now_s) for s in self.sessions.values()]
        known = [t for t in times if t is not None]
        if len(known) < len(times):
            raise FlightError("a vehicle's clock was lost in flight.")
        return max(known)

    async def _until_fleet_time(self, unix_s: float) -> None:
        while self._fleet_time_s() < unix_s:
            await asyncio.sleep(_PUMP_S)

    async def _until(self, condition: Callable[[], bool], timeout_s: float, what: str) -> None:
        end_s = self._loop.time() + timeout_s
        while not condition():
            if self._loop.time() > end_s:
                raise PeerTimeout(f"{what} was not reached within {timeout_s:g} s.")
            await asyncio.sleep(_LOOK_S)

    async def _each(self, action: Callable[[VehicleSession], Awaitable[object]]) -> None:
        """The same with all vehicles at once; the first failure ends the others' waiting and is raised."""
        tasks = [asyncio.ensure_future(action(s)) for s in self.sessions.values()]
        try:
            await asyncio.gather(*tasks)
        finally:
            for task in tasks:
                await _ended(task)

    def _listen(self, row: int, session: VehicleSession) -> Callable[[], None]:
        def receive(message: Message) -> None:
            if message.name == "LOCAL_POSITION_NED":
                self.monitor.receive(row, message, session.clock)
                self._woken.set()

        return session.subscribe(receive)

    async def _watch_links(self) -> None:
        """Raises FlightError as soon as a vehicle has been silent for too long."""
        while True:
            await asyncio.sleep(_LOOK_S)
            for session in self.sessions.values():
                silent_s = session.heartbeat_age_s()
                if silent_s > self.options.lost_after_s:
                    raise FlightError(
                        f"vehicle {session.sysid} was lost ({self.step.value}): no heartbeat for {silent_s:.1f} s.",
                        hint="the others were told to land; look for it where the last telemetry puts it",
                    )

    async def _land_whoever_flies(self) -> None:
        flying = [s for s in self.sessions.values() if s.armed and s.heartbeat_age_s() < self.options.lost_after_s]

        async def land(session: VehicleSession) -> None:
            with suppress(GcsError):
                await session.command(MavCommand.DO_SET_MODE, float(ModeFlag.CUSTOM), float(CopterMode.LAND))

        await asyncio.gather(*(land(s) for s in flying))


async def _ended(task: asyncio.Future[Any]) -> None:
    while not task.done():  # a library on the way may swallow being cancelled
        task.cancel()
        await asyncio.wait({task}, timeout=1.0)
    with suppress(asyncio.CancelledError, GcsError):
        task.result()


def _position_is_known(message: Message) -> bool:
    if message.name != "EKF_STATUS_REPORT":
        return False
    flags = message.fields["flags"]
    return bool(flags & EkfFlag.POS_HORIZ_ABS) and not flags & EkfFlag.CONST_POS_MODE
