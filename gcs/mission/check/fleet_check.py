"""The check of a fleet's missions: items, flights, limits, fences and rally points, in this order."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gcs.autopilots.mission_commands import kept_alt_m
from gcs.autopilots.traits import Autopilot
from gcs.mission.check.between_samples import clearance_along
from gcs.mission.check.fence_and_rally import check_rally_apart, check_safety
from gcs.mission.check.findings import Finding, Level, Rule, worst
from gcs.mission.check.flight_checks import (
    LENGTH_TOLERANCE_M,
    Lowest,
    ZoneDistance,
    check_ground,
    check_limits,
    check_separation,
    check_zones,
)
from gcs.mission.check.item_checks import check_items, check_places, found
from gcs.mission.flight_limits import FlightLimits, Surroundings
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.model import MissionItem
from gcs.mission.predicted.arrival_spread import ArrivalSpread, arrival_spread
from gcs.mission.predicted.closest_approach import Closest
from gcs.mission.predicted.planned_flight import PredictedFlight, fly, together
from gcs.mission.predicted.timing import GRID_S, nearest_apart
from gcs.plan.verification.constraints.ground_clearance import PAD_FREE_M, PAD_SHARE
from gcs.plan.verification.proof.verdict import ProofVerdict
from gcs.scenario.environment.ground_bounds import Highest
from gcs.types import Array

Fly = Callable[[MissionFile, Surroundings], PredictedFlight]
_STEP = 1.05  # of height, from one part of a vertical way to the next
_SUNK_M = 0.5  # home below the ground by rounding, or by a pad that a map leaves out


@dataclass(frozen=True)
class _Column:
    """A vertical way over a place that stands on the ground."""

    what: str
    north_east_m: Array  # (2,)
    foot_m: float  # heights of its lower and its upper end
    top_m: float
    foot_s: float
    top_s: float
    item: int

    def when_s(self, above_m: float) -> float:
        """The time at a height above its foot, at constant speed."""
        return self.foot_s + above_m / (self.top_m - self.foot_m) * (self.top_s - self.foot_s)


def check_pads(
    mission: MissionFile, flight: PredictedFlight, around: Surroundings, limits: FlightLimits
) -> Iterator[Finding]:
    """Errors for ground beside the take-off or the landing, and a warning for a home below the ground.

    There a vehicle is near the ground, so it cannot keep the clearance of the flight. As in plans, the distance
    must be a quarter of the height above the pad less 0.25 m, and at most a quarter of the clearance: slopes are
    allowed, a wall is not. The way from the take-off to the first waypoint belongs to the flight
    (`flight_checks.check_ground`).
    """
    if around.highest is None:
        return
    sunk_m = float(around.height_of_ground_m(flight.ned_m[0], 0.0) + flight.ned_m[0, 2])
    if sunk_m > _SUNK_M:
        message = f"home is {sunk_m:.2f} m below the ground; altitudes above home are too low by as much"
        yield found(mission, Rule.TERRAIN, Level.WARNING, message)
    for column in _columns(flight, around):
        yield from _beside(mission, column, around.highest, limits)


def _columns(flight: PredictedFlight, around: Surroundings) -> Iterator[_Column]:
    """The vertical ways of a flight that leads up from its pad, or down to the ground."""
    last = len(flight.t_s) - 1
    up = int(np.searchsorted(flight.t_s, flight.up_s, side="left"))
    down = int(np.searchsorted(flight.t_s, flight.down_s, side="right")) - 1
    ways = [("pad", 0, min(up, last))]
    if np.isfinite(flight.ends_s):
        ways.append(("landing point", last, down))
    for what, foot, top in ways:
        foot_m = max(-float(flight.ned_m[foot, 2]), float(around.height_of_ground_m(flight.ned_m[foot], 0.0)))
        top_m = -float(flight.ned_m[top, 2])
        if top_m > foot_m:
            times = float(flight.t_s[foot]), float(flight.t_s[top])
            yield _Column(what, flight.ned_m[foot, :2], foot_m, top_m, *times, int(flight.item[max(foot, top)]))


def _beside(mission: MissionFile, column: _Column, highest: Highest, limits: FlightLimits) -> Iterator[Finding]:
    """An error where the ground beside a climb or descent is too near, for the worst such part."""
    ratio = max((column.top_m - column.foot_m) / PAD_FREE_M, 1.0)
    low_m = np.geomspace(
        PAD_FREE_M, max(column.top_m - column.foot_m, PAD_FREE_M), 2 + int(np.log(ratio) / np.log(_STEP))
    )
    low_m, high_m = low_m[:-1], low_m[1:]
    asked_m = PAD_SHARE * np.minimum(low_m - PAD_FREE_M, limits.clearance_m) - LENGTH_TOLERANCE_M
    near_m = column.north_east_m + np.zeros((len(low_m), 1))
    half_m = np.maximum(asked_m, 0.0)
    over_m = column.foot_m + low_m - highest(near_m - half_m[:, None], near_m + half_m[:, None])
    near = np.flatnonzero((asked_m > 0.0) & (over_m < asked_m))
    for part in near[np.argsort(over_m[near] - asked_m[near])].tolist():
        begin, end = (
            np.array([[*column.north_east_m, -(column.foot_m + float(height_m[part]))]]) for height_m in (low_m, high_m)
        )
        bound = clearance_along(highest, begin, end, float(asked_m[part]), slack=np.zeros(1), duration_s=np.ones(1))
        if bound.verdict is not ProofVerdict.PROVED:
            above_m, required_m = float(low_m[part]), float(asked_m[part]) + LENGTH_TOLERANCE_M
            message = (
                f"{max(bound.least, 0.0):.2f} m from the ground beside the {column.what}, {above_m:.1f} m above it; "
                f"at least {required_m:.2f} m required"
            )
            yield found(mission, Rule.TERRAIN, Level.ERROR, message, column.item, column.when_s(above_m))
            return


@dataclass(frozen=True)
class FleetReport:
    """Findings of a fleet check, and its least distance, clearance and duration."""

    findings: tuple[Finding, ...]
    closest: Closest | None  # of rows of the missions
    lowest: tuple[Lowest | None, ...]  # by mission
    duration_s: float
    flights: tuple[PredictedFlight, ...] = field(default=(), repr=False, compare=False)  # together, by mission
    zones: tuple[ZoneDistance | None, ...] = ()  # by mission
    spreads: tuple[ArrivalSpread, ...] = field(default=(), repr=False, compare=False)  # by mission

    @property
    def ok(self) -> bool:
        """Whether there is neither an error nor a warning."""
        return worst(self.findings) in (None, Level.NOTE)

    @property
    def spread_s(self) -> float:
        """How early or late a vehicle may be, by what its autopilot may do, s."""
        return max((spread.widest_s for spread in self.spreads), default=0.0)

    @property
    def errors(self) -> tuple[Finding, ...]:
        """The findings for which the missions must not fly."""
        return tuple(f for f in self.findings if f.level is Level.ERROR)

    @property
    def clearance_min_m(self) -> float | None:
        """The least clearance of all vehicles above the ground; None where the ground is unknown."""
        return min((low.clearance_m for low in self.lowest if low is not None), default=None)

    @property
    def clearance_proved_m(self) -> float | None:
        """The clearance that no vehicle falls below at any instant; None where the ground is unknown."""
        return min((low.proved_m for low in self.lowest if low is not None), default=None)


def check_fleet(
    missions: Sequence[MissionFile],
    around: Surroundings,
    limits: FlightLimits,
    fly_one: Fly = fly,
    others: Sequence[Fly] = (),
) -> FleetReport:
    """The report on missions that start together, one per vehicle, rounded as vehicles store them.

    The rules of flights hold for the `others` too, the ends of what autopilots may do: for any two vehicles, whatever
    either of them does.
    """
    missions = [as_on_the_wire(mission) for mission in missions]
    placed = [check_places(mission) for mission in missions]
    missions = [mission for mission, _ in placed]
    flights = together([fly_one(mission, around) for mission in missions])
    findings: list[Finding] = []
    lowest, zones = [], []
    for (mission, far), flight in zip(placed, flights, strict=True):
        findings += [Finding(Rule.FORMAT, Level.WARNING, str(o), o.source, o.line) for o in mission.quirks]
        findings += check_items(mission)
        findings += far
        if mission.home is None:
            message = "the file has no home position; the check takes the first position instead"
            findings.append(found(mission, Rule.ASSUMED, Level.NOTE, message))
        for index, remark in flight.remarks:
            findings.append(found(mission, Rule.ASSUMED, Level.NOTE, remark, index))
        low, grounded = check_ground(mission, flight, around, limits)
        lowest.append(low)
        findings += grounded
        findings += check_pads(mission, flight, around, limits)
        findings += check_limits(mission, flight, limits)
        near_zone, entered = check_zones(mission, flight, limits)
        zones.append(near_zone)
        findings += entered
        findings += check_safety(mission, flight, around)
    closest, near = check_separation(missions, flights, limits)
    findings += near
    findings += check_rally_apart(missions, around, limits.separation_m)
    ends = [together([each(mission, around) for mission in missions]) for each in others]
    spreads = tuple(arrival_spread(flight, [end[row] for end in ends]) for row, flight in enumerate(flights))
    if any(spread.widest_s > 0.0 for spread in spreads):
        known = {(finding.rule, finding.source) for finding in findings}
        findings += [each for each in _of_ends(missions, ends, around, limits) if (each.rule, each.source) not in known]
    ends_s = float(max(flight.t_s[-1] for flight in flights))
    return FleetReport(tuple(findings), closest, tuple(lowest), ends_s, flights, tuple(zones), spreads)


def _of_ends(
    missions: Sequence[MissionFile],
    ends: Sequence[Sequence[PredictedFlight]],
    around: Surroundings,
    limits: FlightLimits,
) -> Iterator[Finding]:
    """Errors of the flights at the ends of what autopilots may do: those of each, and of any two of them together."""
    findings: list[Finding] = []
    for flights in ends:
        for mission, flight in zip(missions, flights, strict=True):
            findings += check_ground(mission, flight, around, limits)[1]
            findings += check_limits(mission, flight, limits)
            findings += check_zones(mission, flight, limits)[1]
    # Two rows differ in a bit of their numbers: one of these fleets has each of the two at either end.
    choices = {(0,) * len(missions), (1,) * len(missions)}
    for bit in range(len(missions).bit_length()):
        ones = tuple(row >> bit & 1 for row in range(len(missions)))
        choices |= {ones, tuple(1 - one for one in ones)}
    for choice in sorted(choices):
        findings += check_separation(missions, [ends[end][row] for row, end in enumerate(choice)], limits)[1]
    reported = set()
    for finding in findings:
        if finding.level is Level.ERROR and (finding.rule, finding.source) not in reported:
            reported.add((finding.rule, finding.source))
            yield replace(finding, message=f"{finding.message}, by what its autopilot may do")


def check_apart(missions: Sequence[MissionFile], report: FleetReport, limits: FlightLimits) -> Iterator[Finding]:
    """An error if two vehicles may come too close because each is early or late by what its autopilot may do.

    It may be anywhere between both ends, and two differ by their `apart_s` besides. Take-offs and landings are left
    out. Of a separation that is violated anyway nothing more is said.
    """
    flights = report.flights
    if len(flights) < 2 or any(finding.rule is Rule.SEPARATION for finding in report.findings):
        return
    ends_s = min(min(flight.down_s, float(flight.t_s[-1])) for flight in flights)
    t_s = np.arange(max(flight.up_s for flight in flights), ends_s, GRID_S)
    flown = np.array([np.stack([np.interp(t_s, f.t_s, axis) for axis in f.ned_m.T], axis=-1) for f in flights])
    windows_s = np.array([spread.at(t_s) for spread in report.spreads])
    autopilots = [mission.firmware for mission in missions]
    near = nearest_apart(range(len(flights)), autopilots, t_s, flown, windows_s, limits.separation_m)
    if near is None or near.distance_m >= limits.separation_m:
        return
    first, second = near.sysids
    item = int(flights[first].item[np.searchsorted(flights[first].t_s, near.t_s)])
    message = (
        f"may come within {near.distance_m:.2f} m of the vehicle of {missions[second].source} if one is up to "
        f"{near.apart_s:.3g} s early; at least {limits.separation_m:g} m required"
    )
    yield found(missions[first], Rule.SEPARATION, Level.ERROR, message, item, near.t_s)


def as_on_the_wire(mission: MissionFile) -> MissionFile:
    """The mission as a vehicle stores it: parameters as float32, altitudes rounded; positions are degE7 already."""
    return replace(mission, items=tuple(_kept(item, mission.firmware) for item in mission.items))


def _kept(item: MissionItem, firmware: Autopilot) -> MissionItem:
    with np.errstate(over="ignore"):
        p1, p2, p3, p4 = np.array(item.params, dtype=np.float32).tolist()
    return replace(item, params=(p1, p2, p3, p4), alt_m=kept_alt_m(item.alt_m, firmware))
