"""Verification of missions as read back from their files: limits, equality of formats, timing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gcs.autopilots.traits import Autopilot, titles
from gcs.errors import VerificationError
from gcs.frames import geodetic_to_ned
from gcs.mission.check.fleet_check import FleetReport, check_fleet
from gcs.mission.check.flight_limits import OVERSPEED, limits_of, surroundings_of
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.model import Altitude, VehicleMission
from gcs.mission.predicted.autopilot_flight import AutopilotFlight
from gcs.mission.predicted.timing import MARGIN_S, Timing
from gcs.mission.waypoints.arrival_times import climb_s
from gcs.scenario.navigation_error import judged_separation_m
from gcs.scenario.si import local_origin
from gcs.scenario.vehicle_ability import ability_of

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

_LISTED_MAX = 3
STREAM_INSTEAD = "fly the setpoint stream instead (--format setpoints): it keeps path and time"


def check_written(
    plan: Plan,
    autopilots: Sequence[Autopilot],
    fleets: Sequence[Sequence[MissionFile]],
    *,
    timed: bool = False,
    leaves_s: float | None = None,
) -> FleetReport:
    """The report on missions as read back from their files: for each format, one file for every vehicle.

    They are flown at their planned speeds or, if `timed`, by the model of their autopilot. Missions that wait until a
    time of day leave at plan time `leaves_s`. Raises `VerificationError` if two files of a vehicle differ.
    """
    first, *others = fleets
    scenario = plan.scenario
    limits = limits_of(scenario)
    if leaves_s is not None:
        limits = replace(limits, leaves_s=leaves_s)
    if timed:
        limits = replace(limits, overspeed=OVERSPEED)
        climbs_s = {known: climb_s(plan, known) for known in set(autopilots)}
        modelled = AutopilotFlight(ability_of(plan.quadrotor, scenario.limits), climbs_s)
        report = check_fleet(first, surroundings_of(scenario), limits, modelled)
    else:
        report = check_fleet(first, surroundings_of(scenario), limits)
    for fleet in others:
        for ours, theirs in zip(first, fleet, strict=True):
            same = ours.items == theirs.items and (ours.geofence, ours.rally) == (theirs.geofence, theirs.rally)
            if not same or theirs.home not in (ours.home, None):
                raise VerificationError(f"{ours.source} and {theirs.source} hold different missions")
    return report


def verify_box(plan: Plan, missions: Sequence[VehicleMission], altitude: Altitude) -> None:
    """Verify that waypoints between T0 and the arrival are inside the box (Eq. 51), to the mission's tolerance.

    Raises `VerificationError` for the waypoint of a vehicle that is farthest outside.
    """
    limits, tolerance_m = plan.scenario.limits, plan.scenario.mission.tolerance_m
    origin = local_origin(plan.scenario)
    for mission in missions:
        timed = [
            (index, item)
            for index, (item, t_s) in enumerate(zip(mission.items, mission.arrival_s, strict=True))
            if t_s is not None and item.frame == altitude.frame and 0.0 <= t_s <= plan.flight_s
        ]
        lat, lon = np.array([(i.lat_degE7 / 1e7, i.lon_degE7 / 1e7) for _, i in timed]).T
        places = geodetic_to_ned(lat, lon, origin.alt_amsl_m, origin)
        for axis, (name, (low, high)) in enumerate((("north", limits.north_m), ("east", limits.east_m))):
            out_m = np.maximum(low - places[:, axis], places[:, axis] - high)
            worst = int(np.argmax(out_m))
            if out_m[worst] > tolerance_m:
                raise VerificationError(
                    f"waypoint {timed[worst][0]} of vehicle {mission.sysid} is {out_m[worst]:.2f} m outside the "
                    f"{name} limits"
                )


def refuse_broken(report: FleetReport) -> None:
    """Raise `VerificationError` if the report has an error."""
    if not report.errors:
        return
    errors = "; ".join(str(e) for e in report.errors[:_LISTED_MAX])
    more = f"; and {len(report.errors) - _LISTED_MAX} more" if len(report.errors) > _LISTED_MAX else ""
    raise VerificationError(f"the missions as written failed verification: {errors}{more}", hint=STREAM_INSTEAD)


def refuse_untimely(plan: Plan, autopilots: Sequence[Autopilot], timing: Timing) -> None:
    """Raise `VerificationError` if vehicles may violate the separation, or miss a gate, because of their timing."""
    near, required_m = timing.nearest, judged_separation_m(plan.scenario)
    if near is not None and near.distance_m < required_m:
        first, second = near.sysids
        pair = titles(autopilots[plan.sysids.index(sysid)] for sysid in near.sysids)
        raise VerificationError(
            f"not fit for mission mode: vehicles {first} and {second} may come within {near.distance_m:.2f} m at "
            f"{near.t_s:.1f} s ({required_m:g} m required). Two vehicles under {pair} may be "
            f"{near.apart_s:g} s apart in time.",
            hint=f"{STREAM_INSTEAD}; --untimed writes missions with the plan's own speeds, without this check",
        )
    for number, early_s in enumerate(timing.gates_early_s, start=1):
        if early_s < MARGIN_S:
            raise VerificationError(
                f"not fit for mission mode: the last vehicle reaches gate {number} {early_s:.1f} s before it opens "
                f"({MARGIN_S:g} s required).",
                hint="give fewer --gates",
            )
