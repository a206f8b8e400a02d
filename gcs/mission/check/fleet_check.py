"""The check of a fleet's missions: items, flights, limits, fences and rally points, in this order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gcs.autopilots.altitudes import kept_alt_m
from gcs.autopilots.traits import Autopilot
from gcs.mission.check.beside_pads import check_pads
from gcs.mission.check.fence_and_rally import check_rally_apart, check_safety
from gcs.mission.check.findings import Finding, Level, Rule, worst
from gcs.mission.check.flight_checks import (
    Lowest,
    ZoneDistance,
    check_ground,
    check_limits,
    check_separation,
    check_zones,
)
from gcs.mission.check.flight_limits import FlightLimits
from gcs.mission.check.item_checks import check_items, check_places, found
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.model import MissionItem
from gcs.mission.predicted.closest_approach import Closest
from gcs.mission.predicted.planned_flight import PredictedFlight, Surroundings, fly, together

Fly = Callable[[MissionFile, Surroundings], PredictedFlight]


@dataclass(frozen=True)
class FleetReport:
    """Findings of a fleet check, and its least distance, clearance and duration."""

    findings: tuple[Finding, ...]
    closest: Closest | None  # of rows of the missions
    lowest: tuple[Lowest | None, ...]  # by mission
    duration_s: float
    flights: tuple[PredictedFlight, ...] = field(default=(), repr=False, compare=False)  # together, by mission
    zones: tuple[ZoneDistance | None, ...] = ()  # by mission

    @property
    def ok(self) -> bool:
        """Whether there is neither an error nor a warning."""
        return worst(self.findings) in (None, Level.NOTE)

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
    missions: Sequence[MissionFile], around: Surroundings, limits: FlightLimits, fly_one: Fly = fly
) -> FleetReport:
    """The report on missions that start together, one per vehicle, rounded as vehicles store them."""
    missions = [as_on_the_wire(mission) for mission in missions]
    placed = [check_places(mission) for mission in missions]
    missions = [mission for mission, _ in placed]
    flights = together([fly_one(mission, around) for mission in missions])
    findings: list[Finding] = []
    lowest, zones = [], []
    for (mission, far), flight in zip(placed, flights, strict=True):
        findings += [Finding(Rule.FORMAT, Level.WARNING, str(o), o.source, o.line) for o in mission.oddities]
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
    return FleetReport(
        tuple(findings), closest, tuple(lowest), float(max(f.t_s[-1] for f in flights)), flights, tuple(zones)
    )


def as_on_the_wire(mission: MissionFile) -> MissionFile:
    """The mission as a vehicle stores it: parameters as float32, altitudes rounded; positions are degE7 already."""
    return replace(mission, items=tuple(_kept(item, mission.firmware) for item in mission.items))


def _kept(item: MissionItem, firmware: Autopilot) -> MissionItem:
    with np.errstate(over="ignore"):
        p1, p2, p3, p4 = np.array(item.params, dtype=np.float32).tolist()
    return replace(item, params=(p1, p2, p3, p4), alt_m=kept_alt_m(item.alt_m, firmware))
