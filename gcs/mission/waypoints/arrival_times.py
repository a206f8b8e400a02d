"""Legs with corrected speeds, on which an autopilot keeps the plan's arrival times.

Waypoints are few, and far enough apart for their speeds. In a rigid formation all vehicles fly the leader's legs,
translated; in a changing formation each vehicle has speeds of its own. `speed_correction` finds the speeds.
Waypoints are raised where long legs would violate the clearance over ground.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from gcs.autopilots.traits import Autopilot
from gcs.autopilots.waypoint_models.navigator import Navigator
from gcs.autopilots.waypoint_models.predict import Prediction, predict
from gcs.errors import ScenarioError, VerificationError
from gcs.mission.flight_limits import limits_of
from gcs.mission.machine_independent import SAMPLE_GRID, on_grid
from gcs.mission.waypoints.leg_profile import LegProfile, NavigatorLimits, leg_profile
from gcs.mission.waypoints.mission_items import ImpossibleMission, refuse_too_many
from gcs.mission.waypoints.placement import Deviation, SampledFlight, deviation, gentle_indices, short_of_m
from gcs.mission.waypoints.speed_correction import Corrected, correct
from gcs.mission.waypoints.timed_legs import Gate, TimedLegs, rows_with_own_legs, with_drawn_points
from gcs.physics.states import POSITION
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.no_fly import outside_m, zones
from gcs.scenario.values.si import ability_of
from gcs.types import Array

VEHICLES_MAX = 20  # with legs of their own: each takes 3 s for each of up to three placements
SLACK_S = 5.0  # a stop takes up to 2 s, and lateness up to 2 s more
LEAD_MAX_S = 3.0
_GATE_LEAD_S = 1.0  # before the start and every gate, which must be whole seconds apart
_GATES_EVERY_S = 20.0  # least time between gates
_SAMPLE_S = 0.1
_SLOWEST_MPS = 0.3
_LEAST_PATH_M, _TIME_M = 0.3, 1.0  # no autopilot keeps corners or a constant speed better
# Factor on the path's tolerance; share of a speed that legs must sustain.
_PLACEMENTS = ((1.0, 1.0), (1.5, 1.3), (0.5, 0.8))
# Good enough to try no other placement; the second for vehicles with legs of their own, which take long.
_GOOD_S, _GOOD_OWN_S = 1.0, 2.0
_BETTER_S = 0.05  # a later placement must be better by this much
_NO_FLY_COST_SPM = 100.0  # cost of a metre too near to a no-fly zone, in s of lateness
_CACHE: dict[tuple[str, Autopilot, int], TimedLegs] = {}  # a correction takes seconds
_CACHED_MAX = 16
_OVER_M = 0.02  # above the required clearance, for rounding
_RAISE_GRID_M = 2.0**-6
_ROUNDS = 4
_EVERY = 4  # steps of a flight between samples: about half a metre


class TerrainRaise:
    """The heights by which waypoints are raised so that the legs between them keep the clearance.

    All vehicles are raised alike, so the formation keeps its shape. The first and the last waypoint are not raised.
    """

    def __init__(self, plan: Plan, t_s: Array) -> None:
        """For waypoints due at t_s (W,)."""
        self._plan, self._t_s = plan, t_s
        self._clearance_m = limits_of(plan.scenario).clearance_m + _OVER_M
        self.by_waypoint_m = np.zeros(len(t_s))
        self._rests: set[int] = set()  # legs on which a vehicle rests: both ends are one waypoint

    def raise_over_ground(
        self, navigator: Navigator, profile: LegProfile, legs: list[int], found: Corrected, row: int | None
    ) -> float:
        """Raise waypoints (W,) for one vehicle (row), or for all that fly the leader's legs (None).

        Return how much nearer to a no-fly zone than they may any of them would be, m.
        """
        flown = found.flown
        self._rests |= set(range(len(self.by_waypoint_m) - 1)) - set(legs)
        for _ in range(_ROUNDS):
            low = self._short_m(flown, row)
            number = np.minimum(np.searchsorted(flown.completed_s, flown.t_s), len(legs) - 1)
            if not np.any(low > 0.0):
                break
            more_m = np.zeros(len(self.by_waypoint_m))
            for leg, which in enumerate(legs):
                ends = slice(which, which + 2)
                more_m[ends] = np.maximum(more_m[ends], low[number == leg].max(initial=0.0))
            more_m[[0, -1]] = 0.0
            self.by_waypoint_m += np.ceil(more_m / _RAISE_GRID_M) * _RAISE_GRID_M
            for leg in sorted(self._rests):
                self.by_waypoint_m[leg : leg + 2] = self.by_waypoint_m[leg : leg + 2].max()
            raised = profile.points_ned_m.copy()
            raised[1:, 2] -= self.by_waypoint_m[np.array(legs) + 1]
            flown = predict(navigator, replace(profile, points_ned_m=raised).orders(found.speeds_mps))
        places, scenario = self._places(flown, row), self._plan.scenario
        t_s = np.broadcast_to(float(self._t_s[0]) + flown.t_s[::_EVERY], places.shape[:2])
        away_m = [float(outside_m(zone, t_s, places[..., 0], places[..., 1]).min()) for zone in zones(scenario)]
        required_m = (scenario.limits.zone_margin_m or 0.0) - scenario.mission.tolerance_m
        return max(required_m - min(away_m, default=math.inf), 0.0)

    def _short_m(self, flown: Prediction, row: int | None) -> Array:
        """The largest shortfall of the clearance of any vehicle at each step (M,)."""
        places = self._places(flown, row)
        short_m = short_of_m(self._plan.scenario.terrain, places, self._clearance_m).max(axis=0)
        return np.asarray(np.repeat(short_m, _EVERY)[: len(flown.t_s)])

    def _places(self, flown: Prediction, row: int | None) -> Array:
        """Positions of the vehicles (V, M / _EVERY, 3)."""
        plan = self._plan
        t_s = np.clip(float(self._t_s[0]) + flown.t_s[::_EVERY], None, plan.flight_s)
        offsets = plan.offsets(t_s)
        offsets = np.zeros((1, 1, 3)) if row is not None else offsets - offsets[plan.leader]
        return np.asarray(flown.position_ned_m[None, ::_EVERY] + offsets)


def navigator_of(plan: Plan, firmware: Autopilot) -> Navigator:
    """The model of this autopilot, with the limits of the plan's vehicles."""
    return firmware.navigator.within(ability_of(plan.quadrotor, plan.scenario.limits))


def climb_s(plan: Plan, firmware: Autopilot) -> float:
    """The longest climb to the hover, s, of vehicles with this autopilot: each climbs at a speed of its own."""
    hover_ned_m = plan.motion(np.array([plan.airborne_s]))[0][:, 0, POSITION]
    return float((plan.pads_ned_m[:, 2] - hover_ned_m[:, 2]).max()) / firmware.traits.missions.climb_mps[0]


def corrected_legs(plan: Plan, firmware: Autopilot, gates: int = 0) -> TimedLegs:
    """Waypoints, speeds and gates with which the autopilot keeps the plan's times as well as it can.

    Raises `VerificationError` for too many vehicles with legs of their own, or if the model does not complete the
    mission. Raises `ScenarioError` for more gates than fit the flight, `ImpossibleMission` where all placements need
    more items than the autopilot stores.
    """
    key = plan.hash, firmware, gates
    if key in _CACHE:
        return _CACHE[key]
    rows = rows_with_own_legs(plan)
    if rows == slice(None) and len(plan.sysids) > VEHICLES_MAX:
        raise VerificationError(
            f"{len(plan.sysids)} vehicles need legs of their own; speeds are corrected for at most {VEHICLES_MAX}.",
            hint="fly the setpoint stream (--format setpoints): it keeps path and time; --untimed writes missions with "
            "the plan's own speeds, to look at in other ground stations",
        )
    sampled = _Samples.of(plan, rows)
    stops = _gate_samples(sampled.t_s, gates, [(each.arrives_s, each.leaves_s) for each in plan.passages])
    best: _Attempt | None = None
    refusal: ImpossibleMission | None = None
    for tolerances, share in _PLACEMENTS:
        placed = _placed(plan, firmware, sampled, stops, (tolerances, share))
        try:
            refuse_too_many(_items_least(plan, firmware, sampled, placed), firmware, plan.scenario.mission.tolerance_m)
        except ImpossibleMission as reason:
            refusal = refusal or reason
            continue  # its speeds would take minutes to find
        attempt = _attempt(plan, firmware, sampled, stops, placed)
        if best is None or attempt.off_s < best.off_s - _BETTER_S:
            best = attempt
        if best.off_s <= (_GOOD_S if len(sampled.position_ned_m) == 1 else _GOOD_OWN_S):
            break
    if best is None:
        assert refusal is not None
        raise refusal
    while len(_CACHE) >= _CACHED_MAX:
        del _CACHE[next(iter(_CACHE))]
    _CACHE[key] = best.legs
    return best.legs


@dataclass(frozen=True)
class _Samples:
    """The planned flight of the vehicles with legs of their own: times (M,), positions (R, M, 3), route points."""

    t_s: Array
    position_ned_m: Array
    drawn: tuple[int, ...] = ()

    def part(self, first: int, last: int) -> SampledFlight:
        """The samples from the first to the last."""
        drawn = tuple(index - first for index in self.drawn if first < index < last)
        span = slice(first, last + 1)
        return SampledFlight(self.t_s[span], self.position_ned_m[:, span], drawn=drawn)

    @classmethod
    def of(cls, plan: Plan, rows: slice) -> _Samples:
        begin = next(p for p in plan.phases if p.name in (PhaseKind.RUN_UP, PhaseKind.MISSION)).start_s
        # Whole tenths, so that there is a sample at every second after the start.
        samples = math.ceil((plan.flight_s - begin) / _SAMPLE_S) + 1
        t_s = np.asarray(begin + _SAMPLE_S * np.arange(samples), dtype=np.float64)
        t_s[-1] = plan.flight_s
        t_s, drawn = with_drawn_points(t_s, plan)
        return cls(t_s, on_grid(plan.motion(t_s, rows)[0][..., POSITION], SAMPLE_GRID), drawn)


@dataclass(frozen=True)
class _Attempt:
    """One placement. `off_s` is the largest lateness of any waypoint and vehicle, plus the cost of no-fly zones."""

    legs: TimedLegs
    off_s: float


def _placed(
    plan: Plan, firmware: Autopilot, sampled: _Samples, stops: list[int], placement: tuple[float, float]
) -> list[list[int]]:
    """The samples that are waypoints, from each stop to the next."""
    tolerances, share = placement
    sustained_mps = navigator_of(plan, firmware).sustained_mps
    wanted = Deviation(tolerances * max(plan.scenario.mission.tolerance_m, _LEAST_PATH_M), _TIME_M)
    return [
        [first + i for i in gentle_indices(sampled.part(first, last), wanted, sustained_mps, share)]
        for first, last in pairwise(stops)
    ]


def _items_least(plan: Plan, firmware: Autopilot, sampled: _Samples, placed: list[list[int]]) -> int:
    """How many items the longest mission has at least: take-off, landing, and for each leg its speed and its end."""
    legs = (
        sum(len(_profile(plan, firmware, sampled, row, kept, 0.0)[1]) for kept in placed)
        for row in range(len(sampled.position_ned_m))
    )
    return 2 + 2 * max(legs)


def _attempt(plan: Plan, firmware: Autopilot, sampled: _Samples, stops: list[int], placed: list[list[int]]) -> _Attempt:
    """Speeds between waypoints. The leader's start fixes when all vehicles leave."""
    navigator = navigator_of(plan, firmware)
    t_s, position = sampled.t_s, sampled.position_ned_m
    rows = len(position)
    leader = plan.leader if rows > 1 else 0
    waypoints = [0]
    speeds: list[Array] = []
    waits: list[Array] = []
    raises_m = np.zeros(1)
    gates: list[Gate] = []
    takeoff = plan.phase(PhaseKind.TAKEOFF)
    hover_s = float(t_s[0]) - takeoff.end_s
    lead_s = (_GATE_LEAD_S,) * 2 if len(stops) > 2 else (0.0, min(LEAD_MAX_S, hover_s))
    leaves_s = math.nan
    off_s = 0.0
    for kept, last in zip(placed, stops[1:], strict=True):
        gate = last != stops[-1]
        terrain = TerrainRaise(plan, sampled.t_s[kept])
        early_s = _GATE_LEAD_S + SLACK_S if gate else 0.0
        part_speeds = np.full((rows, len(kept) - 1), np.nan)
        part_waits = np.zeros((rows, len(kept) - 1))
        alike = None
        for row in (leader, *(r for r in range(rows) if r != leader)):
            profile, legs = _profile(plan, firmware, sampled, row, kept, early_s)
            found = correct(navigator, profile, lead_s, alike)
            alike = alike or found.found
            too_near_m = terrain.raise_over_ground(navigator, profile, legs, found, row if rows > 1 else None)
            off_s = max(off_s, _worst_s(found, gate) + _NO_FLY_COST_SPM * too_near_m)
            part_speeds[row, legs], part_waits[row, legs] = found.speeds_mps, profile.holds_s
            part_waits[row, : legs[0]] = np.diff(t_s[kept])[: legs[0]]
            if row == leader:
                lead_s = (found.lead_s, found.lead_s)
        if math.isnan(leaves_s):
            leaves_s = float(t_s[0]) - lead_s[0]
        speeds.append(part_speeds)
        waits.append(part_waits)
        waypoints += kept[1:]
        raises_m = np.concatenate([raises_m, terrain.by_waypoint_m[1:]])
        if gate:
            gates.append(Gate(len(waypoints) - 1, float(t_s[last]) - _GATE_LEAD_S, SLACK_S))
            lead_s = (_GATE_LEAD_S,) * 2
    whole = SampledFlight(t_s, position)
    timed = TimedLegs(
        t_s[waypoints],
        deviation(whole, waypoints),
        np.concatenate(speeds, axis=1),
        leaves_s,
        tuple(gates),
        raises_m,
        np.concatenate(waits, axis=1),
    )
    return _Attempt(timed, off_s)


def _worst_s(found: Corrected, gate: bool) -> float:
    late = found.late_s[:-1] if gate and len(found.late_s) > 1 else found.late_s
    return float(np.abs(late).max())


def _profile(
    plan: Plan, firmware: Autopilot, sampled: _Samples, row: int, kept: list[int], early_s: float
) -> tuple[LegProfile, list[int]]:
    """Legs of one vehicle between two stops. The latter half is flown faster if the second stop is due early."""
    limits, takeoff = plan.scenario.limits, plan.phase(PhaseKind.TAKEOFF)
    begin_s = float(sampled.t_s[kept[0]])
    half_s = 0.5 * (float(sampled.t_s[kept[-1]]) - begin_s)
    slowest_mps, fastest_mps = firmware.traits.missions.speed_mps
    allowed = NavigatorLimits(
        np.array(limits.speed_ned_mps),
        max(_SLOWEST_MPS, slowest_mps),
        fastest_mps,
        firmware.navigator.delay_begins_m,
    )
    early = early_s * np.maximum((sampled.t_s - begin_s) / half_s - 1.0, 0.0)
    airborne_s = climb_s(plan, firmware) + begin_s - takeoff.end_s
    return leg_profile(sampled.t_s - early, sampled.position_ned_m[row], kept, allowed, airborne_s)


def _gate_samples(t_s: Array, gates: int, passed_s: Sequence[tuple[float, float]] = ()) -> list[int]:
    """Samples at which the formation stops, first and last included: whole seconds after the start, evenly spread.

    None is within a second of a route point, or of the hold there.
    """
    duration_s = float(t_s[-1] - t_s[0])
    if gates < 0 or (gates and duration_s / (gates + 1) < _GATES_EVERY_S):
        most = max(int(duration_s / _GATES_EVERY_S) - 1, 0)
        raise ScenarioError(
            f"{gates} gates do not fit a flight of {duration_s:.0f} s; limit {most}.",
            hint=f"give fewer --gates: they are at least {_GATES_EVERY_S:g} s apart",
        )
    free_s = [
        second
        for second in range(1, int(duration_s))
        if not any(begin - 1.0 < second + float(t_s[0]) < end + 1.0 for begin, end in passed_s)
    ]
    wanted_s = [round(duration_s * number / (gates + 1)) for number in range(1, gates + 1)]
    seconds = {min(free_s, key=lambda second: (abs(second - due_s), second), default=0) for due_s in wanted_s} - {0}
    if len(seconds) < gates:
        raise ScenarioError(
            f"{gates} gates do not fit between the route points and their holds.", hint="give fewer --gates"
        )
    return [0, *(int(np.abs(t_s - t_s[0] - second).argmin()) for second in sorted(seconds)), len(t_s) - 1]
