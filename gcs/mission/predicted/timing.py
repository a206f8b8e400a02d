"""The predicted timing of missions: lateness at waypoints, distance from the plan, least distance of vehicles.

An error of an autopilot's model is the same for all vehicles, and a formation keeps its shape. Two vehicles with the
same orders differ by at most `AutopilotTraits.apart_s`, and each by what its autopilot may do where its reaction is
open. The least distance is therefore taken with any two vehicles shifted against each other by up to these times.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.spatial import KDTree

from gcs.autopilots.traits import Autopilot
from gcs.autopilots.waypoint_models.predict import NEAR_M
from gcs.frames import Origin, geodetic_to_ned
from gcs.mission.machine_independent import EQUAL, first_least
from gcs.mission.model import Altitude, Command, VehicleMission
from gcs.mission.predicted.arrival_spread import ArrivalSpread, arrival_spread
from gcs.mission.predicted.planned_flight import PredictedFlight
from gcs.mission.waypoints.timed_legs import TimedLegs
from gcs.physics.states import POSITION
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.navigation_error import judged_separation_m
from gcs.scenario.values.si import local_origin
from gcs.types import Array

GRID_S = 0.2
_SAMPLES = 9  # of every piece of a flight
_SHIFTS, _SHIFT_S = 21, 0.05  # at least so many shifts of a pair, and no more apart where reactions are open
_BATCH = 20  # vehicles sampled at once
_ALL_PAIRS, _PAIRS_MAX, _TREE_EVERY = 20, 2000, 25
MARGIN_S = 1.0  # before a gate opens: a vehicle that arrives later than that may miss it


@dataclass(frozen=True)
class VehicleTiming:
    """One vehicle's flight compared with its plan. Late is positive; the error is taken at equal time."""

    sysid: int
    late_s: float  # of the worst waypoint, late or early
    late_at_s: float  # plan time of that waypoint
    error_max_m: float
    error_at_s: float
    error_rms_m: float


@dataclass(frozen=True)
class NearMiss:
    """The nearest two vehicles, with one of them up to `apart_s` ahead or behind."""

    distance_m: float
    t_s: float
    sysids: tuple[int, int]
    apart_s: float


@dataclass(frozen=True)
class Timing:
    """The predicted flight of an export's missions."""

    vehicles: tuple[VehicleTiming, ...]
    spread_s: float  # the largest difference of two vehicles' lateness at the same waypoint
    nearest: NearMiss | None  # None for a single vehicle
    arrival_late_s: float  # of the last waypoint, the worst of all vehicles
    gates_early_s: tuple[float, ...]  # time from the latest arrival of the last vehicle to the opening of each gate
    may_differ_s: float = 0.0  # earlier or later than predicted, by what an autopilot may do

    @property
    def late_s(self) -> float:
        """The worst of all vehicles, late or early."""
        return max((v.late_s for v in self.vehicles), key=abs)

    def data(self) -> dict[str, object]:
        """The timing for index.json and `--json`."""
        spread_s = None if math.isnan(self.spread_s) else self.spread_s
        return {"late_s": self.late_s} | asdict(self) | {"spread_s": spread_s}


def predicted(
    plan: Plan,
    autopilots: Sequence[Autopilot],
    legs: Mapping[Autopilot, TimedLegs],
    missions: Sequence[VehicleMission],
    flights: Sequence[PredictedFlight],
    spreads: Sequence[ArrivalSpread] = (),
) -> Timing:
    """The timing of all missions, from flights that leave the end of their take-off together.

    `autopilots` are those of the vehicles, `legs` those of each autopilot. `spreads` say how early and late each
    vehicle may be; without them no reaction is open.
    """
    t_s = np.arange(min(each.left_s for each in legs.values()), plan.phase(PhaseKind.LANDING).start_s, GRID_S)
    flown = np.empty((len(missions), len(t_s), 3))
    late, early = [], []
    windows_s = np.zeros((len(missions), 2, len(t_s)))
    for row, (mission, flight) in enumerate(zip(missions, flights, strict=True)):
        begins_s = mission.leaves_s - _leaving_s(mission, flight)
        knots_s = flight.t_s + begins_s
        spread = spreads[row] if spreads else arrival_spread(flight, [])
        windows_s[row] = spread.at(t_s, begins_s)
        flown[row] = np.stack([np.interp(t_s, knots_s, flight.ned_m[:, axis]) for axis in range(3)], axis=-1)
        waypoints, passed_s = _passages(plan, row, mission, flight, knots_s)
        due = [(leaves_s, passed_s[waypoints.index(delay - 1)]) for delay, leaves_s in mission.gates]
        early.append([leaves_s - at_s - spread.at(at_s, begins_s)[1] for leaves_s, at_s in due])
        gates, holds = {delay - 1 for delay, _ in mission.gates}, _holds(mission)
        due_s = [math.nan if item in gates else float(mission.arrival_s[item] or 0.0) for item in waypoints]
        for number in (*(waypoints.index(item) for item in holds), -1):
            due_s[number] = _near_s(plan, row, float(mission.arrival_s[waypoints[number]] or 0.0))
        late.append(passed_s - due_s)
    vehicles: list[VehicleTiming] = []
    for first in range(0, len(missions), _BATCH):
        rows = slice(first, first + _BATCH)
        errors = np.linalg.norm(flown[rows] - plan.motion(t_s, rows)[0][..., POSITION], axis=-1)
        vehicles += [
            _vehicle(mission, late_s, error_m, t_s)
            for mission, late_s, error_m in zip(missions[rows], late[rows], errors, strict=True)
        ]
    return Timing(
        tuple(vehicles),
        _spread_s(autopilots, late),
        nearest_apart(plan.sysids, autopilots, t_s, flown, windows_s, judged_separation_m(plan.scenario)),
        float(max((one[-1] for one in late), key=abs)),
        tuple(np.min(early, axis=0).round(3).tolist()) if any(each.gates for each in legs.values()) else (),
        float(np.abs(windows_s).max()),
    )


def _leaving_s(mission: VehicleMission, flight: PredictedFlight) -> float:
    """The time at which the vehicle leaves the hover, in the flight's time."""
    first = next(index for index, item in enumerate(mission.items) if item.command == Command.NAV_WAYPOINT)
    return float(flight.t_s[min(int(np.argmax(flight.item >= first)), len(flight.t_s) - 1)])


def knots_in_plan_time_s(mission: VehicleMission, flight: PredictedFlight) -> Array:
    """The plan times (K,) of the knots of a flight that leaves the end of its take-off with all others."""
    return flight.t_s - _leaving_s(mission, flight) + mission.leaves_s


def _holds(mission: VehicleMission) -> set[int]:
    """The indices of waypoints at which the vehicle waits for a time of its own, not at a gate."""
    delays = {index for index, item in enumerate(mission.items) if item.command == Command.NAV_DELAY}
    every = {i - 1 for i in delays - {index for index, _ in mission.gates}}
    return {index for index in every if mission.items[index].command == Command.NAV_WAYPOINT}


def _passages(
    plan: Plan, row: int, mission: VehicleMission, flight: PredictedFlight, knots_s: Array
) -> tuple[list[int], Array]:
    """Indices of the waypoints, and when each is passed: at the nearest point, or near it where the vehicle stops."""
    waypoints = [i for i, item in enumerate(mission.items) if item.command == Command.NAV_WAYPOINT]
    origin = local_origin(plan.scenario)
    stops = {delay - 1 for delay, _ in mission.gates} | _holds(mission) | {waypoints[-1]}
    times = []
    for index, following in itertools.zip_longest(waypoints, waypoints[1:]):
        begin = max(int(np.searchsorted(flight.item, index)) - 1, 0)
        end = int(np.searchsorted(flight.item, index if index in stops else following, side="right"))
        place = _place(mission, index, origin)
        t_s, distance_m = _approach(knots_s[begin:end], flight.ned_m[begin:end] - place)
        near = np.flatnonzero(distance_m <= NEAR_M)
        times.append(float(t_s[near[0] if index in stops and len(near) else first_least(distance_m)]))
    return waypoints, np.array(times)


def _approach(t_s: Array, away_m: Array) -> tuple[Array, Array]:
    """Instants and distances from 0 along a polyline (K,), (K, 3): `_SAMPLES` and the nearest point of every piece."""
    shares = np.linspace(0.0, 1.0, _SAMPLES)
    pieces = np.diff(away_m, axis=0)
    nearest = -np.sum(away_m[:-1] * pieces, axis=1) / np.maximum(np.sum(pieces * pieces, axis=1), 1e-12)
    sampled = np.sort(np.concatenate([np.tile(shares, (len(pieces), 1)), np.clip(nearest, 0.0, 1.0)[:, None]], axis=1))
    instants = t_s[:-1, None] + sampled * np.diff(t_s)[:, None]
    distance_m = np.linalg.norm(away_m[:-1, None] + sampled[..., None] * pieces[:, None], axis=-1)
    return instants.ravel(), distance_m.ravel()


def _place(mission: VehicleMission, index: int, origin: Origin) -> Array:
    item = mission.items[index]
    alt_m = item.alt_m if item.frame == Altitude.AMSL.frame else mission.home.alt_amsl_m + item.alt_m
    return geodetic_to_ned(*item.place_deg, alt_m, origin)


def _near_s(plan: Plan, row: int, arrives_s: float) -> float:
    """The time at which the plan comes near the waypoint where it stops at `arrives_s`."""
    t_s = np.arange(0.0, arrives_s + 0.5 * GRID_S, 0.5 * GRID_S).clip(max=arrives_s)
    position = plan.motion(t_s, slice(row, row + 1))[0][0][:, POSITION]
    far = np.flatnonzero(np.linalg.norm(position - position[-1], axis=1) > NEAR_M)
    return float(t_s[min(int(far[-1]) + 1, len(t_s) - 1)]) if len(far) else 0.0


def _vehicle(mission: VehicleMission, late_s: Array, error_m: Array, t_s: Array) -> VehicleTiming:
    arrivals = [
        t for t, item in zip(mission.arrival_s, mission.items, strict=True) if item.command == Command.NAV_WAYPOINT
    ]
    worst = first_least(-np.abs(late_s))
    at = first_least(-error_m)
    late = float(late_s[worst]), float(arrivals[worst] or 0.0)
    return VehicleTiming(mission.sysid, *late, float(error_m[at]), float(t_s[at]), float(np.sqrt(np.mean(error_m**2))))


def _spread_s(autopilots: Sequence[Autopilot], late: Sequence[Array]) -> float:
    """The largest difference between vehicles of one autopilot: those of another have other waypoints."""
    spreads = []
    for known in set(autopilots):
        ours = [late_s for late_s, other in zip(late, autopilots, strict=True) if other is known]
        if len({len(one) for one in ours}) > 1:
            return math.nan  # a vehicle at rest has fewer waypoints
        spreads.append(float(np.nanmax(np.ptp(np.array(ours), axis=0))))
    return max(spreads)


def nearest_apart(
    sysids: Sequence[int],
    autopilots: Sequence[Autopilot],
    t_s: Array,
    flown: Array,
    windows_s: Array,
    required_m: float,
) -> NearMiss | None:
    """The least distance of one vehicle to the positions of another within their `apart_s`; rows of flown (V, N, 3).

    Of two autopilots the larger time counts. Besides, each may be early (negative) or late by windows_s (V, 2, N). Of a
    large fleet, pairs that stay farther apart than `required_m` may be left out.
    """
    if len(flown) < 2 or not len(t_s):
        return None
    apart_s = [known.traits.apart_s for known in autopilots]
    widest_s = float(np.abs(windows_s).max())
    near = 2 * math.ceil((2.0 * widest_s + max(apart_s)) / GRID_S) + 1  # steps in which the other one may be
    others_s = np.stack([minimum_filter1d(windows_s[:, 0], near), maximum_filter1d(windows_s[:, 1], near)], axis=1)
    best = NearMiss(math.inf, math.nan, (0, 0), max(apart_s))
    for first, second in _near_pairs(t_s, flown, max(apart_s) + 2.0 * widest_s, required_m):
        pair_s = max(apart_s[first], apart_s[second])
        ahead_s = pair_s + windows_s[first, 1] - others_s[second, 0]
        behind_s = pair_s + others_s[second, 1] - windows_s[first, 0]
        shifts = max(_SHIFTS, 1 + math.ceil(float((ahead_s + behind_s).max() - 2.0 * pair_s) / _SHIFT_S))
        for share in np.linspace(-1.0, 1.0, shifts).tolist() if pair_s or widest_s else [0.0]:
            there_s = t_s + share * (ahead_s if share > 0.0 else behind_s)
            other = np.stack([np.interp(there_s, t_s, flown[second, :, axis]) for axis in range(3)], axis=-1)
            distance_m = np.linalg.norm(flown[first] - other, axis=-1)
            at = first_least(distance_m)
            if distance_m[at] < best.distance_m - EQUAL:
                pair = (sysids[first], sysids[second])
                apart = float(max(ahead_s[at], behind_s[at]))
                best = NearMiss(float(distance_m[at]), float(t_s[at]), pair, apart)
    return best


def _near_pairs(t_s: Array, flown: Array, apart_s: float, required_m: float) -> list[tuple[int, int]]:
    """All pairs of a small fleet; of a large one, pairs that could violate the separation, and the nearest ones."""
    if len(flown) <= _ALL_PAIRS:
        return list(itertools.combinations(range(len(flown)), 2))
    fastest_mps = float(np.max(np.linalg.norm(np.diff(flown[0], axis=0), axis=-1))) / GRID_S
    reach_m = required_m + 2.0 * fastest_mps * apart_s
    pairs: set[tuple[int, int]] = set()
    for at in range(0, len(t_s), _TREE_EVERY):
        tree = KDTree(flown[:, at])
        pairs |= tree.query_pairs(reach_m)
        row = int(np.argmin(tree.query(flown[:, at], k=2)[0][:, 1]))
        other = int(tree.query(flown[row, at], k=2)[1][1])
        pairs.add((min(row, other), max(row, other)))
    return sorted(pairs)[:_PAIRS_MAX]
