"""The verdict on a flight: the criteria of the scenario's `[judge]`, from true states, never from estimates."""

from __future__ import annotations

import os
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.distance import pdist

from gcs.errors import FileFormatError
from gcs.flight.assessment.criterion import Criterion
from gcs.flight.assessment.route_passing import route_criterion
from gcs.flight.monitoring.progress import FlightTimes
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

ZONES, KEEP_IN, FENCE, HEIGHT = "outside no-fly zones", "inside keep-in areas", "inside the fence", "height"
Flight = tuple[Array, Array]  # plan times (N,), true positions (V, N, 3), NED
GRID_S = 0.05
GROUND_SEPARATION = "separation near ground"
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


def area_criteria(plan: Plan, everywhere: Flight, airborne: Flight) -> list[Criterion]:
    """The criteria that apply to a plan: zones and fence from pad to pad, the height between the hovers.

    A vehicle must be outside every no-fly zone and inside every keep-in area: there the plan has left room for the
    navigation error. The ceiling is a limit of the plan alone, which may touch it: the flight may exceed it by the
    navigation error.
    """
    found, scenario = [], plan.scenario
    t_s, places = everywhere
    for name, zones in ((ZONES, scenario.no_fly), (KEEP_IN, scenario.keep_in)):
        if zones:
            away_m = nearest_zone_m(zones, t_s, places[..., 0], places[..., 1])
            found.append(_least(plan, name, away_m, t_s, 0.0, scenario.limits.zone_margin_m))
    found.append(_least(plan, FENCE, inside_m(inclusion_corners(planned_places_m(plan)), places), t_s, 0.0))
    ceiling_m = scenario.limits.height_m[1]
    t_s, places = airborne
    row, instant = np.unravel_index(int(np.argmax(-places[..., 2])), places.shape[:2])
    limit_m = round(ceiling_m + navigation_error(scenario).vertical_m, 3)
    highest_m, sysid = float(-places[row, instant, 2]), plan.sysids[row]
    found.append(Criterion(HEIGHT, "m", highest_m, limit_m, False, sysid, float(t_s[instant]), planned=ceiling_m))
    return found


def _least(
    plan: Plan, name: str, margin_m: Array, t_s: Array, limit_m: float, planned: float | None = None
) -> Criterion:
    row, instant = np.unravel_index(int(np.argmin(margin_m)), margin_m.shape)
    least_m, sysid = float(margin_m[row, instant]), plan.sysids[row]
    return Criterion(name, "m", least_m, limit_m, True, sysid, float(t_s[instant]), planned=planned)


@dataclass(frozen=True)
class Verdict:
    """All criteria, and the position error of each vehicle."""

    criteria: tuple[Criterion, ...]
    rms_m: dict[int, float]
    max_m: dict[int, float]
    formation_error_m: float  # Definition 1, the largest between T0 and the arrival

    @property
    def ok(self) -> bool:
        """Whether all criteria are within their limits."""
        return all(c.ok for c in self.criteria)


def judge(plan: Plan, truth: Truth, times: FlightTimes) -> Verdict:
    """Return the verdict on the true flight against plan and scenario.

    Separation counts from T0 to the order to land, and again in the ground phases: from the pads to T0, and from the
    order to land to the last stop. The distance to the exact ground, in any direction, counts from the hover after
    take-off to the order to land, and so does the height; no-fly zones and the fence count from the pads to the last
    stop. The position error counts from T0 to the planned arrival. The arrival is the last entry into the circle of
    `arrival_position_m` around the goal, against the time at which the plan enters it. Every vehicle must come as near
    to its place at each route point, within 3 s (or `arrival_time_s`) of the planned time.
    """
    limits = plan.scenario.judge
    positions = _in_plan_order(plan, truth)
    t_s, flown = _on_grid(truth, positions, times)
    planned = plan.states(np.clip(t_s, plan.t_start_s, plan.t_end_s))[..., POSITION]
    error = np.linalg.norm(flown - planned, axis=-1)
    mission = (t_s >= 0.0) & (t_s <= plan.flight_s)
    rms = np.sqrt(np.mean(error[:, mission] ** 2, axis=1))
    worst = int(np.argmax(rms))
    criteria = [
        Criterion("position error (RMS)", "m", float(rms[worst]), limits.position_rms_m, False, plan.sysids[worst])
    ]
    criteria.append(_clearance(plan, t_s, flown))
    everywhere = truth.t_s(times.t0_unix_s), positions[..., POSITION]
    criteria += area_criteria(plan, everywhere, (t_s, flown))
    if plan.passages:
        criteria.append(route_criterion(plan, t_s, flown))
    criteria += _arrivals(plan, t_s, flown, planned)
    if len(plan.sysids) > 1:
        criteria += _separations(plan, truth, positions, times)
    return Verdict(
        tuple(criteria),
        dict(zip(plan.sysids, rms.tolist(), strict=True)),
        dict(zip(plan.sysids, error[:, mission].max(axis=1).tolist(), strict=True)),
        float(plan.formation_error_m(t_s[mission], flown[:, mission]).max()),
    )


def _in_plan_order(plan: Plan, truth: Truth) -> Array:
    rows = [truth.sysids.index(sysid) for sysid in plan.sysids]
    return np.asarray(truth.states[rows])


def _on_grid(truth: Truth, states: Array, times: FlightTimes) -> tuple[Array, Array]:
    """Plan times (N,) from hovering to the order to land, and true positions (V, N, 3) at them."""
    start_s = times.airborne_unix_s - times.t0_unix_s
    end_s = times.landing_unix_s - times.t0_unix_s
    t_s = np.arange(np.ceil(start_s / GRID_S), np.floor(end_s / GRID_S) + 1) * GRID_S
    path = CubicHermiteSpline(truth.unix_s - times.t0_unix_s, states[..., POSITION], states[..., VELOCITY], axis=1)
    return t_s, np.asarray(path(t_s))


def _separations(plan: Plan, truth: Truth, states: Array, times: FlightTimes) -> list[Criterion]:
    """On the plan and in the ground phases, against one limit: two vehicles collide at the same distance everywhere.

    Vehicles may stand on their pads: these are as far apart as `limits.separation_min_m`, which is not below the limit.
    """
    on_plan = (truth.unix_s >= times.t0_unix_s) & (truth.unix_s <= times.landing_unix_s)
    pairs = list(combinations(plan.sysids, 2))
    found = []
    for name, instants in (("separation", on_plan), (GROUND_SEPARATION, ~on_plan)):
        if not instants.any():
            continue
        least, nearest = np.inf, (0, 0)
        for n in np.flatnonzero(instants).tolist():
            between_m = pdist(states[:, n, POSITION])
            pair = int(np.argmin(between_m))
            if between_m[pair] < least:
                least, nearest = float(between_m[pair]), (n, pair)
        instant, pair = nearest
        sysid, other = pairs[pair]
        t_s = float(truth.unix_s[instant] - times.t0_unix_s)
        limit = judged_separation_m(plan.scenario)
        planned_m = plan.scenario.limits.separation_min_m
        found.append(Criterion(name, "m", least, limit, True, sysid, t_s, other, planned_m))
    return found


def _clearance(plan: Plan, t_s: Array, flown: Array) -> Criterion:
    terrain, north_m, east_m, up_m = plan.scenario.terrain, flown[..., 0], flown[..., 1], -flown[..., 2]
    lowest_m = float((up_m - ground_height_m(terrain, north_m, east_m)).min())  # the least distance is no more
    above = ground_distance_m(terrain, north_m, east_m, up_m, lowest_m)
    row, instant = np.unravel_index(np.argmin(above), above.shape)
    least_m, when_s, planned_m = float(above[row, instant]), float(t_s[instant]), plan.scenario.limits.clearance_min_m
    sysid = plan.sysids[row]
    return Criterion("clearance above ground", "m", least_m, 0.0, True, sysid, when_s, planned=planned_m)


def _arrivals(plan: Plan, t_s: Array, flown: Array, planned: Array) -> list[Criterion]:
    limits = plan.scenario.judge
    goal = plan.states(np.array([plan.flight_s]))[:, 0, POSITION][:, None]
    at_end = np.searchsorted(t_s, plan.flight_s)
    missed = np.linalg.norm(flown - goal, axis=-1)
    farthest = int(np.argmax(missed[:, at_end]))
    entered = [_last_entry(t_s, d, limits.arrival_position_m) for d in missed]
    due = [_last_entry(t_s, d, limits.arrival_position_m) for d in np.linalg.norm(planned - goal, axis=-1)]
    late = np.abs(np.subtract(entered, due))
    latest = int(np.argmax(late))
    return [
        Criterion(
            "arrival position",
            "m",
            float(missed[farthest, at_end]),
            limits.arrival_position_m,
            False,
            plan.sysids[farthest],
            plan.flight_s,
        ),
        Criterion("arrival time", "s", float(late[latest]), limits.arrival_time_s, False, plan.sysids[latest]),
    ]


def _last_entry(t_s: Array, distance_m: Array, radius_m: float) -> float:
    """Return when the distance last fell below the radius; infinite if it ends outside."""
    outside = np.flatnonzero(distance_m > radius_m)
    if len(outside) == 0:
        return float(t_s[0])
    last = int(outside[-1])
    if last + 1 >= len(t_s):
        return float("inf")
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
