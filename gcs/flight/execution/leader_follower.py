"""Setpoints of followers: the plan, moved with the deviation of the vehicles that each listens to.

Whom it listens to is the information graph (Eq. 3): the leader, or its neighbours towards the leader. The planned
position plus their mean deviation from the plan is its place in their shape (Eq. 22). But all fly the same plan with
the same kind of autopilot. A follower that copied a neighbour's tracking error would add its own to it. So a
follower's setpoint is the planned one moved by D, with

    x = L - C,   D'' = soft(w^2 (x - D) + 2 w (k x' - D')),   L = sum of w_ij (deviation of j)

C is the follower's own tracking error: its reported position less the setpoint that was sent for the same time, at most
OWN_MAX_M. Errors that all vehicles make cancel; what remains is the error of the shape, and D takes it out. All are
predicted to the time of the setpoint. `soft` bounds the acceleration (`accel_bound_mps2`) and smooths it: followers go
with a leader that the wind moves, not with noise or jumps.

With F = D / x and G the follower's response to D, the loop is stable while |F (G - 1)| < 1 at every frequency. F is
about 1 where G is, and small where G is delayed.

A loop that follows a ramp without lag (k = 1) exceeds its input at some frequency: every follower would swing further
than the one before it. So where a follower's deviation is passed on, k is RELAYED_RATE: then |deviation / L| < 1.
"""

import math
from collections import deque
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from gcs.flight.contingency.manoeuvres import PlanReference, Values
from gcs.flight.monitoring.monitor import VehicleView
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.formation.graph import InformationGraph, information_graph
from gcs.plan.formation.time_scaling import budget
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array

RATE_RADPS = 3.0
REPORT_MAX_S = 1.0  # the rate of an older report is not used
_SENT_GAP_S = 0.5  # setpoints further apart than this are not continued
_KEPT = 256
BANDWIDTH_RADPS = 0.5
SOFT_S = 0.3  # acceleration passes two lags of this: vehicles tilt for it, and some tilt slowly
IGNORED_M = 0.1  # estimates drift by this much: following that would shake the formation
OWN_MAX_M = 2.0  # a larger tracking error is a vehicle that cannot follow
RELAYED_RATE = 0.3
LINK_MAX_S = 2.0  # nobody listens to a follower whose report is older; again, once one is younger than REPORT_MAX_S
REMADE_S, REMADE_M = 1.0, 0.5  # the graph is made anew where a place in the shape has moved so far; asked so often
_STEP_S = 0.02


class DeviationEstimate:
    """A vehicle's deviation at its last report, and a rate that agrees with its positions; times of reports rise.

    A reported velocity may differ from the slope of the reported positions: satellite fixes move the position and not
    the velocity. Recorded vehicles differ by 0.2 m/s RMS over 2 s. Two first-order filters join both reports, with
    position x, velocity u and correction b of the velocity:

        x' = u + b + 2 w (reported - x)
        b' = w^2 (reported - x)

    The rate u + b has no delay above w = RATE_RADPS and no offset below it.
    """

    def __init__(self) -> None:
        self.t_s = math.nan
        self._reported_m, self._reported_mps = np.zeros(3), np.zeros(3)
        self._smooth_m, self._correction_mps = np.zeros(3), np.zeros(3)

    def receive(self, t_s: float, off_m: Array, off_mps: Array) -> None:
        """Take in a deviation (3,) and its reported rate (3,), both of the time `t_s`."""
        step_s = t_s - self.t_s
        if 0.0 < step_s <= REPORT_MAX_S:
            mean_mps = (self._reported_mps + off_mps) / 2 + self._correction_mps
            expected = self._smooth_m + mean_mps * step_s
            missed = off_m - expected
            kept = math.exp(-RATE_RADPS * step_s)
            self._smooth_m = expected + (1.0 - kept * kept) * missed
            self._correction_mps = self._correction_mps + (1.0 - kept) ** 2 / step_s * missed
        else:
            self._smooth_m, self._correction_mps = off_m, np.zeros(3)
        self.t_s, self._reported_m, self._reported_mps = t_s, off_m, off_mps

    def is_fresh(self, t_s: float) -> bool:
        """Whether the last report is not too old to be predicted for `t_s`."""
        return t_s - self.t_s <= REPORT_MAX_S

    def at(self, t_s: float) -> tuple[Array, Array]:
        """Return the deviation predicted for `t_s`, and its rate; of an old report the deviation alone."""
        if not self.is_fresh(t_s):
            return self._reported_m, np.zeros(3)
        rate_mps = self._reported_mps + self._correction_mps
        return self._reported_m + rate_mps * max(t_s - self.t_s, 0.0), rate_mps


class SentSetpoints:
    """The last setpoints that were sent to one vehicle, by the unix time at which it is to be there."""

    def __init__(self) -> None:
        self._sent: deque[tuple[float, Values]] = deque(maxlen=_KEPT)

    def add(self, unix_s: float, values: Values) -> None:
        """Note a setpoint. One that is not later than those before it replaces them."""
        while self._sent and self._sent[-1][0] >= unix_s:
            self._sent.pop()
        self._sent.append((unix_s, values))

    def at(self, unix_s: float) -> tuple[Array, Array] | None:
        """Return the position and velocity (3,) that were asked for at a time; None when nothing was."""
        for sent_s, values in reversed(self._sent):
            if sent_s <= unix_s:
                ahead_s = unix_s - sent_s
                if ahead_s > _SENT_GAP_S:
                    return None
                position, velocity, acceleration = np.array(values[:9]).reshape(3, 3)
                moved = position + velocity * ahead_s + acceleration * (ahead_s * ahead_s / 2.0)
                return moved, velocity + acceleration * ahead_s
        return None


def accel_bound_mps2(scenario: Scenario) -> float:
    """The limit on acceleration added by following: that of a change of formation, or more if the vehicle is able.

    The larger limit is half of what the plan's turns may take (n_max of Eq. 17), within the jerk and snap that rates
    and torques allow a change of formation. A step through both lags has a jerk of 1 / (e SOFT_S) and a snap of
    1 / SOFT_S^2 of its size.
    """
    most = budget(scenario)
    turns_mps2 = 0.5 * scenario.limits.load_factor_max * scenario.vehicle.gravity_mps2
    return max(most.accel_mps2, min(turns_mps2, most.jerk_mps3 * math.e * SOFT_S, most.snap_mps4 * SOFT_S**2))


@dataclass
class FollowerState:
    """What a follower reports, and what was sent to it."""

    view: VehicleView
    sent: SentSetpoints
    _own: DeviationEstimate = field(default_factory=DeviationEstimate)

    def tracking_error(self, unix_s: float) -> tuple[Array, Array]:
        """Return its own error and the rate, predicted for a time; zero where either report or setpoint is missing."""
        view = self.view
        if math.isnan(view.unix_s):
            return np.zeros(3), np.zeros(3)
        if view.unix_s != self._own.t_s:
            asked = self.sent.at(view.unix_s)
            if asked is not None:
                self._own.receive(view.unix_s, view.position_ned_m - asked[0], view.velocity_ned_mps - asked[1])
        if not self._own.is_fresh(unix_s):
            return np.zeros(3), np.zeros(3)
        off_m, off_mps = self._own.at(unix_s)
        share = OWN_MAX_M / max(float(np.linalg.norm(off_m)), OWN_MAX_M)
        return share * off_m, share * off_mps


@dataclass(frozen=True)
class LinkChange:
    """Nobody listens to a vehicle any more, or the same listen to it again."""

    sysid: int
    what: str
    rule: str


class ReportedDeviation:
    """How far a vehicle in row `row` of the plan is from its place in the plan, predicted from its reports."""

    def __init__(self, view: VehicleView, row: int, t0_unix_s: float) -> None:
        self._view, self._row, self._t0_unix_s = view, row, t0_unix_s
        self._estimate = DeviationEstimate()

    def age_s(self, t_s: float) -> float:
        """Return how old the last report is at plan time `t_s`; infinite without one."""
        seen_s = self._view.unix_s - self._t0_unix_s
        return math.inf if math.isnan(seen_s) else t_s - seen_s

    def at(self, plan: Plan, t_s: float) -> tuple[Array, Array]:
        """Return the deviation (3,) at plan time `t_s` and its rate; zeros before the first report."""
        view, row = self._view, self._row
        if math.isnan(view.unix_s):
            return np.zeros(3), np.zeros(3)
        seen_s = view.unix_s - self._t0_unix_s
        if seen_s != self._estimate.t_s:
            at = np.clip(np.array([seen_s]), plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf))
            planned = plan.leader_trajectory.state(at)[0]
            off = view.position_ned_m - planned[POSITION] - plan.shape.offsets(at)[row, 0]
            rate = view.velocity_ned_mps - planned[VELOCITY] - plan.shape.offsets(at, 1)[row, 0]
            self._estimate.receive(seen_s, off, rate)
        return self._estimate.at(t_s)


class FormationFollowing:
    """The deviations D of all followers from the plan, at rising plan times. `lead` may change the leader.

    `position_m`, `velocity_mps` and `acceleration_mps2` are (F, 3), in the order of `followers`. `graph` is whom each
    row of the plan listens to now.
    """

    def __init__(self, plan: Plan, t0_unix_s: float, followers: Mapping[int, FollowerState]) -> None:
        self.plan = plan
        self._t0_unix_s = t0_unix_s
        self._listening = [plan.sysids.index(sysid) for sysid in followers]  # rows of the plan
        self._reported = {
            row: ReportedDeviation(one.view, row, t0_unix_s)
            for row, one in zip(self._listening, followers.values(), strict=True)
        }
        self._leader = plan.leader
        self._followers = tuple(followers.values())
        self._index = {sysid: n for n, sysid in enumerate(followers)}
        shape = (len(followers), 3)
        self.position_m, self.velocity_mps, self.acceleration_mps2 = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        self._soft = np.zeros(shape)
        self._accel_mps2 = accel_bound_mps2(plan.scenario)
        self._t_s = math.nan
        # Rows of the plan that are no vehicles of this flight: none of its followers, and not the leader.
        self._absent = frozenset(range(len(plan.sysids))) - self._reported.keys()
        self._broken: dict[int, str] = {}  # rows whose reports nobody uses, and why
        self._whole = self.graph = InformationGraph(())
        self._look_s, self._offsets_m = -math.inf, np.full((len(plan.sysids), 3), np.inf)

    def follow(self, plan: Plan) -> None:
        """The vehicles fly another plan from an instant ahead on."""
        self.plan = plan

    def lead(self, view: VehicleView) -> None:
        """Make this vehicle the leader."""
        self._leader = row = self.plan.sysids.index(view.sysid)
        self._reported[row] = ReportedDeviation(view, row, self._t0_unix_s)
        self._absent -= {row}
        self._broken.pop(row, None)
        self._look_s, self._offsets_m = -math.inf, np.full_like(self._offsets_m, np.inf)

    def heed(self, flying: Collection[int], t_s: float) -> list[LinkChange]:
        """Listen to the leader, and to those of these vehicles alone whose reports are young at plan time `t_s`.

        Returns the changes since the last call by which somebody listens to another vehicle.
        """
        self._look(t_s)
        old, before = self.graph, self._broken
        rows = self._reported.keys() - {self._leader}
        self._broken = {row: why for row in rows if (why := self._why_broken(row, flying, t_s))}
        if before.keys() == self._broken.keys():
            return []
        self._reroute()
        lost = [self._change(row, old, self._broken[row]) for row in sorted(self._broken.keys() - before.keys())]
        back = [self._change(row, self.graph, "") for row in sorted(before.keys() - self._broken.keys())]
        return [change for change in (*lost, *back) if change is not None]

    def _why_broken(self, row: int, flying: Collection[int], t_s: float) -> str:
        if self.plan.sysids[row] not in flying:
            return "it is not in its place in the formation"
        age_s = self._reported[row].age_s(t_s)
        return f"its last report is {age_s:.1f} s old" if age_s > self._oldest_s(row) else ""

    def _oldest_s(self, row: int) -> float:
        return REPORT_MAX_S if row in self._broken else LINK_MAX_S

    def _change(self, row: int, heard_in: InformationGraph, why: str) -> LinkChange | None:
        """What became of a row to which somebody listens in that graph; None if nobody does."""
        sysids = self.plan.sysids
        unheard = self._absent | self._broken.keys()
        listeners = [n for n, sources in enumerate(heard_in.sources) if row in sources and n not in unheard]
        if not listeners:
            return None
        if not why:
            return LinkChange(sysids[row], "is listened to again", f"by {_named(sysids[n] for n in listeners)}")
        instead = (
            f"vehicle {sysids[n]} listens to {_named(sysids[s] for s in self.graph.sources[n])}" for n in listeners
        )
        return LinkChange(sysids[row], "is not listened to any more", "; ".join((why, *instead)))

    def _look(self, t_s: float) -> None:
        """Make the graph for the shape at plan time `t_s`, where the last one was made for another shape."""
        if t_s < self._look_s:
            return
        self._look_s = t_s + REMADE_S
        plan = self.plan
        offsets_m = plan.shape.at(min(max(t_s, plan.t_start_s), float(np.nextafter(plan.t_end_s, -np.inf))))
        if np.linalg.norm(offsets_m - self._offsets_m, axis=1).max() >= REMADE_M:
            self._offsets_m = offsets_m
            self._whole = information_graph(plan.scenario.formation.topology, offsets_m, self._leader)
            self._reroute()

    def _reroute(self) -> None:
        self.graph = self._whole.without(self._absent | self._broken.keys())

    def at(self, sysid: int, t_s: float) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration (3,) of a follower's D at plan time `t_s`."""
        self.advance(t_s)
        n = self._index[sysid]
        back_s = self._t_s - t_s  # another vehicle's setpoints are sent earlier
        velocity, acceleration = self.velocity_mps[n], self.acceleration_mps2[n]
        if not 0.0 < back_s < 1.0:
            return self.position_m[n], velocity, acceleration
        return self.position_m[n] - velocity * back_s, velocity, acceleration

    def advance(self, t_s: float) -> None:
        """Bring all deviations to plan time `t_s`."""
        if math.isnan(self._t_s):
            self._t_s = t_s
        if self._t_s >= t_s - 1e-9:
            return
        off, rate = self._wanted(t_s)
        w, limit = BANDWIDTH_RADPS, self._accel_mps2
        while self._t_s < t_s - 1e-9:
            step_s = min(_STEP_S, t_s - self._t_s)
            pull = w * w * (off - self.position_m) + 2.0 * w * (rate - self.velocity_mps)
            size = np.linalg.norm(pull, axis=1, keepdims=True)
            wanted = pull * (limit / np.maximum(size, limit))
            share = -math.expm1(-step_s / SOFT_S)
            self._soft = self._soft + share * (wanted - self._soft)
            self.acceleration_mps2 = self.acceleration_mps2 + share * (self._soft - self.acceleration_mps2)
            self.position_m = self.position_m + self.velocity_mps * step_s + self.acceleration_mps2 * step_s**2 / 2
            self.velocity_mps = self.velocity_mps + self.acceleration_mps2 * step_s
            self._t_s += step_s

    def _wanted(self, t_s: float) -> tuple[Array, Array]:
        """Return x and k x', (F, 3) each: the deviation listened to less the follower's own, less what is ignored."""
        self._look(t_s)
        weights = self.graph.weights[self._listening]
        off, rate = np.zeros((2, len(self.graph.sources), 3))
        for row in np.flatnonzero(weights.any(axis=0)).tolist():
            off[row], rate[row] = self._reported[row].at(self.plan, t_s)
        own = [one.tracking_error(self._t0_unix_s + t_s) for one in self._followers]
        off = weights @ off - np.array([off_m for off_m, _ in own]).reshape(-1, 3)
        rate = weights @ rate - np.array([off_mps for _, off_mps in own]).reshape(-1, 3)
        size = np.linalg.norm(off, axis=1, keepdims=True)
        share = 1.0 - IGNORED_M / np.maximum(size, IGNORED_M)
        return share * off, (RELAYED_RATE if self.graph.relays else 1.0) * share * rate


def _named(sysids: Iterable[int]) -> str:
    """The vehicles in words."""
    found = [str(sysid) for sysid in sysids]
    return f"vehicle {found[0]}" if len(found) == 1 else f"vehicles {', '.join(found[:-1])} and {found[-1]}"


class FollowReference:
    """One follower's planned setpoints, moved by its D."""

    def __init__(self, base: PlanReference, following: FormationFollowing, sysid: int) -> None:
        self._base = base
        self._following = following
        self._sysid = sysid

    def at(self, k: int, t_s: float) -> Values:
        """Return the planned setpoint plus D; at rest from the plan's last one on."""
        values = self._base.at(k, t_s)
        off, velocity, acceleration = self._following.at(self._sysid, t_s)
        place = (values[0] + float(off[0]), values[1] + float(off[1]), values[2] + float(off[2]))
        if k >= self._base.last:
            return (*place, *values[3:])
        motion = np.array(values[3:9])
        motion[:3] += velocity
        motion[3:] += acceleration
        return (*place, *motion.tolist(), values[9])
