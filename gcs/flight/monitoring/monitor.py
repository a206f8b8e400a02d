"""Deviations from the plan and separations, from telemetry: a vehicle reports its estimate, not its true state.

While it stands, a vehicle reports its pad with the error of its receiver, metres with ordinary GNSS. Its true place is
the pad. So until T0 separations count from `VehicleView.place_ned_m`: the pad, and what the vehicle has moved since it
was armed. From T0 on vehicles are steered by what they report, and separations count from that.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.distance import pdist

from gcs.autopilots.columns import LandingProfile
from gcs.autopilots.local_frame import local_frame
from gcs.flight.monitoring.expected_motion import ExpectedMotion, landing_profiles
from gcs.flight.monitoring.lateness import Lateness
from gcs.flight.monitoring.least_separation import LeastSeparation
from gcs.flight.monitoring.progress import FlightPart, NearestPair
from gcs.frames import LocalFrame
from gcs.link.protocols.clock import VehicleClock
from gcs.link.wire.message import Message, local_motion
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.distances import formation_error_m
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.si import local_origin
from gcs.types import Array

_AHEAD_S = 1.0  # a report is extrapolated by this much or less


@dataclass
class VehicleView:
    """One vehicle as last reported, in the formation's common frame."""

    sysid: int
    position_ned_m: Array = field(default_factory=lambda: np.full(3, np.nan))
    velocity_ned_mps: Array = field(default_factory=lambda: np.zeros(3))
    unix_s: float = math.nan
    error_m: float = math.nan  # distance to the expected position at the same time; NaN where none is expected
    lateness: Lateness = field(default_factory=Lateness)  # between T0 and the planned arrival
    standing_error_ned_m: Array | None = None  # (3,): of its report on the pad, when it was armed
    frame: LocalFrame = field(default_factory=LocalFrame)  # in which it reports and takes setpoints

    @property
    def place_ned_m(self) -> Array:
        """The position (3,) by what it has moved since it was armed on its pad; before that, as reported."""
        error = self.standing_error_ned_m
        return self.position_ned_m if error is None else self.position_ned_m - error

    def stands_on(self, pad_ned_m: Array) -> None:
        """Take reported position less pad (3,), NED, m, as the standing error of this vehicle.

        `place_ned_m` subtracts it. No effect before the first report.
        """
        if np.isfinite(self.position_ned_m).all():
            self.standing_error_ned_m = self.position_ned_m - pad_ned_m

    def predicted(self, unix_s: float) -> tuple[Array, Array]:
        """Return position and velocity (3,) at a time soon after the report, straight on."""
        ahead_s = min(max(unix_s - self.unix_s, 0.0), _AHEAD_S)
        return self.position_ned_m + self.velocity_ned_mps * ahead_s, self.velocity_ned_mps


class Monitor:
    """Reported positions in, deviations and separations out."""

    def __init__(
        self,
        plan: Plan,
        landings: Mapping[int, LandingProfile] | None = None,
        autopilots: Mapping[int, int] | None = None,
    ) -> None:
        """`autopilots` (MAV_AUTOPILOT) say in which local frames vehicles report; without one its metres are true ones.

        `landings`: how vehicles land by themselves, by system id; None: as their autopilots do. Without either a
        vehicle lands as planned.
        """
        known, origin = autopilots or {}, local_origin(plan.scenario)
        self.plan = plan
        self.expected = ExpectedMotion(plan, landing_profiles(known) if landings is None else landings)
        self.t0_unix_s: float | None = None
        self.views = {
            sysid: VehicleView(sysid, frame=local_frame(known.get(sysid), origin, pad_ned_m))
            for sysid, pad_ned_m in zip(plan.sysids, plan.pads_ned_m, strict=True)
        }
        self.plan_time_s: float | None = None
        self.in_formation: Collection[int] = plan.sysids  # the vehicles of the formation error
        self.aloft: Collection[int] = ()  # the vehicles of the separation: none before the take-off
        self._least = LeastSeparation()

    def expect_landings(self, landings: Mapping[int, LandingProfile]) -> None:
        """Compare landings with these descents from now on."""
        self.expected = ExpectedMotion(self.plan, landings)

    def follow(self, plan: Plan) -> None:
        """Compare with another plan from now on."""
        self.plan = plan
        self.expected = ExpectedMotion(plan, self.expected.profiles)

    @property
    def t0_s(self) -> float:
        """T0, which is known by now."""
        assert self.t0_unix_s is not None
        return self.t0_unix_s

    def receive(self, row: int, message: Message, clock: VehicleClock) -> None:
        """Take in a LOCAL_POSITION_NED of the vehicle in row `row` of the plan."""
        unix_s, motion = clock.unix_s(message.fields["time_boot_ms"]), local_motion(message)
        if unix_s is None or motion is None:
            return
        view = self.views[self.plan.sysids[row]]
        view.position_ned_m = view.frame.common_ned_m(np.array(motion[:3]))
        view.velocity_ned_mps = np.array(motion[3:]) / view.frame.counts
        view.unix_s = unix_s
        self._least.receive(view.sysid, unix_s, view.position_ned_m, view.velocity_ned_mps)
        if self.t0_unix_s is not None:
            self._compare(row, view, unix_s - self.t0_unix_s)

    @property
    def late_s(self) -> dict[int, float]:
        """The delay of each vehicle behind the plan, by system id."""
        return {sysid: view.lateness.late_s for sysid, view in self.views.items()}

    @property
    def errors_m(self) -> dict[int, float]:
        """The position error of each vehicle, by system id; NaN for one that left the plan."""
        flying = self.in_formation
        return {sysid: view.error_m if sysid in flying else math.nan for sysid, view in self.views.items()}

    def set_t0(self, t0_unix_s: float) -> None:
        """The plan begins, or goes on, with this T0; delays count from now on."""
        self.t0_unix_s = t0_unix_s
        for view in self.views.values():
            view.lateness = Lateness()

    def nearest_now(self) -> NearestPair | None:
        """Return the nearest two vehicles of `aloft`; None before all have reported."""
        return self._nearest(self.aloft)

    def watch_formation(self, sysids: Collection[int]) -> None:
        """Take in which vehicles fly the plan and are heard: the formation error is theirs."""
        self.in_formation = sysids

    def watch_separation(self, aloft: Collection[int]) -> None:
        """Take in which vehicles are in the air, and note the nearest two of those that are heard."""
        self.aloft = aloft
        errors = {i: error for i in aloft if (error := self.views[i].standing_error_ned_m) is not None}
        self._least.look(aloft, self._part_at, errors)

    @property
    def nearest(self) -> Mapping[FlightPart, NearestPair]:
        """The nearest two vehicles of each part of the flight so far."""
        return self._least.nearest

    @property
    def part(self) -> FlightPart:
        """The part of the flight: before T0, on the plan, or in the landing."""
        return self._part(self.plan_time_s)

    def _part_at(self, unix_s: float) -> FlightPart:
        return self._part(None if self.t0_unix_s is None else unix_s - self.t0_unix_s)

    def _part(self, t_s: float | None) -> FlightPart:
        if self.t0_unix_s is None or t_s is None or t_s < 0.0:
            return FlightPart.TAKEOFF
        return FlightPart.FLIGHT if t_s < self.plan.landing_s else FlightPart.LANDING

    def formation_error_m(self) -> float:
        """Return the formation error (Definition 1); NaN before all have reported, or before T0 is known.

        In the landing it is NaN: there every vehicle descends at the speeds of its own autopilot, and no shape is kept.
        """
        now = self._now(self.in_formation)
        if now is None or self.t0_unix_s is None or now[0] - self.t0_unix_s > self.plan.landing_s:
            return math.nan
        unix_s, positions = now
        t_s = np.clip(np.array([unix_s - self.t0_unix_s]), self.plan.t_start_s, self.plan.t_end_s)
        rows = [self.plan.sysids.index(sysid) for sysid in self.in_formation]
        return float(formation_error_m(positions[:, None], self.plan.offsets(t_s)[rows])[0])

    def _nearest(self, sysids: Collection[int]) -> NearestPair | None:
        now = self._now(sysids, moved_only=self.part is FlightPart.TAKEOFF)
        if now is None or len(now[1]) < 2:
            return None
        between_m = pdist(now[1])
        least, ids = int(np.argmin(between_m)), tuple(sysids)
        first, second = (int(rows[least]) for rows in np.triu_indices(len(ids), 1))
        return NearestPair(self.part, (ids[first], ids[second]), float(between_m[least]), now[0])

    def _now(self, sysids: Collection[int], *, moved_only: bool = False) -> tuple[float, Array] | None:
        """Positions (V, 3) of these vehicles, all predicted for the time of the newest report.

        `moved_only`: from the pads and what they moved since they were armed, instead of what they report.
        """
        views = [self.views[sysid] for sysid in sysids]
        newest = max((v.unix_s for v in views), default=math.nan)
        if math.isnan(sum(v.unix_s for v in views)) or not views:
            return None
        places = [v.place_ned_m if moved_only else v.position_ned_m for v in views]
        ahead = [v.velocity_ned_mps * (newest - v.unix_s) for v in views]
        return newest, np.array(places) + np.array(ahead)

    def _compare(self, row: int, view: VehicleView, t_s: float) -> None:
        if t_s < self.plan.phase(PhaseKind.MISSION).start_s - 60.0:
            return
        self.plan_time_s = t_s
        at_s = np.array([t_s])
        if t_s > self.plan.t_end_s and not self.expected.covers(row, at_s)[0]:
            view.error_m = math.nan
            return
        state = self.expected.of_vehicle(row, at_s)[0]
        view.error_m = float(np.linalg.norm(view.position_ned_m - state[POSITION]))
        if 0.0 <= t_s <= self.plan.flight_s:
            view.lateness.add(view.position_ned_m, state[POSITION], state[VELOCITY])
