"""Incidents of positions: vehicles too near each other, off their tracks or setpoints, or outside their volumes."""

import numpy as np

from gcs.flight.contingency.alarm_watch import Place
from gcs.flight.contingency.choices import FlightMode
from gcs.flight.contingency.conflict_prediction import SeparationWatch
from gcs.flight.contingency.decisions import ContingencyPolicy
from gcs.flight.contingency.detection import OBEYS_M, OBEYS_S, Incident, IncidentKind
from gcs.flight.contingency.policy import HOLDS, IN_FORMATION, USABLE_M, State
from gcs.flight.execution.order_carrier import FlyingFleet
from gcs.flight.monitoring.predicted_tracks import TrackWatch
from gcs.flight.monitoring.volume_watch import VolumeWatch
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.values.navigation_error import judged_separation_m, navigation_error

_IN_AIR_M = 2.0
_GROUND_M, _AWAY_M, _DOWN_S = 1.0, 5.0, 2.0  # so low, so far off its place and for so long a vehicle has come down
_HOLDS_S = 1.0  # so long off them one that was told to hold does not
_FALL_S = 5.0  # others keep clear of a vehicle that falls for so long


class PositionChecks:
    """What the last reports of a fleet mean for its policy."""

    def __init__(self, fleet: FlyingFleet, policy: ContingencyPolicy) -> None:
        plan = fleet.plan
        self._lands = False
        self._vehicles, self._monitor = fleet.vehicles, fleet.monitor
        self._policy = policy
        streamed = fleet.options.mode is FlightMode.STREAM
        self._separation = SeparationWatch(plan, judged_separation_m(plan.scenario), fleet.tracks, streamed=streamed)
        self._streamed = fleet.streamer.streamed
        self._following = HOLDS | {State.FLYING} if streamed else HOLDS  # one that returns gets new ones as needed
        self._tracks = None if fleet.tracks is None else TrackWatch(fleet.tracks, plan.flight_s)
        self._volumes = None if fleet.options.volumes is None else VolumeWatch(fleet.options.volumes)
        self._fell_s: dict[int, float] = {}  # when motors stopped in the air
        self._low_s: dict[int, float] = {}  # since when vehicles are down
        self._off_s: dict[int, float] = {}  # since when vehicles do not follow their setpoints

    @property
    def _plan(self) -> Plan:
        return self._monitor.plan

    def follow(self, plan: Plan) -> None:
        """The vehicles fly another plan."""
        self._separation.follow(plan)

    def land(self) -> None:
        """The plan is over."""
        self._lands = True

    def falls(self, sysid: int, now_s: float) -> None:
        """The motors of a vehicle have stopped in the air."""
        self._fell_s[sysid] = now_s

    def place(self, sysid: int) -> Place:
        """Where a vehicle is above the ground; a reported height may be off by the navigation error."""
        scenario = self._plan.scenario
        north_m, east_m, down_m = self._monitor.views[sysid].position_ned_m
        above_m = float(-down_m - ground_height_m(scenario.terrain, north_m, east_m))
        flies = self._policy.states[sysid] in IN_FORMATION | HOLDS and not self._lands
        return Place(above_m, flies, _IN_AIR_M + navigation_error(scenario).vertical_m)

    def _is_low(self, sysid: int) -> bool:
        """Whether it reports itself at the ground, where the plan never is; not known for plans that fly so low."""
        low_m = _GROUND_M + navigation_error(self._plan.scenario).vertical_m
        return self.place(sysid).above_ground_m < low_m < self._plan.scenario.limits.clearance_min_m

    def usable(self, sysid: int) -> bool:
        """Whether a vehicle is where the plan, or its own mission, has it."""
        if self._tracks is not None:
            return self._tracks.inside(sysid)
        return not self._monitor.views[sysid].error_m > USABLE_M

    def in_band(self, sysid: int) -> bool | None:
        """Whether a vehicle that flies its own mission is in the band of its predicted track; None for any other."""
        t_s = self._monitor.plan_time_s
        if self._tracks is None or t_s is None or not 0.0 <= t_s <= self._plan.flight_s:
            return None
        return self._tracks.inside(sysid) if sysid in self._policy.in_formation else None

    def off_track(self, now_s: float) -> list[Incident]:
        """Return an incident for each vehicle that left the band of its predicted track, or its setpoints."""
        t0_unix_s = self._monitor.t0_unix_s
        if t0_unix_s is None:
            return []
        found = self._off_setpoints(now_s)
        if self._tracks is not None:
            flying = [i for i in self._policy.in_formation if self._vehicles[i].session.armed]
            found += [(off.sysid, str(off)) for off in self._tracks.look(self._monitor.views, t0_unix_s, flying)]
        return [Incident(IncidentKind.OFF_TRACK, sysid, now_s, words) for sysid, words in found]

    def outside_volumes(self, now_s: float) -> list[Incident]:
        """Return an incident for each vehicle in the air, whatever it does, that left the volumes of this flight."""
        if self._volumes is None:
            return []
        flying = [
            sysid
            for sysid, state in self._policy.states.items()
            if state is not State.LOST
            and self._vehicles[sysid].session.armed
            and self.place(sysid).above_ground_m > _IN_AIR_M
        ]
        found = self._volumes.look(self._monitor.views, flying)
        return [Incident(IncidentKind.OUTSIDE_VOLUME, sysid, now_s, words) for sysid, words in found]

    def _off_setpoints(self, now_s: float) -> list[tuple[int, str]]:
        """Vehicles that do not follow what was sent for the time of their last reports, and how far they are off."""
        found = []
        for sysid, state in self._policy.states.items():
            view, vehicle = self._monitor.views[sysid], self._vehicles[sysid]
            follows = state in self._following and vehicle.session.custom_mode == vehicle.behaviour.guided
            sent = self._streamed[sysid].sent.at(view.unix_s) if follows and not self._lands else None
            off_m = 0.0 if sent is None else float(np.linalg.norm(view.position_ned_m - sent[0]))
            if off_m <= OBEYS_M or self._is_low(sysid):
                self._off_s.pop(sysid, None)
            elif now_s - self._off_s.setdefault(sysid, now_s) > (OBEYS_S if state is State.FLYING else _HOLDS_S):
                self._off_s[sysid] = np.inf  # once, until it follows again
                found.append((sysid, f"{off_m:.1f} m off its setpoints; limit {OBEYS_M:g} m"))
        return found

    def down(self, now_s: float, t_s: float) -> list[Incident]:
        """Return an incident, once, for each vehicle on the ground that the plan has in the air."""
        flown, found = 0.0 <= t_s <= self._plan.flight_s, []
        for sysid in [i for i, state in self._policy.states.items() if flown and state in IN_FORMATION | HOLDS]:
            armed, view = self._vehicles[sysid].session.armed, self._monitor.views[sysid]
            if not (armed and view.error_m > _AWAY_M and self._is_low(sysid)):
                self._low_s.pop(sysid, None)
            elif now_s - self._low_s.setdefault(sysid, now_s) > _DOWN_S:
                self._low_s[sysid] = np.inf
                found.append(Incident(IncidentKind.DOWN, sysid, now_s, f"{view.error_m:.1f} m off its place"))
        return found

    def conflicts(self, now_s: float, t_s: float, *, gathers: bool) -> list[Incident]:
        """Return an incident for each conflict; its first vehicle is farther from its place than the other one.

        `gathers`: after a pause of this program no vehicle flies the plan.
        """
        states, views = self._policy.states, self._monitor.views
        armed = [i for i, s in states.items() if s is not State.LOST and self._vehicles[i].session.armed]
        starting = [i for i, s in states.items() if s is State.STARTING]
        # From the first one armed to T0 every vehicle counts: one that drifts may come down on one that stands.
        airborne = armed if not (armed and starting) else [i for i, s in states.items() if s is not State.LOST]
        falling = [i for i, fell_s in self._fell_s.items() if now_s - fell_s < _FALL_S]
        airborne += falling
        self._monitor.watch_separation(airborne)
        on_plan = [i for i in airborne if states[i] in IN_FORMATION and not gathers]
        found = []
        for conflict in self._separation.look(views, t_s, now_s, on_plan, airborne, starting, falling):
            farther, other = sorted(conflict.pair, key=lambda i: -self._off_m(i))
            higher = bool(views[farther].position_ned_m[2] <= views[other].position_ned_m[2])
            words, in_s = f"{conflict.distance_m:.2f} m", conflict.in_s
            found.append(Incident(IncidentKind.CONFLICT, farther, now_s, words, other=other, in_s=in_s, higher=higher))
        return found

    def _off_m(self, sysid: int) -> float:
        """How far a vehicle is from its place in the plan; before T0, to the side of its pad."""
        view = self._monitor.views[sysid]
        known = self._monitor.t0_unix_s is not None
        return float(np.nan_to_num(view.error_m)) if known else self._separation.off_pad_m(view)
