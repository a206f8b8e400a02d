"""Is what was written what was planned? The files' own text, read back and flown.

Knows: which files hold missions, what a plan asks of them. Does not know: formats, how flights are checked (`check`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gcs.autopilots.traits import Autopilot
from gcs.errors import VerificationError
from gcs.frames import geodetic_to_ned
from gcs.mission.check.fleet_check import FleetReport, check_fleet
from gcs.mission.check.flight_limits import OVERSPEED, limits_of, surroundings_of
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.model import Altitude, VehicleMission
from gcs.mission.predicted.autopilot_flight import AutopilotFlight
from gcs.mission.predicted.timing import MARGIN_S, Timing
from gcs.mission.waypoints.arrival_times import climb_s
from gcs.scenario.si import local_origin
from gcs.scenario.vehicle_ability import ability_of

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

_LISTED = 3
STREAM_INSTEAD = "fly the setpoint stream instead (--format setpoints), which keeps path and time"


def check_written(
    plan: Plan,
    firmware: Autopilot,
    fleets: Sequence[Sequence[MissionFile]],
    *,
    timed: bool = False,
    leaves_s: float | None = None,
) -> FleetReport:
    """Check missions as read back from their files: of each format, one file for every vehicle.

    They are flown at the speeds they ask for, or where those are corrected (`timed`) as the model of their autopilot
    flies them; those that wait for a time of day leave at plan time `leaves_s`. Raises `VerificationError` where two
    files of a vehicle differ.
    """
    first, *others = fleets
    scenario = plan.scenario
    limits = limits_of(scenario)
    if leaves_s is not None:
        limits = replace(limits, leaves_s=leaves_s)
    if timed:
        limits = replace(limits, overspeed=OVERSPEED)
        modelled = AutopilotFlight(ability_of(plan.quadrotor, scenario.limits), climb_s(plan, firmware))
        report = check_fleet(first, surroundings_of(scenario), limits, modelled)
    else:
        report = check_fleet(first, surroundings_of(scenario), limits)
    for fleet in others:
        for ours, theirs in zip(first, fleet, strict=True):
            same = ours.items == theirs.items and (ours.geofence, ours.rally) == (theirs.geofence, theirs.rally)
            if not same or theirs.home not in (ours.home, None):
                raise VerificationError(f"{ours.source} and {theirs.source} do not hold the same mission")
    return report


def verify_box(plan: Plan, missions: Sequence[VehicleMission], altitude: Altitude) -> None:
    """Waypoints of the paper's flight are inside its box (Eq. 51), to the mission's tolerance.

    Raises `VerificationError` for the first that is not.
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
    """Raise `VerificationError` when anything must not fly."""
    if not report.errors:
        return
    told = "; ".join(str(e) for e in report.errors[:_LISTED])
    more = f"; and {len(report.errors) - _LISTED} more" if len(report.errors) > _LISTED else ""
    raise VerificationError(
        f"the missions as written do not hold what they must: {told}{more}",
        hint=STREAM_INSTEAD,
    )


def refuse_untimely(plan: Plan, firmware: Autopilot, timing: Timing) -> None:
    """Raise `VerificationError` where vehicles may come too near to each other, or miss a gate, for their timing."""
    near, asked_m = timing.nearest, plan.scenario.judge.separation_min_m
    if near is not None and near.distance_m < asked_m:
        first, second = near.sysids
        raise VerificationError(
            f"not fit for mission mode: vehicles {first} and {second} may come within {near.distance_m:.2f} m of each "
            f"other at {near.t_s:.1f} s ({asked_m:g} m are asked), because vehicles that {firmware.title} flies may be "
            f"{near.apart_s:g} s apart.",
            hint=f"{STREAM_INSTEAD}; --untimed writes missions with the plan's own speeds all the same",
        )
    for number, early_s in enumerate(timing.gates_early_s, start=1):
        if early_s < MARGIN_S:
            raise VerificationError(
                f"not fit for mission mode: the last vehicle is at gate {number} {early_s:.1f} s before it opens; "
                f"{MARGIN_S:g} s are asked.",
                hint="ask for fewer gates",
            )
