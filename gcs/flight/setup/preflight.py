"""The pre-flight checks: the report of every vehicle against what the plan requires. A missing report is a no-go.

Battery: with battery and propellers in the scenario, the flight needs the energy of its plan
(`gcs.plan.trajectory.energy`). Otherwise a full battery is assumed to hover for `endurance_s`, and the flight needs its
own duration of that, times `effort` for climbs and wind. `reserve` is left at the end.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gcs.errors import FlightError, GcsError
from gcs.frames import geodetic_to_ned
from gcs.link.fleet_upload.upload_fleet import ParameterChange, restore
from gcs.link.session.linked_fleet import LinkedFleet
from gcs.link.session.status_report import VehicleReport, status_report
from gcs.link.session.vehicle_session import VehicleSession
from gcs.mission.model import Home
from gcs.physics.quadrotor import Array
from gcs.plan.trajectory.energy import energy_Wh
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.si import local_origin

_RTK_FIXED = 6
_CONFUSED_M = {True: 0.15, False: 1.5}  # with and without an RTK fix: nearer to another pad by more than this


@dataclass(frozen=True)
class PreflightLimits:
    """The limits for vehicles on their pads."""

    pad_m: float = 3.0  # from its own pad, horizontally
    height_m: float = 10.0  # GNSS heights err by metres
    home_m: float = 3.0  # home from its position
    origin_m: float = 5.0  # its local frame's origin from its pad
    round_trip_s: float = 1.0
    endurance_s: float = 900.0  # of hover on a full battery, without [vehicle.power]
    effort: float = 1.15
    reserve: float = 0.25  # of a full battery


@dataclass(frozen=True)
class PreflightCheck:
    """One check of one vehicle."""

    sysid: int
    name: str
    measured: str
    required: str
    ok: bool


def preflight(
    plan: Plan, reports: Mapping[int, VehicleReport], limits: PreflightLimits | None = None
) -> tuple[PreflightCheck, ...]:
    """Return every check of every vehicle, in the plan's order."""
    limits = limits or PreflightLimits()
    needed = battery_needed(plan, limits)
    checks = []
    for row, sysid in enumerate(plan.sysids):
        checks += _checks(plan, row, reports[sysid], limits)
        checks.append(_battery(sysid, reports[sysid].battery_share, float(needed[row]), plan, limits))
    return tuple(checks)


def refuse_no_go(checks: Sequence[PreflightCheck]) -> None:
    """Raises `FlightError` that names the failed checks, six at most."""
    bad = [c for c in checks if not c.ok]
    if bad:
        listed = "; ".join(f"vehicle {c.sysid}: {c.name}: {c.measured} (required: {c.required})" for c in bad[:6])
        more = f"; and {len(bad) - 6} more" if len(bad) > 6 else ""
        raise FlightError(f"no-go: {listed}{more}.", hint="fix the failed checks, then run again; no vehicle was armed")


def battery_needed(plan: Plan, limits: PreflightLimits) -> Array:
    """Return the share of a full battery that the flight needs, per vehicle (V,), without the reserve."""
    taken_Wh, power = energy_Wh(plan), plan.scenario.vehicle.power
    if taken_Wh is None or power is None:
        flight_s = plan.t_end_s - plan.t_start_s
        return np.full(len(plan.sysids), flight_s * limits.effort / limits.endurance_s)
    return taken_Wh / power.battery_Wh


def _reserve_text(plan: Plan, limits: PreflightLimits) -> str:
    """The required reserve, and what the need is computed from."""
    power = plan.scenario.vehicle.power
    if power is None:
        known = f"{limits.endurance_s / 60:g} min of hover assumed: no [vehicle.power]"
    else:
        known = f"of {power.battery_Wh:g} Wh, need from the plan"
    return f"{limits.reserve:.0%} left ({known})"


def _checks(plan: Plan, row: int, report: VehicleReport, limits: PreflightLimits) -> list[PreflightCheck]:
    sysid = plan.sysids[row]

    def check(name: str, measured: str | None, required: str, ok: bool) -> PreflightCheck:
        return PreflightCheck(sysid, name, measured or "not reported", required, ok and measured is not None)

    pads = plan.pads_ned_m
    place = _ned(plan, report.position)
    checks = [
        check("disarmed", "armed" if report.armed else "disarmed", "disarmed", not report.armed),
        check("position estimate", _health(report.estimate_ok), "healthy", bool(report.estimate_ok)),
        check("sensors", ", ".join(report.ailing) or "healthy", "healthy", not report.ailing),
    ]
    if place is None:
        checks.append(check("pad", None, f"within {limits.pad_m:g} m", False))
    else:
        away_m = np.linalg.norm(pads[:, :2] - place[:2], axis=1)
        nearest = int(np.argmin(away_m))
        sure_m = _CONFUSED_M[report.fix_type == _RTK_FIXED]
        wrong = nearest != row and away_m[row] - away_m[nearest] > sure_m
        measured = f"{away_m[row]:.2f} m away" + (f", on the pad of vehicle {plan.sysids[nearest]}" if wrong else "")
        checks.append(
            check("pad", measured, f"within {limits.pad_m:g} m", not wrong and float(away_m[row]) <= limits.pad_m)
        )
        high_m = float(pads[row, 2] - place[2])
        checks.append(
            check("height", f"{high_m:+.1f} m", f"within {limits.height_m:g} m", abs(high_m) <= limits.height_m)
        )
    checks += [
        check("home", *_distance(_ned(plan, report.home), pads[row] if place is None else place, limits.home_m)),
        check("local frame", *_distance(_ned(plan, report.origin), pads[row], limits.origin_m)),
    ]
    sync = report.timesync
    trip = None if sync is None else f"{1e3 * sync.round_trip_s:.0f} ms round trip"
    required = f"at most {1e3 * limits.round_trip_s:.0f} ms"
    checks.append(check("clock", trip, required, sync is not None and sync.round_trip_s <= limits.round_trip_s))
    return checks


def _battery(sysid: int, share: float | None, needed: float, plan: Plan, limits: PreflightLimits) -> PreflightCheck:
    have = "charge not reported" if share is None else f"has {share:.0%}"
    enough = share is not None and share >= needed + limits.reserve
    return PreflightCheck(sysid, "battery", f"{have}, needs {needed:.0%}", _reserve_text(plan, limits), enough)


def _distance(place: Array | None, expected: Array, most_m: float) -> tuple[str | None, str, bool]:
    """What is measured, what is required, and whether that is met."""
    required = f"within {most_m:g} m"
    if place is None:
        return None, required, False
    away_m = float(np.linalg.norm((place - expected)[:2]))
    return f"{away_m:.2f} m away", required, away_m <= most_m


def _ned(plan: Plan, place: Home | None) -> Array | None:
    if place is None:
        return None
    origin = local_origin(plan.scenario)
    ned = geodetic_to_ned(np.array(place.lat_deg), np.array(place.lon_deg), np.array(place.alt_amsl_m), origin)
    return np.asarray(ned, dtype=float).reshape(3)


def _health(good: bool | None) -> str | None:
    return None if good is None else ("healthy" if good else "not healthy")


async def go_or_no_go(
    fleet: LinkedFleet,
    sessions: Mapping[int, VehicleSession],
    plan: Plan,
    limits: PreflightLimits,
    show: Callable[[tuple[PreflightCheck, ...]], None],
) -> tuple[PreflightCheck, ...]:
    """Return the checks of all vehicles, after `show`. Raises `FlightError` for a no-go, `DuplicateSystemId`."""
    requests = ((sysid, status_report(s, fleet.where(s.station.sysid))) for sysid, s in sessions.items())
    sysids, surveys = zip(*requests, strict=True)
    reports = dict(zip(sysids, await asyncio.gather(*surveys), strict=True))
    fleet.check()
    checks = preflight(plan, reports, limits)
    show(checks)
    refuse_no_go(checks)
    return checks


async def restore_parameters(
    sessions: Mapping[int, VehicleSession], changes: tuple[ParameterChange, ...], say: Callable[[str], None]
) -> None:
    """Restore the parameters from before the upload. A failure is reported by `say`, not raised: the flight is over."""
    if not changes:
        return
    try:
        await restore(sessions, changes)
    except GcsError as error:
        say(f"WARNING: not all parameters were restored: {error.message}")
    else:
        say(f"{len(changes)} parameters restored")
