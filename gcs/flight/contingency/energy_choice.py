"""The choice for a vehicle whose battery runs low: finish the plan, land at a safe point, return, or land here.

Every alternative has its need: metres by the route, seconds, and percent of a full battery. The need is the plan's
energy, or that of steady legs, scaled by the measured discharge. The first alternative that leaves the reserve is
chosen: the plan's end, then the cheaper of return and nearest safe point, then here. If none leaves the reserve, the
one with the least need is chosen. A vehicle over its landing point in the landing phase always lands there.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum

import numpy as np

from gcs.autopilots.columns import LandingProfile
from gcs.flight.monitoring.monitor import VehicleView
from gcs.mission.returns.rtl_altitudes import ReturnPlan
from gcs.plan.trajectory.energy import BatteryModel
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.terrain import ground_envelope_m
from gcs.types import Array, JsonObject

WayLength = Callable[[Array, Array], float]  # from (3,), to (3,) -> metres by the route
_PRIOR = 0.01  # of a full battery: the weight of the model against the measured discharge
_STANDS = 1.0 / 3.0  # of the expected discharge: a gauge that shows less measures something else
_JUMP = 0.03  # a larger step between two reports is no discharge
_BRAKE_MPS2 = 1.5
_OVER_M = 10.0  # horizontally: over its landing point


class Outcome(StrEnum):
    """What a vehicle with a low battery may do."""

    FINISH = "finish"
    NEAREST = "land at the nearest safe point"
    RETURN = "return"
    LAND = "land here"


_RANK = {Outcome.FINISH: 0, Outcome.NEAREST: 1, Outcome.RETURN: 1, Outcome.LAND: 2}  # whatever is left


@dataclass(frozen=True)
class EnergyOption:
    """One outcome and its need. `reachable`: the reserve is left after it."""

    outcome: Outcome
    target: str
    distance_m: float
    duration_s: float
    need_pct: float
    reachable: bool = False
    target_ned_m: tuple[float, float, float] | None = None

    def __str__(self) -> str:
        where = f" ({self.target})" if self.target else ""
        return f"{self.outcome}{where} needs {self.need_pct:.1f} %, {self.duration_s:.0f} s, {self.distance_m:.0f} m"


@dataclass(frozen=True)
class EnergyChoice:
    """The chosen alternative among all, with the charge and the reserve that decided."""

    chosen: EnergyOption
    alternatives: tuple[EnergyOption, ...]
    remaining_pct: float
    reserve_pct: float

    def __str__(self) -> str:
        others = "; ".join(str(one) for one in self.alternatives if one is not self.chosen)
        head = f"{self.remaining_pct:.0f} % left, reserve {self.reserve_pct:.0f} %: {self.chosen}"
        return f"{head}. Not chosen: {others}" if others else head

    def short(self) -> str:
        """Return the chosen alternative in words."""
        return f"{self.remaining_pct:.0f} % left: {self.chosen}"

    def data(self) -> JsonObject:
        """Return the choice as plain values, for `events.jsonl`."""
        return {
            "chosen": self.chosen.outcome.value,
            "remaining_pct": self.remaining_pct,
            "reserve_pct": self.reserve_pct,
            "alternatives": [{key: _plain(value) for key, value in asdict(one).items()} for one in self.alternatives],
        }


@dataclass
class Discharge:
    """The measured discharge of one battery beside the modelled one. `scale` is their ratio, `prior` at the start."""

    used: float = 0.0
    modelled: float = 0.0
    prior: float = 1.0
    _last: float | None = None
    _pending: float = 0.0

    def expect(self, modelled: float) -> None:
        """Take in what the model says was used since the last call."""
        self._pending += modelled

    def report(self, share: float) -> None:
        """Take in a reported share of a full battery. A sudden step counts as another battery reading, not as use."""
        if self._last is not None and 0.0 <= self._last - share <= _JUMP:
            self.used += self._last - share
            self.modelled += self._pending
        self._last = share
        self._pending = 0.0

    @property
    def scale(self) -> float:
        """The factor on every modelled need; that of the start where a gauge stands still in flight."""
        measured = (self.used + _PRIOR * self.prior) / (self.modelled + _PRIOR)
        return self.prior if measured < _STANDS * self.prior else measured


@dataclass(frozen=True)
class SafePoint:
    """A place to land at that is free of other vehicles."""

    name: str
    ned_m: Array


@dataclass(frozen=True)
class EnergySituation:
    """What the needs of one vehicle depend on. `plan_time_s` None: it does not fly the plan."""

    row: int
    place_ned_m: Array
    velocity_ned_mps: Array
    remaining_pct: float
    plan_time_s: float | None
    scale: float = 1.0
    points: Sequence[SafePoint] = field(default_factory=tuple)
    heading: SafePoint | None = None  # where a vehicle that left the plan flies to; "finish" is to land there


def straight_m(start: Array, end: Array) -> float:
    """The length of a straight track over the ground."""
    return float(np.hypot(*(np.asarray(end) - np.asarray(start))[:2]))


def choose(alternatives: Sequence[EnergyOption], remaining_pct: float, reserve_pct: float) -> EnergyChoice:
    """Return the choice among alternatives; at least one is needed."""
    marked = tuple(replace(one, reachable=one.need_pct + reserve_pct <= remaining_pct) for one in alternatives)
    preferred = sorted(marked, key=lambda one: (_RANK[one.outcome], one.need_pct))
    chosen = next((one for one in preferred if one.reachable), None) or min(preferred, key=lambda one: one.need_pct)
    return EnergyChoice(chosen, marked, remaining_pct, reserve_pct)


class EnergyAdviser:
    """Computes the alternatives of a plan's vehicles. `way_m` is the length of a route round no-fly zones."""

    def __init__(
        self,
        plan: Plan,
        model: BatteryModel,
        returns: ReturnPlan,
        way_m: WayLength = straight_m,
        landings: Mapping[int, LandingProfile] | None = None,
    ) -> None:
        """`landings`: how vehicles land, by system id; one without lands as the scenario's autopilot does."""
        self._plan = plan
        self.model = model
        self.returns = returns
        self._way_m = way_m
        given = landings or {}
        rows = zip(plan.sysids, plan.autopilots, strict=True)
        self._landings = [given.get(sysid) or known.traits.landing.profile() for sysid, known in rows]

    def follow(self, plan: Plan, model: BatteryModel, returns: ReturnPlan) -> None:
        """Take the needs of another plan."""
        self._plan, self.model, self.returns = plan, model, returns

    def committed(self, now: EnergySituation) -> bool:
        """Whether a vehicle is over its landing point in the landing phase: it lands there, whatever is left."""
        if now.plan_time_s is None or now.plan_time_s < self._plan.landing_s:
            return False
        return straight_m(now.place_ned_m, self._plan.landing_points_ned_m[now.row]) < _OVER_M

    def decide(self, now: EnergySituation, reserve_pct: float) -> EnergyChoice:
        """Return the choice of one vehicle."""
        found = self.alternatives(now)
        if self.committed(now):
            found = tuple(one for one in found if one.outcome is Outcome.FINISH)
        return choose(found, now.remaining_pct, reserve_pct)

    def alternatives(self, now: EnergySituation) -> tuple[EnergyOption, ...]:
        """Return every alternative with its need."""
        plan, row = self._plan, now.row
        found = [] if now.plan_time_s is None else [self._finish(now, now.plan_time_s)]
        if now.plan_time_s is None and now.heading is not None:
            found = [self._to_point(now, Outcome.FINISH, now.heading)]
        points = [SafePoint("own landing point", plan.landing_points_ned_m[row]), *now.points]
        ways = [self._to_point(now, Outcome.NEAREST, point) for point in points]
        found.append(min(ways, key=lambda one: one.need_pct))
        found.append(self._to_point(now, Outcome.RETURN, SafePoint("own pad", plan.pads_ned_m[row])))
        north_m, east_m, down_m = map(float, now.place_ned_m)
        ground_m = float(np.asarray(ground_envelope_m(plan.scenario.terrain, north_m, east_m)))
        sink_s, sink_need = self._descent(now, down_m, -ground_m)
        found.append(EnergyOption(Outcome.LAND, "", 0.0, sink_s, 100.0 * sink_need))
        return tuple(found)

    def _finish(self, now: EnergySituation, t_s: float) -> EnergyOption:
        """The rest of the plan; in its landing phase a descent with the landing's own speeds."""
        plan, row = self._plan, now.row
        landing_s = plan.landing_s
        start_s = min(t_s, landing_s)
        places = plan.states(np.linspace(start_s, landing_s, 60))[row, :, :3]
        over = places[-1]
        speeds = self.returns.speeds
        off_m = straight_m(now.place_ned_m, places[0])
        flown_m = off_m + float(np.linalg.norm(np.diff(places[:, :2], axis=0), axis=1).sum())
        top_down_m = float(now.place_ned_m[2] if t_s >= landing_s else over[2])
        sink_s, sink_need = self._descent(now, top_down_m, float(plan.landing_points_ned_m[row][2]))
        off_s = off_m / speeds.cruise_mps
        use = self.model.planned_use(row, start_s, landing_s) + off_s * self.model.use_per_s(speeds.cruise_mps)
        seconds = off_s + landing_s - start_s + sink_s
        return EnergyOption(Outcome.FINISH, "", flown_m, seconds, 100.0 * (now.scale * use + sink_need))

    def _to_point(self, now: EnergySituation, outcome: Outcome, point: SafePoint) -> EnergyOption:
        """A return to a point: brake, climb to the vehicle's own return altitude, fly the route, descend."""
        speeds, model, plan = self.returns.speeds, self.model, self._plan
        top_down_m = min(
            float(now.place_ned_m[2]), float(plan.pads_ned_m[now.row][2]) - self.returns.altitudes_m[now.row]
        )
        brake_s = float(np.linalg.norm(now.velocity_ned_mps)) / _BRAKE_MPS2
        climb_s = (float(now.place_ned_m[2]) - top_down_m) / speeds.climb_mps
        way_m = self._way_m(now.place_ned_m, point.ned_m)
        flat_s = way_m / speeds.cruise_mps
        sink_s, sink_need = self._descent(now, top_down_m, float(point.ned_m[2]))
        need = (
            (brake_s + speeds.wait_s) * model.hover_per_s
            + climb_s * model.use_per_s(0.0, speeds.climb_mps)
            + flat_s * model.use_per_s(speeds.cruise_mps)
        )
        seconds = brake_s + climb_s + flat_s + speeds.wait_s + sink_s
        north, east, down = map(float, point.ned_m)
        return EnergyOption(
            outcome,
            point.name,
            way_m,
            seconds,
            100.0 * (now.scale * need + sink_need),
            target_ned_m=(north, east, down),
        )

    def _descent(self, now: EnergySituation, top_down_m: float, ground_down_m: float) -> tuple[float, float]:
        """Seconds and share of the autopilot's own landing between two values of down. Its heights count from home."""
        home_down_m = float(self._plan.pads_ned_m[now.row, 2])
        seconds = self._landings[now.row].duration_s(home_down_m - top_down_m, home_down_m - ground_down_m)
        return seconds, now.scale * seconds * self.model.hover_per_s


def _plain(value: object) -> object:
    """A number that JSON knows, with two decimals; null for an alternative without a route."""
    if isinstance(value, float):
        return round(value, 2) if math.isfinite(value) else None
    return list(value) if isinstance(value, tuple) else value


class ChargeWatch:
    """Follows the discharge of a plan's vehicles by their reports. Time is an argument."""

    def __init__(self, plan: Plan, adviser: EnergyAdviser) -> None:
        self._rows = {sysid: row for row, sysid in enumerate(plan.sysids)}
        self._adviser = adviser
        self._discharge = {sysid: Discharge() for sysid in plan.sysids}
        self._seen_s: dict[int, float] = {}

    def follow(self, plan: Plan, model: BatteryModel, returns: ReturnPlan) -> None:
        """Take the needs of another plan; what was measured stays."""
        self._adviser.follow(plan, model, returns)

    @property
    def model(self) -> BatteryModel:
        """The modelled use."""
        return self._adviser.model

    @property
    def returns(self) -> ReturnPlan:
        """The returns of the plan."""
        return self._adviser.returns

    def expect(self, sysid: int, scale: float) -> None:
        """Begin anew with this measured factor on every modelled need of a vehicle."""
        self._discharge[sysid] = Discharge(prior=scale)

    def watch(self, sysid: int, unix_s: float, remaining_pct: int | None, plan_time_s: float | None) -> None:
        """Take in the charge of an airborne vehicle. `plan_time_s` None: it does not fly the plan now."""
        before_s = self._seen_s.get(sysid, unix_s)
        self._seen_s[sysid] = unix_s
        passed_s, model, discharge = max(unix_s - before_s, 0.0), self.model, self._discharge[sysid]
        if plan_time_s is None:
            discharge.expect(model.hover_per_s * passed_s)
        else:
            discharge.expect(model.planned_use(self._rows[sysid], plan_time_s - passed_s, plan_time_s))
        if remaining_pct is not None:
            discharge.report(remaining_pct / 100.0)

    def decide(
        self,
        view: VehicleView,
        remaining_pct: float,
        reserve_pct: float,
        plan_time_s: float | None,
        points: Sequence[SafePoint] = (),
        heading: SafePoint | None = None,
    ) -> EnergyChoice:
        """Return the choice of one vehicle. `plan_time_s` None: it left the plan; `heading` is where it flies to."""
        now = replace(
            self._situation(view),
            remaining_pct=remaining_pct,
            plan_time_s=plan_time_s,
            points=points,
            heading=heading,
        )
        return self._adviser.decide(now, reserve_pct)

    def needs(self, view: VehicleView) -> tuple[EnergyOption, ...]:
        """Return what a vehicle needs from here to each place that it may land at."""
        return self._adviser.alternatives(self._situation(view))

    def _situation(self, view: VehicleView) -> EnergySituation:
        scale = self._discharge[view.sysid].scale
        return EnergySituation(
            self._rows[view.sysid], view.position_ned_m, view.velocity_ned_mps, math.nan, None, scale
        )
