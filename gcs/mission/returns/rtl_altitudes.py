"""Staggered return (RTL) altitudes, with which the whole fleet can return at once from any instant of a plan.

Altitudes start above the highest ground under all return tracks and are one step apart. `stagger_order` searches the
order of vehicles. Fleets of more than 12 return at one altitude, in formation; where that is too near and they are
at most 60, at a few altitudes (`return_lanes`). Vehicles return to their homes, or to the nearest of home and rally
points (`rtl_cases`). Returns that are not proved to keep the judge's separation are given to no vehicle.

If no order keeps the separation, the whole fleet returns more slowly. A vehicle with a low return altitude may pass
under climbing ones; at a lower speed it passes later, when they are higher.

Nothing here depends on the last bits of a plan. The lowest altitude is rounded up to `BASE_GRID_M`; the separation
counts as kept within `KEPT_M`; a slower return must be better by `BETTER_M`.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from gcs.autopilots.traits import FleetFirmware, one_each
from gcs.mission.machine_independent import EQUAL, first_least
from gcs.mission.returns import rtl_cases
from gcs.mission.returns.ground_below import highest_below_returns_m
from gcs.mission.returns.pair_returns import RESOLUTION_M, StraightReturns, proved_separation
from gcs.mission.returns.proved_fleet import proved_fleet
from gcs.mission.returns.return_lanes import LEVELS, lane_order
from gcs.mission.returns.return_routes import ReturnRoutes
from gcs.mission.returns.routed_returns import (
    NoWay,
    RoutedReturns,
    highest_under_ways_m,
    instants_s,
    nearest_return,
    routed_returns,
    without_way,
)
from gcs.mission.returns.rtl_cases import Crossing, Returning, ReturnSpeeds, ReturnTo, WorstReturn
from gcs.mission.returns.zones_crossed import zones_crossed
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.navigation_error import judged_separation_m
from gcs.types import Array
from gcs.util.cache import once
from gcs.util.long_work import report

STEP_MIN_M = 2.0
BASE_GRID_M = 0.5  # the lowest return altitude above the origin is a multiple of it
NO_RETURNS = (
    "no vehicle is given a return (RTL altitude, rally points): set the vehicles' own failsafe actions to land, and do "
    "not command RTL"
)
LAND_INSTEAD = "do not have the ground station return all vehicles: order them to land"
BETTER_M = 0.05  # of the least distance: a slower return that gains less is not taken
KEPT_M = 5e-4  # a length that misses its limit by less keeps it: a plan may lie on the limit, but for its last bits
_LEVEL_M = 0.02  # so much above its return altitude a vehicle returns at its own height
_STEP_SHARE = 1.25  # of the plan's separation
_COARSE_S, _FINE_S, _FINEST_S, _GROUND_S, _ROUTED_S = 8.0, 0.5, 0.05, 2.0, 1.0
_IN_FORMATION_INSTANTS, _IN_FORMATION_LOOKS = 40, 60
_CM = 100.0
_LANES_S = 1.0
_CRUISE_SHARES = (1.0, 0.7, 0.5)  # of the speed the plan may fly
SEARCHED_MAX, LANED_MAX = 12, 60  # vehicles
GAP_STEP_M = 0.05
ENOUGH = 2.0
_ALL_ORDERS = 8  # vehicles
_STEPS_BEGIN = 0.382  # of a step: pads and formations have round distances, and steps shall not begin there


@dataclass(frozen=True)
class ReturnPlan:
    """The verified returns of a fleet. Altitudes (V) count from each vehicle's own home, in whole centimetres.

    Staggered ones are rounded up to what a rally point can hold (ArduPilot: whole metres), and verified after that.
    """

    altitudes_m: tuple[float, ...]
    speeds: ReturnSpeeds
    step_m: float
    ground_max_m: float  # under any return track, above the origin's height
    top_m: float  # the highest vehicle, above the origin's height
    worst: WorstReturn | None  # None for a single vehicle
    crossings: tuple[Crossing, ...]  # of straight returns, as autopilots fly them
    routed: WorstReturn | None = None  # as `worst`, of returns that the ground station flies round no-fly zones
    no_way: tuple[NoWay, ...] = ()
    rally_ned_m: tuple[tuple[tuple[float, float, float], ...], ...] = ()  # of each vehicle, on the ground
    proved_at_s: float = 0.0  # start of the returns with the least proved separation, about
    required_m: float = 0.0  # between any two vehicles: what a flight is judged by
    one_level: bool = False  # of a large fleet

    @property
    def separated(self) -> bool:
        """Whether all vehicles may return at once: proved, from any instant. If not, vehicles are given no returns."""
        proved_m = None if self.worst is None else self.worst.proved_m
        return self.worst is None or (proved_m is not None and proved_m >= self.required_m - KEPT_M)

    @property
    def why_none(self) -> str:
        """Why vehicles are given no returns; "" where they are given some."""
        worst = self.worst
        if worst is None or self.separated:
            return ""
        if worst.distance_m < self.required_m:
            return f"if all vehicles return at {worst.in_words(self.required_m)}"
        proved = "not proved to stay apart" if worst.proved_m is None else f"proved only {worst.proved_m:.3f} m apart"
        return (
            f"returns that begin at about {self.proved_at_s:.1f} s are {proved} ({self.required_m:g} m required; "
            "vehicles as far from home as from a rally point may choose differently)"
        )


@once
def plan_returns(plan: Plan, firmware: FleetFirmware) -> ReturnPlan:
    """The return altitudes of a plan's fleet, and the fastest return that keeps the separation, both verified.

    `firmware` is the autopilot of all vehicles, or that of each.
    """
    found = _proved(plan, firmware, _searched(plan, firmware))
    if not found.separated and found.one_level and SEARCHED_MAX < len(plan.sysids) <= LANED_MAX:
        found = max(found, _proved(plan, firmware, _searched(plan, firmware, lanes=True)), key=_proved_m)
    crossings = zones_crossed(plan, firmware, np.array(found.rally_ned_m))
    return replace(found, crossings=tuple(crossings))


def _proved(plan: Plan, firmware: FleetFirmware, found: ReturnPlan) -> ReturnPlan:
    """The same returns with what is proved of them; nothing is where they are seen to come too near."""
    required_m = judged_separation_m(plan.scenario)
    found, worst = replace(found, required_m=required_m), found.worst
    large = len(plan.sysids) > SEARCHED_MAX
    if worst is None or (large and worst.distance_m < required_m):
        return found
    prove = proved_fleet if large and found.one_level else proved_separation
    ends = rtl_cases.return_ends(plan, firmware, np.array(found.rally_ned_m))
    returns = StraightReturns(plan, ends, found.speeds, np.array(found.altitudes_m), required_m)
    proof = prove(returns, worst.distance_m)
    if proof.least_m < worst.distance_m - KEPT_M:
        pair = plan.sysids[proof.pair[0]], plan.sysids[proof.pair[1]]
        worst = WorstReturn(proof.least_m, proof.t_s, pair, proof.to)
    # What may be nearer than a cell is fine is not proved to be apart at all.
    proved_m = proof.proved_m if proof.proved_m > RESOLUTION_M else None
    return replace(found, worst=replace(worst, proved_m=proved_m), proved_at_s=proof.proved_at_s)


def _proved_m(found: ReturnPlan) -> tuple[bool, float]:
    worst = found.worst
    return found.separated, 0.0 if worst is None else worst.proved_m or worst.distance_m


def _searched(plan: Plan, firmware: FleetFirmware, *, lanes: bool = False) -> ReturnPlan:
    """The returns by instants `_FINE_S` apart. A large fleet returns at one altitude, or in `lanes`."""
    every = one_each(firmware, len(plan.sysids))
    rows = [known.traits.returns for known in every]
    limits = plan.scenario.limits
    best: ReturnPlan | None = None
    report("looking for the ways home of every vehicle")
    routes = ReturnRoutes(plan)
    routed = routed_returns(plan, routes, instants_s(plan, _ROUTED_S))
    rally = rtl_cases.rally_points_ned_m(plan, min(known.traits.missions.rally_points_max for known in every))
    ground_m = 0.0
    for share in _CRUISE_SHARES:
        report(f"planning the returns of every vehicle at {share:.0%} of its speed")
        speeds = _speeds(plan, firmware, share)
        coarse = rtl_cases.return_cases(plan, firmware, speeds, _COARSE_S, rally_ned_m=rally)
        if best is None:
            over_ground = rtl_cases.return_cases(plan, firmware, speeds, _GROUND_S, rally_ned_m=rally)
            straight_m = rtl_cases.highest_ground_m(plan, over_ground)
            straight_m = highest_below_returns_m(plan, firmware, rally, straight_m)
            ground_m = max(straight_m, highest_under_ways_m(plan, routed))
        # The lowest return altitude above the origin: clear of the ground, and not below the plan's own heights.
        highest_m = -float(coarse[0].from_ned_m[..., 2].min())
        base_m = max(ground_m + limits.clearance_min_m - KEPT_M, highest_m - _LEVEL_M)
        base_m = math.ceil(base_m / BASE_GRID_M) * BASE_GRID_M
        vehicles = len(plan.sysids)
        # A large fleet returns at one level: there, rounding would make vehicles climb for different times.
        quantum_m = np.array([row.rally_step_m if vehicles <= SEARCHED_MAX else 1.0 / _CM for row in rows])
        # Rounding brings two neighbours closer by less than one quantum.
        apart_m = limits.separation_min_m
        step_m = max(STEP_MIN_M, _STEP_SHARE * apart_m, apart_m + float(quantum_m.max()))
        homes_m = -plan.pads_ned_m[:, 2]
        levels_m = _rounded(base_m + step_m * np.arange(vehicles)[:, None] - homes_m, quantum_m)
        order = stagger_order(coarse, levels_m, limits.separation_min_m)
        if lanes:
            looked_at = rtl_cases.return_cases(plan, firmware, speeds, _LANES_S, rally_ned_m=rally)
            judged_m = judged_separation_m(plan.scenario)
            order = lane_order(looked_at, levels_m[:LEVELS], limits.separation_min_m, judged_m)
        altitudes_m = _rounded(base_m + step_m * order - homes_m, quantum_m)
        report(f"looking at the returns of every vehicle at {share:.0%} of its speed")
        worst = _worst(plan, firmware, speeds, altitudes_m, rally) if vehicles > 1 else None
        fine = rtl_cases.return_cases(plan, firmware, speeds, _FINE_S, rally_ned_m=rally)
        found = ReturnPlan(
            tuple(altitudes_m.tolist()),
            speeds,
            step_m,
            ground_m,
            max(float(np.max(case.datum_m + altitudes_m[:, None])) for case in fine),
            worst,
            (),
            rally_ned_m=tuple(tuple(map(tuple, points)) for points in rally.tolist()),
            one_level=vehicles > 1 and not order.any(),
        )
        required_m = limits.separation_min_m - KEPT_M
        if worst is None or worst.distance_m >= required_m:
            found = _with_routed(plan, routes, routed, found)
            if found.routed is None or found.routed.distance_m >= required_m:
                return found
        if best is None or _least_m(found) >= _least_m(best) + BETTER_M:
            best = found
        if vehicles > SEARCHED_MAX:
            break
    assert best is not None
    return best if best.routed is not None else _with_routed(plan, routes, routed, best)


def _least_m(found: ReturnPlan) -> float:
    return min(worst.distance_m for worst in (found.worst, found.routed) if worst is not None)


def _with_routed(plan: Plan, routes: ReturnRoutes, cases: list[RoutedReturns], found: ReturnPlan) -> ReturnPlan:
    """The returns with those of the ground station verified as well."""
    report("looking at the returns by the ground station")
    found = replace(found, no_way=tuple(without_way(plan, cases)))
    if found.worst is None:
        return found
    top_down_m = plan.pads_ned_m[:, 2] - np.array(found.altitudes_m)
    return replace(found, routed=nearest_return(plan, routes, cases, top_down_m, found.speeds))


def _worst(plan: Plan, firmware: FleetFirmware, speeds: ReturnSpeeds, altitudes_m: Array, rally: Array) -> WorstReturn:
    """The nearest two vehicles of all returns, to homes and to the nearest of home and rally points."""
    if len(altitudes_m) > SEARCHED_MAX:
        period_s = (plan.t_end_s - plan.t_start_s) / _IN_FORMATION_INSTANTS
        cases = rtl_cases.return_cases(plan, firmware, speeds, period_s, rally_ned_m=rally)
        return min((_nearest_in_formation(plan, case, altitudes_m) for case in cases), key=_distance)
    found: list[WorstReturn] = []
    within = None
    for period_s in (_FINE_S, _FINEST_S):
        cases = rtl_cases.return_cases(plan, firmware, speeds, period_s, within, rally)
        found += (_nearest_pair(plan, case, altitudes_m) for case in cases)
        at_s = min(found, key=_distance).t_s
        within = max(at_s - _FINE_S, plan.t_start_s), min(at_s + _FINE_S, plan.t_end_s)
    return min(found, key=_distance)


def _distance(worst: WorstReturn) -> int:
    return math.floor(worst.distance_m / EQUAL + 0.5)  # of equal distances the first counts


def _rounded(altitudes_m: Array, quantum_m: Array) -> Array:
    """Altitudes (..., V) rounded up to multiples of each vehicle's `quantum_m` (V,)."""
    per_m = np.round(1.0 / quantum_m)
    return np.asarray(np.ceil(altitudes_m * per_m - 1e-6) / per_m)


def _speeds(plan: Plan, firmware: FleetFirmware, share: float) -> ReturnSpeeds:
    """Return speeds: a share of the plan's speed limit, in whole cm/s. ArduPilot waits 5 s before it descends."""
    every = one_each(firmware, len(plan.sysids))
    north, east, vertical = plan.scenario.limits.speed_ned_mps
    cruise_mps = math.floor(share * min(north, east) * _CM) / _CM
    return ReturnSpeeds(vertical, cruise_mps, vertical, max(known.traits.returns.wait_s for known in every))


def _nearest_pair(plan: Plan, case: Returning, altitudes_m: Array) -> WorstReturn:
    motions = [case.motion(row, altitudes_m[row]) for row in range(len(altitudes_m))]
    found = []
    for i, j in itertools.combinations(range(len(motions)), 2):
        distance = rtl_cases.pair_distances(motions[i], motions[j])
        at = first_least(distance)
        pair = plan.sysids[i], plan.sysids[j]
        found.append(WorstReturn(float(distance.min()), float(case.t_s[at]), pair, case.to))
    return min(found, key=_distance)


def _nearest_in_formation(plan: Plan, returning: Returning, altitudes_m: Array) -> WorstReturn:
    """The nearest two vehicles of a large fleet, at `_IN_FORMATION_LOOKS` instants of each return."""
    motions = [returning.motion(row, altitudes_m[row]) for row in range(len(altitudes_m))]
    longest_s = np.max([times[:, -1] for times, _ in motions], axis=0)
    looks = np.linspace(0.0, 1.0, _IN_FORMATION_LOOKS) * longest_s[:, None]
    places = np.stack([rtl_cases.places_at(motion, looks) for motion in motions])  # (V, N, L, 3)
    worst = WorstReturn(math.inf, math.nan, (0, 0), returning.to)
    for instant, look in np.ndindex(looks.shape):
        distance, near = KDTree(places[:, instant, look]).query(places[:, instant, look], k=2)
        row = first_least(distance[:, 1])
        if distance[row, 1] < worst.distance_m - EQUAL:
            other = next(each for each in near[row].tolist() if each != row)  # of two at one place either is the first
            pair = plan.sysids[min(row, other)], plan.sysids[max(row, other)]
            worst = WorstReturn(float(distance[row, 1]), float(returning.t_s[instant]), pair, returning.to)
    return worst


def return_warnings(plan: Plan, returns: ReturnPlan, firmware: FleetFirmware) -> Iterator[str]:
    """Warnings: returns for want of separation, with its figures, and those of `place_warnings`."""
    required_m, routed = judged_separation_m(plan.scenario), returns.routed
    if not returns.separated:
        yield f"{returns.why_none}; {NO_RETURNS}"
    if routed is not None and routed.distance_m < required_m:
        yield f"if the ground station returns all vehicles at {routed.in_words(required_m)}; {LAND_INSTEAD}"
    yield from place_warnings(plan, returns, firmware)


def place_warnings(plan: Plan, returns: ReturnPlan, firmware: FleetFirmware) -> Iterator[str]:
    """Warnings: returns above the plan's ceiling, without a way, or through no-fly zones."""
    ceiling_m = plan.scenario.limits.height_m[1]
    if returns.separated and returns.top_m > ceiling_m:
        above = f"above the plan's ceiling of {ceiling_m:g} m"
        yield f"returns reach {returns.top_m:.1f} m, {above}; check that the airspace allows it"
    for gap in returns.no_way:
        yield (
            f"from {gap.from_s:.1f} s to {gap.to_s:.1f} s vehicle {gap.sysid} cannot return outside all no-fly zones "
            "and inside the fence; ordered to return, it lands where it is"
        )
    acts = dict(zip(plan.sysids, (known.traits.returns for known in one_each(firmware, len(plan.sysids))), strict=True))
    for crossing in returns.crossings:
        where = "home (without rally points)" if crossing.ends is ReturnTo.HOME else crossing.ends.words
        for at_fence in dict.fromkeys(acts[sysid].at_fence for sysid in crossing.sysids):
            sysids = ", ".join(str(sysid) for sysid in crossing.sysids if acts[sysid].at_fence == at_fence)
            yield (
                f"from {crossing.from_s:.1f} s to {crossing.to_s:.1f} s the autopilot's own straight return to {where} "
                f"crosses {crossing.name.edge}: vehicle {sysids}; at its fence it {at_fence}. Returns of the "
                "ground station lead round it"
            )


def stagger_order(cases: list[Returning], altitudes_m: Array, separation_m: float) -> NDArray[np.intp]:
    """Place of each vehicle in the stagger (V,): the order with the largest least distance.

    `altitudes_m` (L, V) are the altitudes that each vehicle would have at each place. All orders of up to 8 vehicles
    are compared, and exchanges of two in fleets of up to 12. Many are equally good, for example because pads limit the
    least distance, and then the last bits of a plan would choose among them. Least distances are therefore compared in
    whole steps of `GAP_STEP_M`, and those of `ENOUGH` separations or more are equal. Of equally good orders the first
    one counts: the vehicles' own order is the first, the reversed one the last.
    """
    vehicles = len(cases[0].from_ned_m)
    if vehicles == 1 or vehicles > SEARCHED_MAX:
        return np.zeros(vehicles, dtype=np.intp)
    pairs = list(itertools.combinations(range(vehicles), 2))
    gaps_m = np.full((vehicles, vehicles, vehicles, vehicles), np.inf)  # by pair, then by their places in the stagger
    for case in cases:
        motions = [case.motion(row, altitudes_m[:, row, None]) for row in range(vehicles)]
        for i, j in pairs:
            (times_i, places_i), (times_j, places_j) = motions[i], motions[j]
            distance = rtl_cases.pair_distances((times_i[:, None], places_i[:, None]), (times_j[None], places_j[None]))
            gaps_m[i, j] = np.minimum(gaps_m[i, j], distance.min(axis=-1))
    steps = np.floor(np.minimum(gaps_m, ENOUGH * separation_m) / GAP_STEP_M + _STEPS_BEGIN)
    first, second = np.array(pairs).T

    def worth(orders: NDArray[np.intp]) -> Array:
        """The least distance (O,) of orders (O, V), in whole steps."""
        return np.asarray(steps[first, second, orders[:, first], orders[:, second]].min(axis=1))

    if vehicles <= _ALL_ORDERS:
        orders = np.array(list(itertools.permutations(range(vehicles))))
        best: NDArray[np.intp] = orders[np.argmax(worth(orders))]
        return best
    order = np.arange(vehicles)
    while True:
        swapped = np.repeat(order[None], len(pairs), axis=0)
        rows = np.arange(len(pairs))
        swapped[rows, first], swapped[rows, second] = order[second], order[first]
        found = worth(swapped)
        if found.max() <= worth(order[None])[0]:
            return order
        order = swapped[np.argmax(found)]
