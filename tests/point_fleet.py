"""A formation of points in the air, and the ground station's own objects that fly it, on a clock of its own.

A point is where its last setpoint said, and stops there without setpoints. It changes its mode as ordered and reports
itself. The ground station may stand still meanwhile: `stand_still`.
"""

from __future__ import annotations

import asyncio
import math
import selectors
from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np

from gcs.autopilots.traits import Autopilot
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.execution.executor import ContingencyExecutor
from gcs.flight.execution.order_carrier import FlyingFleet, OrderCarrier
from gcs.flight.execution.streamer import Streamer
from gcs.flight.execution.takeoff_landing import FlightVehicle
from gcs.flight.monitoring.fleet_time import FleetTime
from gcs.flight.monitoring.monitor import Monitor
from gcs.flight.monitoring.predicted_tracks import PredictedTracks
from gcs.flight.monitoring.progress import Event
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.message import GROUND, Message
from gcs.mavlink import MavCommand, ModeFlag
from gcs.mission.export.setpoint_stream import build_stream
from gcs.mission.returns.rtl_altitudes import ReturnPlan
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.energy import battery_model
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array
from gcs.util.aio import ended
from gcs.util.steady_loop import SteadyClock, SteadyLoop, host_s

ARDUPILOT = Autopilot.ARDUPILOT.traits.flight
PILOTS_MODE = 5  # LOITER
EPOCH_S = 1_700_000_000.0
_EVERY_S = 0.1  # a position; every fifth time the rest
_STOPS_AFTER_S = 1.0


class _StandingSelector(selectors.DefaultSelector):
    """A wait is over at once, and the host's clock has moved by as much."""

    def __init__(self) -> None:
        super().__init__()
        self.host_s = 1000.0
        self.stalls = SteadyClock(self.host_s)

    def select(self, timeout: float | None = None) -> list[Any]:
        assert timeout is not None, "all tasks wait for each other"
        self.stalls.turn(self.host_s)
        left_s = max(timeout, 1e-4)
        while left_s > 0.0:  # a long wait is no standstill
            self.host_s += min(left_s, 0.5)
            self.stalls.turn(self.host_s)
            left_s -= 0.5
        return super().select(0.0)


class StandingLoop(SteadyLoop):
    """A steady loop in virtual time."""

    def __init__(self) -> None:
        self._virtual = _StandingSelector()
        asyncio.SelectorEventLoop.__init__(self, self._virtual)

    @property
    def stalls(self) -> SteadyClock:
        return self._virtual.stalls

    @property
    def follows(self) -> bool:
        return False

    def time(self) -> float:
        return self.stalls.look(self._virtual.host_s)

    def stand_still(self, seconds: float) -> None:
        """The program stands still; the vehicles' time goes on."""
        self._virtual.host_s += seconds


class Point:
    """One vehicle. `deaf`: it acknowledges orders and does not carry them out; `silent`: nothing of it is heard.

    `off_ned_m` is where the wind has blown it, from its setpoint. `mission` is its motion (6,) while it flies the
    mission on board.
    """

    def __init__(self, sysid: int, plan: Plan, t_s: float, host_now_s: Callable[[], float]) -> None:
        row = plan.sysids.index(sysid)
        state = plan.states(np.array([t_s]))[row, 0]
        self.sysid = sysid
        self.pad_ned_m: Array = plan.pads_ned_m[row]
        self.position_ned_m, self.velocity_ned_mps = state[POSITION].copy(), state[VELOCITY].copy()
        self.mode, self.armed, self.battery_pct = ARDUPILOT.guided, True, 90
        self.silent = self.deaf = self.critical = False
        self.off_ned_m: Array = np.zeros(3)
        self.mission: Callable[[], Array] | None = None
        self.modes_ordered: list[int] = []
        self.setpoints: list[tuple[float, Array]] = []  # (6,) each, with its host time
        self.session: VehicleSession | None = None
        self._host_s = host_now_s
        self._moved_s = host_now_s()
        self._beats = 0

    def heartbeat(self) -> Message:
        flags = int(ModeFlag.CUSTOM) | (int(ModeFlag.ARMED) if self.armed else 0)
        fields = {"autopilot": int(Autopilot.ARDUPILOT), "type": 2, "system_status": 5 if self.critical else 4}
        return Message("HEARTBEAT", {**fields, "base_mode": flags, "custom_mode": self.mode}, self.sysid, 1)

    def say(self, name: str, **fields: Any) -> None:
        if self.session is not None and not self.silent:
            self.session.receive(Message(name, fields, self.sysid, 1), asyncio.get_running_loop().time())

    def report(self) -> None:
        """Tell where it is, and now and then the rest."""
        assert self.session is not None
        now_s = self._host_s()
        if now_s - self._moved_s > _STOPS_AFTER_S:
            self.velocity_ned_mps = np.zeros(3)
        if self.mission is not None and self.mode == ARDUPILOT.mission:
            self.position_ned_m, self.velocity_ned_mps = self.mission().reshape(2, 3)
            self._moved_s = now_s
        north_m, east_m, down_m = (self.position_ned_m + self.off_ned_m - self.pad_ned_m).tolist()
        vx, vy, vz = self.velocity_ned_mps.tolist()
        boot_ms = round(1e3 * now_s)
        if self._beats % 5 == 0 and not self.silent:
            self.session.receive(self.heartbeat(), asyncio.get_running_loop().time())
            self.say("SYSTEM_TIME", time_boot_ms=boot_ms, time_unix_usec=round(1e6 * (EPOCH_S + now_s)))
            self.say("SYS_STATUS", battery_remaining=self.battery_pct)
        self.say("LOCAL_POSITION_NED", time_boot_ms=boot_ms, x=north_m, y=east_m, z=down_m, vx=vx, vy=vy, vz=vz)
        self._beats += 1

    def hear(self, message: Message) -> None:
        """Carry out what the ground station sends."""
        fields = message.fields
        if message.name == "SET_POSITION_TARGET_LOCAL_NED":
            place = np.array([fields[name] for name in ("x", "y", "z")]) + self.pad_ned_m
            velocity = np.array([fields[name] for name in ("vx", "vy", "vz")])
            self.setpoints.append((self._host_s(), np.concatenate([place, velocity])))
            if self.mode == ARDUPILOT.guided:
                self.position_ned_m, self.velocity_ned_mps, self._moved_s = place, velocity, self._host_s()
        elif message.name == "COMMAND_LONG":
            if fields["command"] == MavCommand.DO_SET_MODE:
                self.modes_ordered.append(int(fields["param2"]))
                self.mode = self.mode if self.deaf else int(fields["param2"])
            answer = {"command": fields["command"], "result": 0, "target_system": GROUND.sysid}
            later = {"target_component": GROUND.compid, "progress": 0, "result_param2": 0}
            asyncio.get_running_loop().call_later(0.01, lambda: self.say("COMMAND_ACK", **answer, **later))


class PointFleet:
    """The formation on its plan from plan time `t_s` on, and what flies it."""

    def __init__(
        self,
        plan: Plan,
        returns: ReturnPlan,
        options: FlightOptions,
        t_s: float,
        tracks: PredictedTracks | None = None,
    ) -> None:
        self.loop = asyncio.get_running_loop()
        self.plan = plan
        self.points = {sysid: Point(sysid, plan, t_s, lambda: host_s(self.loop)) for sysid in plan.sysids}
        self.sessions = {}
        for sysid, point in self.points.items():
            self.sessions[sysid] = point.session = VehicleSession(point.heartbeat(), point.hear)
        self.monitor = Monitor(plan)
        self.vehicles = {
            sysid: FlightVehicle(session, ARDUPILOT, plan, row, self.monitor.views[sysid], options)
            for row, (sysid, session) in enumerate(self.sessions.items())
        }
        for vehicle in self.vehicles.values():
            self._listen(vehicle)
        self.time = FleetTime(self.sessions)
        self.streamer = Streamer(plan, build_stream(plan, 10.0), self.vehicles, self.time, options)
        self.events: list[Event] = []
        self.carrier = OrderCarrier(lambda i: self.sessions[i].armed, lambda i: self.sessions[i].silent_s() < 5.0)
        fleet = FlyingFleet(self.vehicles, self.monitor, self.streamer, self.time, options, tracks)
        self.executor = ContingencyExecutor(fleet, self.carrier, returns, battery_model(plan), self.events.append)
        self.error: BaseException | None = None
        self._begin_s = t_s

    @property
    def t_s(self) -> float:
        """Plan time now."""
        return EPOCH_S + host_s(self.loop) - (self.monitor.t0_unix_s or math.nan)

    def told(self, words: str) -> list[Event]:
        """The events that are told in these words."""
        return [event for event in self.events if words in event.what]

    async def fly(self, story: Callable[[PointFleet], Awaitable[None]], *, starting: bool = False) -> None:
        """Have the ground station fly the plan, or watch over the start, until the story is over."""
        reports = asyncio.ensure_future(self._report())
        await asyncio.sleep(1.0)
        if starting:
            self.executor.starts()
        else:
            self.monitor.set_t0(EPOCH_S + host_s(self.loop) - self._begin_s)
            self.streamer._schedule(self.monitor.t0_s, ends=True)
            self.executor.flies()
        tasks = [reports, asyncio.ensure_future(self.streamer.run()), asyncio.ensure_future(self.executor.run())]
        try:
            await story(self)
            if tasks[-1].done():
                self.error = tasks[-1].exception()
        finally:
            await self.carrier.close()
            await ended(*tasks)

    def _listen(self, vehicle: FlightVehicle) -> None:
        def receive(message: Message) -> None:
            if message.name == "LOCAL_POSITION_NED":
                self.monitor.receive(vehicle.row, message, vehicle.session.clock)

        vehicle.session.subscribe(receive)

    async def _report(self) -> None:
        while True:
            for point in self.points.values():
                point.report()
            for session in self.sessions.values():
                session.tick(self.loop.time())
            await asyncio.sleep(_EVERY_S)


def flown(
    plan: Plan,
    returns: ReturnPlan,
    story: Callable[[PointFleet], Awaitable[None]],
    *,
    options: FlightOptions | None = None,
    t_s: float = 10.0,
    starting: bool = False,
    tracks: PredictedTracks | None = None,
) -> PointFleet:
    """Fly one story in virtual time."""

    async def run() -> PointFleet:
        fleet = PointFleet(plan, returns, options or FlightOptions(), t_s, tracks)
        await fleet.fly(story, starting=starting)
        return fleet

    with asyncio.Runner(loop_factory=StandingLoop) as runner:
        return runner.run(run())
