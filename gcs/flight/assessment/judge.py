"""The verdict on a flight: the criteria of the scenario's `[judge]`, from true states, or from what vehicles reported.

True states decide every criterion. Reports are only known within an uncertainty: where that spans a limit, the
criterion is not known.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.distance import pdist

from gcs.errors import FileFormatError
from gcs.flight.assessment.criterion import GRID_S, Criterion, CriterionName, Figures, FlightOutcome
from gcs.flight.assessment.route_passing import route_criterion
from gcs.flight.monitoring.progress import FlightTimes, PlanTime
from gcs.mission.returns.fence_areas import inclusion_corners, inside_m, planned_places_m
from gcs.physics.states import POSITION, VELOCITY, NamedStates
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.ground_distance import ground_distance_m
from gcs.scenario.environment.no_fly import nearest_zone_m
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.values.navigation_error import judged_separation_m, navigation_error
from gcs.types import Array
from gcs.util.archives import ArrayKind, read_arrays
from gcs.util.bounded_file import MIB, TRUTH_FILE, open_regular, refuse_size

_MOST = 2048 * MIB  # the file is not packed: it is as large as its arrays
_TRUTH = {
    "t_s": ArrayKind("f8", 1, _MOST),
    "t_unix_s": ArrayKind("f8", 1, _MOST),
    "state": ArrayKind("f8", 3, _MOST),
    "control": ArrayKind("f8", 3, _MOST),
    "armed": ArrayKind("?", 2, _MOST),
    "flying": ArrayKind("?", 2, _MOST),
    "mode": ArrayKind("i8", 2, _MOST),
    "sysid": ArrayKind("i8", 1, _MOST),
    "boot_offset_s": ArrayKind("f8", 1, _MOST),
}


@dataclass(frozen=True)
class Tracks:
    """Positions at plan times, vehicles in the plan's order, and how far the true ones may be from them."""

    t_s: Array  # (N,)
    ned_m: Array  # (V, N, 3)
    horizontal_m: Array = field(default_factory=lambda: np.zeros((1, 1)))  # (V, N), or (1, 1) for true positions
    vertical_m: Array = field(default_factory=lambda: np.zeros((1, 1)))
    off_plan: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(1, dtype=np.bool_))  # (N,), or (1,)

    @property
    def within_m(self) -> Array:
        """How far true positions may be (V, N), in any direction."""
        return np.broadcast_to(np.hypot(self.horizontal_m, self.vertical_m), self.ned_m.shape[:2])

    def during(self, chosen: NDArray[np.bool_]) -> Tracks:
        """The tracks at some of the times (N,)."""

        def some(metres: Array) -> Array:
            return metres if metres.shape == (1, 1) else metres[:, chosen]

        off_plan = np.broadcast_to(self.off_plan, self.t_s.shape)[chosen]
        places = self.ned_m[:, chosen]
        return Tracks(self.t_s[chosen], places, some(self.horizontal_m), some(self.vertical_m), off_plan)


def area_criteria(plan: Plan, everywhere: Tracks, airborne: Tracks) -> list[Criterion]:
    """The criteria that apply to a plan: zones and fence from pad to pad, the height between the hovers.

    A vehicle must be outside every no-fly zone and inside every keep-in area: there the plan has left room for the
    navigation error. The ceiling is a limit of the plan alone, which may touch it: the flight may exceed it by the
    navigation error.
    """
    found, scenario = [], plan.scenario
    t_s, places, within_m = everywhere.t_s, everywhere.ned_m, everywhere.horizontal_m
    since_s = plan.zones_since_s[len(scenario.keep_in) :]
    kinds = (CriterionName.ZONES, scenario.no_fly, since_s), (CriterionName.KEEP_IN, scenario.keep_in, ())
    for name, zones, from_s in kinds:
        if zones:
            away_m = nearest_zone_m(zones, t_s, places[..., 0], places[..., 1], -places[..., 2], from_s)
            has_heights = any(zone.height_m is not None for zone in zones)
            figures = Figures(plan.sysids, t_s, away_m, everywhere.within_m if has_heights else within_m)
            found.append(figures.at_least(name, 0.0, scenario.limits.zone_margin_m))
    inside = inside_m(inclusion_corners(planned_places_m(plan)), places)
    found.append(Figures(plan.sysids, t_s, inside, within_m).at_least(CriterionName.FENCE, 0.0))
    ceiling_m = scenario.limits.height_m[1]
    limit_m = round(ceiling_m + navigation_error(scenario).vertical_m, 3)
    heights = Figures(plan.sysids, airborne.t_s, -airborne.ned_m[..., 2], airborne.vertical_m)
    return [*found, heights.at_most(CriterionName.HEIGHT, limit_m, ceiling_m)]


@dataclass(frozen=True)
class Verdict:
    """All criteria, and the position error of each vehicle."""

    criteria: tuple[Criterion, ...]
    rms_m: dict[int, float]
    max_m: dict[int, float]
    formation_error_m: float  # Definition 1, the largest between T0 and the arrival
    off_plan_s: float = 0.0  # of that time, what a standstill led the vehicles off the plan: no position error counts

    @property
    def not_counted(self) -> str:
        """The time in which no position error counts, in words; empty without any."""
        words = f"position errors do not count {self.off_plan_s:g} s from a standstill until all were on the plan again"
        return words if self.off_plan_s else ""

    @property
    def outcome(self) -> FlightOutcome:
        """Failed if one criterion failed, else not known if one is not known."""
        found = {c.outcome for c in self.criteria}
        return next((one for one in (FlightOutcome.FAILED, FlightOutcome.UNKNOWN) if one in found), FlightOutcome.OK)

    @property
    def ok(self) -> bool:
        """Whether all criteria are known to be within their limits."""
        return self.outcome is FlightOutcome.OK


def judge(plan: Plan, truth: Truth, times: FlightTimes) -> Verdict:
    """Return the verdict on the true flight against plan and scenario.

    Separation counts from T0 to the order to land, and again in the ground phases: from the pads to T0, and from the
    order to land to the last stop. The distance to the exact ground, in any direction, counts from the hover after
    take-off to the order to land, and so does the height; no-fly zones and the fence count from the pads to the last
    stop. The position error counts from T0 to the planned arrival, but for the time in which a
    standstill of this program led the vehicles off the plan. The arrival is the last entry into the circle of
    `arrival_position_m` around the goal, against the time at which the plan enters it. At each route point
    every vehicle must come as near to its place, within 3 s (or `arrival_time_s`) of the planned time.
    """
    states = np.asarray(truth.states[[truth.sysids.index(sysid) for sysid in plan.sysids]])
    first_s, last_s = (s - times.t0_unix_s for s in (times.airborne_unix_s, times.landing_unix_s))
    grid_s = np.arange(np.ceil(first_s / GRID_S), np.floor(last_s / GRID_S) + 1) * GRID_S
    path = CubicHermiteSpline(truth.t_s(times.t0_unix_s), states[..., POSITION], states[..., VELOCITY], axis=1)
    t_s = times.plan_time.t_s(grid_s + times.t0_unix_s)
    everywhere = Tracks(times.plan_time.t_s(truth.unix_s), states[..., POSITION])
    off_plan = times.plan_time.off_plan(grid_s + times.t0_unix_s)
    return judge_tracks(plan, everywhere, Tracks(t_s, np.asarray(path(grid_s)), off_plan=off_plan))


def judge_tracks(plan: Plan, everywhere: Tracks, airborne: Tracks) -> Verdict:
    """Return the verdict on tracks from pad to pad, and on those between the hover and the order to land."""
    limits, t_s, flown = plan.scenario.judge, airborne.t_s, airborne.ned_m
    planned = plan.states(np.clip(t_s, plan.t_start_s, plan.t_end_s))[..., POSITION]
    error = np.linalg.norm(flown - planned, axis=-1)
    mission = (t_s >= 0.0) & (t_s <= plan.flight_s)
    off_plan = mission & airborne.off_plan
    mission &= ~off_plan
    rms, within = (np.sqrt(np.mean(m[:, mission] ** 2, axis=1)) for m in (error, airborne.within_m))
    errors = Figures(plan.sysids, t_s, rms[:, None], within[:, None])
    criteria = [replace(errors.at_most(CriterionName.POSITION_RMS, limits.position_rms_m), t_s=None)]
    criteria.append(_clearance(plan, airborne))
    criteria += area_criteria(plan, everywhere, airborne)
    if plan.passages:
        criteria.append(route_criterion(plan, t_s, flown, airborne.within_m))
    criteria += _arrivals(plan, airborne, planned)
    if len(plan.sysids) > 1:
        criteria += _separations(plan, everywhere)
    return Verdict(
        tuple(criteria),
        dict(zip(plan.sysids, rms.tolist(), strict=True)),
        dict(zip(plan.sysids, error[:, mission].max(axis=1).tolist(), strict=True)),
        float(plan.formation_error_m(t_s[mission], flown[:, mission]).max()),
        round(GRID_S * int(off_plan.sum()), 1),
    )


def _separations(plan: Plan, tracks: Tracks) -> list[Criterion]:
    """On the plan and in the ground phases, against one limit: two vehicles collide at the same distance everywhere.

    Vehicles may stand on their pads: these are as far apart as `limits.separation_min_m`, which is not below the limit.
    Errors of two vehicles are independent, and add as squares.
    """
    on_plan = (tracks.t_s >= 0.0) & (tracks.t_s <= plan.landing_s)
    limit, planned_m = judged_separation_m(plan.scenario), plan.scenario.limits.separation_min_m
    first, second = np.triu_indices(len(plan.sysids), 1)
    known = tracks.horizontal_m.shape == (1, 1)
    found = []
    for name, instants in ((CriterionName.SEPARATION, on_plan), (CriterionName.GROUND_SEPARATION, ~on_plan)):
        if not instants.any():
            continue
        least, lowest, highest, nearest = np.inf, np.inf, np.inf, (0, 0)
        for n in np.flatnonzero(instants).tolist():
            between_m = pdist(tracks.ned_m[:, n])
            lost = np.broadcast_to(np.isinf(tracks.within_m[:, n]), len(plan.sysids))
            between_m[lost[first] | lost[second]] = np.inf
            pair = int(np.argmin(between_m))
            if between_m[pair] < least:
                least, nearest = float(between_m[pair]), (n, pair)
            if known:
                continue
            beside_m, above_m = pdist(tracks.ned_m[:, n, :2]), pdist(tracks.ned_m[:, n, 2:])
            beside_off, above_off = (
                np.hypot(m[first, n], m[second, n]) for m in (tracks.horizontal_m, tracks.vertical_m)
            )
            nearer = np.hypot(np.maximum(beside_m - beside_off, 0.0), np.maximum(above_m - above_off, 0.0))
            lowest = min(lowest, float(nearer.min()))
            highest = min(highest, float(np.hypot(beside_m + beside_off, above_m + above_off).min()))
        instant, pair = nearest
        sysid, other = plan.sysids[first[pair]], plan.sysids[second[pair]]
        bounds = (None, None) if known else (lowest, highest)
        found.append(
            Criterion(name, "m", least, limit, True, sysid, float(tracks.t_s[instant]), other, planned_m, *bounds)
        )
    return found


def _clearance(plan: Plan, tracks: Tracks) -> Criterion:
    terrain, (north_m, east_m, up_m) = plan.scenario.terrain, np.moveaxis(tracks.ned_m * (1.0, 1.0, -1.0), -1, 0)
    lowest_m = float((up_m - ground_height_m(terrain, north_m, east_m)).min())  # the least distance is no more
    above = ground_distance_m(terrain, north_m, east_m, up_m, lowest_m)
    figures = Figures(plan.sysids, tracks.t_s, above, tracks.within_m)
    return figures.at_least(CriterionName.CLEARANCE, 0.0, plan.scenario.limits.clearance_min_m)


def _arrivals(plan: Plan, tracks: Tracks, planned: Array) -> list[Criterion]:
    limits, t_s = plan.scenario.judge, tracks.t_s
    goal = plan.states(np.array([plan.flight_s]))[:, 0, POSITION][:, None]
    at_end = np.searchsorted(t_s, plan.flight_s)
    missed, within = np.linalg.norm(tracks.ned_m - goal, axis=-1), tracks.within_m
    end = slice(at_end, at_end + 1)
    when_s, limit_m = np.array([plan.flight_s]), limits.arrival_position_m
    figures = Figures(plan.sysids, when_s, missed[:, end], within[:, end])
    there = figures.at_most(CriterionName.ARRIVAL_POSITION, limit_m)
    away = np.linalg.norm(planned - goal, axis=-1)
    edges_m = [_edge_m(plan, t_s, distance_m) for distance_m in away]
    due, entered, first, last = (
        np.array([_last_entry(t_s, d, edge_m) for d, edge_m in zip(distances, edges_m, strict=True)])
        for distances in (away, missed, missed - within, missed + within)
    )
    late, heard = np.abs(entered - due), np.isfinite(within).all(axis=1)
    latest = int(np.argmax(np.where(heard, late, -np.inf) if heard.any() else late))
    bounds = np.abs(first - due), np.abs(last - due)
    least = np.where((first <= due) & (due <= last), 0.0, np.minimum(*bounds))
    name, value_s, limit_s = CriterionName.ARRIVAL_TIME, float(late[latest]), limits.arrival_time_s
    low_s, high_s = float(least.max()), float(np.maximum(*bounds).max())
    sysid = plan.sysids[latest]
    return [there, Criterion(name, "s", value_s, limit_s, False, sysid, lowest=low_s, highest=high_s)]


def _edge_m(plan: Plan, t_s: Array, away_m: Array) -> float:
    """The radius of the circle that a vehicle arrives in, m: a smaller one where the plan waits at its edge.

    `away_m` (N,) is the planned distance from the goal. A figure of a show may stand at the edge of the circle: then
    centimetres would decide whether the vehicle came in with the figure, or on its way home.
    """
    judged = plan.scenario.judge
    radius_m = judged.arrival_position_m
    error_m = min(navigation_error(plan.scenario).horizontal_m, radius_m / 4)

    def entry_lasts_s(edge_m: float) -> float:
        return _last_entry(t_s, away_m, edge_m - error_m) - _last_entry(t_s, away_m, edge_m + error_m)

    if entry_lasts_s(radius_m) <= judged.arrival_time_s:
        return radius_m
    return min(radius_m, radius_m - 2 * error_m, key=entry_lasts_s)


def _last_entry(t_s: Array, distance_m: Array, radius_m: float) -> float:
    """Return when the distance last fell below the radius; infinite if it ends outside."""
    outside = np.flatnonzero(distance_m > radius_m)
    if len(outside) == 0:
        return float(t_s[0])
    last = int(outside[-1])
    if last + 1 >= len(t_s):
        return float("inf")
    if not np.isfinite(distance_m[last]):
        return float(t_s[last + 1])
    share = (distance_m[last] - radius_m) / (distance_m[last] - distance_m[last + 1])
    return float(t_s[last] + share * (t_s[last + 1] - t_s[last]))


@dataclass(frozen=True)
class Truth:
    """True states on a common clock, in the formation's local NED frame."""

    sysids: tuple[int, ...]
    unix_s: Array  # (N,) GNSS time
    states: Array  # (V, N, 12)

    @property
    def named(self) -> NamedStates:
        """The states, their columns by name."""
        return NamedStates(self.states)

    def t_s(self, t0_unix_s: float) -> Array:
        """The plan times (N,) of the states. `Flown.times` and `flight.json` have T0."""
        return self.unix_s - t0_unix_s

    def __post_init__(self) -> None:
        if self.states.shape != (len(self.sysids), len(self.unix_s), 12):
            raise ValueError(f"states must be (V, N, 12), not {self.states.shape}")


def load_truth(path: Path | str) -> Truth:
    """Return the true states of a flight: of its folder, or a `truth.npz`. Raises FileFormatError."""
    path = Path(path)
    path = path / "truth.npz" if path.is_dir() else path
    hint = "read simulator.log beside it: the simulator writes them when it ends"
    try:
        with os.fdopen(open_regular(path, hint=hint), "rb") as file:
            refuse_size(path, os.fstat(file.fileno()).st_size, TRUTH_FILE)
            found = read_arrays(file, _TRUTH, wanted=("sysid", "t_unix_s", "state"), stored=True)
        if not all(np.isfinite(values).all() for values in found.values()):
            raise ValueError("a value is not a finite number")
        if len(found["t_unix_s"]) < 2 or not (np.diff(found["t_unix_s"]) > 0.0).all():
            raise ValueError("times do not increase")
        return Truth(tuple(found["sysid"].tolist()), found["t_unix_s"], found["state"])
    except (OSError, ValueError) as problem:
        raise FileFormatError(f"{path} has no true states of a simulated flight: {problem}.", hint=hint) from problem


_ACCELERATION_MPS2 = 5.0  # of a vehicle that leans by 27 degrees
_FAR_S = 3600.0  # before the take-off and after the landing
_ENDS_S = 3.0  # a vehicle whose reports end with those of all others was not lost
_AXES = ("north", "east", "down")
_FORMS = ("{}_m", "v_{}_mps")


def judge_reports(plan: Plan, tracks: Tracks) -> Verdict | None:
    """Return the verdict on a flight from `reported_tracks`. It counts what `judge` counts, in plan time.

    None where nothing was reported between T0 and the planned arrival.
    """
    on_plan = (tracks.t_s >= 0.0) & (tracks.t_s <= plan.flight_s) & ~tracks.off_plan
    if not on_plan.any() or np.isnan(tracks.ned_m).any():
        return None
    landing_s = plan.landing_s
    return judge_tracks(plan, tracks, tracks.during((tracks.t_s >= plan.airborne_s) & (tracks.t_s <= landing_s)))


def reported_tracks(plan: Plan, record: pa.Table, plan_time: PlanTime) -> Tracks | None:
    """Return the tracks of a flight's record from its first armed report to its last one; None without any.

    Reports of a time far from the plan's are those of a broken clock, and left out.
    """
    t_s = record.column("t_s").to_numpy()
    record = record.filter(pa.array((t_s > plan.t_start_s - _FAR_S) & (t_s < plan.t_end_s + _FAR_S)))
    columns = {name: record.column(name).to_numpy() for name in record.column_names}
    armed_s = columns["unix_s"][columns["armed"]]
    if not len(armed_s):
        return None
    unix_s = np.arange(armed_s.min(), armed_s.max(), GRID_S)
    places = np.full((len(plan.sysids), len(unix_s), 3), np.nan)
    horizontal_m, vertical_m = np.full((2, len(plan.sysids), len(unix_s)), np.inf)
    for row, sysid in enumerate(plan.sysids):
        mine = np.flatnonzero(columns["sysid"] == sysid)
        mine = mine[np.unique(columns["unix_s"][mine], return_index=True)[1]]
        if len(mine) < 2:
            continue
        reported_s = columns["unix_s"][mine]
        at = {form: np.stack([columns[form.format(axis)][mine] for axis in _AXES], axis=1) for form in _FORMS}
        places[row] = CubicHermiteSpline(reported_s, *at.values())(np.clip(unix_s, reported_s[0], reported_s[-1]))
        after = np.clip(np.searchsorted(reported_s, unix_s), 1, len(mine) - 1)
        strayed_m = _ACCELERATION_MPS2 * (reported_s[after] - reported_s[after - 1]) ** 2 / 8.0
        ends_early = bool(columns["armed"][mine[-1]]) and reported_s[-1] < armed_s.max() - _ENDS_S
        lost = (unix_s > reported_s[-1]) & ends_early
        for name, within in (("horizontal_within_m", horizontal_m), ("vertical_within_m", vertical_m)):
            reported_m = columns[name][mine]
            within[row] = np.maximum(reported_m[after - 1], reported_m[after]) + strayed_m
            within[row, lost] = np.inf
    return Tracks(plan_time.t_s(unix_s), places, horizontal_m, vertical_m, plan_time.off_plan(unix_s))
