"""Go or no-go: what every vehicle tells of itself against what the plan takes for granted.

Knows: plan, reports of vehicles, how much each may differ. Does not know: links (reports come from
`gcs.link.session.status_report`), screens. Nothing is sent; a vehicle that does not tell what is asked is a no-go.

Battery: a flight needs what its plan takes (`gcs.plan.trajectory.energy`), where the scenario has battery and
propellers; else a full battery is taken to hover for `endurance_s`, and the flight to need its own duration of that,
times `effort` for climbs and wind. `reserve` is left at the end.
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
_CONFUSED_M = {True: 0.15, False: 1.5}  # with an RTK fix, and without: nearer to another pad by more than this


@dataclass(frozen=True)
class PreflightLimits:
    """What is asked of vehicles on their pads."""

    pad_m: float = 3.0  # from its own pad, level
    height_m: float = 10.0  # GNSS heights err by metres
    home_m: float = 3.0  # home from where it stands
    origin_m: float = 5.0  # its local frame's origin from its pad
    round_trip_s: float = 1.0
    endurance_s: float = 900.0  # of hover on a full battery that nobody has described
    effort: float = 1.15
    reserve: float = 0.25  # of a full battery


@dataclass(frozen=True)
class PreflightCheck:
    """One line of the table: what was looked at, what was found, whether that is good."""

    sysid: int
    name: str
    found: str
    asked: str
    ok: bool


def preflight(
    plan: Plan, reports: Mapping[int, VehicleReport], limits: PreflightLimits | None = None
) -> tuple[PreflightCheck, ...]:
    """Every check of every vehicle, in the plan's order."""
    limits = limits or PreflightLimits()
    needed = battery_needed(plan, limits)
    found = []
    for row, sysid in enumerate(plan.sysids):
        found += _checks(plan, row, reports[sysid], limits)
        found.append(_battery(sysid, reports[sysid].battery_share, float(needed[row]), plan, limits))
    return tuple(found)


def refuse_no_go(checks: Sequence[PreflightCheck]) -> None:
    """Raises `FlightError` that names everything that is not good."""
    bad = [c for c in checks if not c.ok]
    if bad:
        listed = "; ".join(f"vehicle {c.sysid}: {c.name} {c.found}, asked {c.asked}" for c in bad[:6])
        more = f"; and {len(bad) - 6} more" if len(bad) > 6 else ""
        raise FlightError(f"no-go: {listed}{more}.", hint="mend it and start again; nothing was armed")


def battery_needed(plan: Plan, limits: PreflightLimits) -> Array:
    """The share of a full battery that the flight takes, for each vehicle (V,); without the reserve."""
    taken_Wh, power = energy_Wh(plan), plan.scenario.vehicle.power
    if taken_Wh is None or power is None:
        flight_s = plan.t_end_s - plan.t_start_s
        return np.full(len(plan.sysids), flight_s * limits.effort / limits.endurance_s)
    return taken_Wh / power.battery_Wh


def reserve_asked(plan: Plan, limits: PreflightLimits) -> str:
    """The reserve, and what a flight's need was taken from, in words."""
    power = plan.scenario.vehicle.power
    if power is None:
        known = f"{limits.endurance_s / 60:g} min of hover assumed: no [vehicle.power]"
    else:
        known = f"of {power.battery_Wh:g} Wh, need from the plan"
    return f"{limits.reserve:.0%} left ({known})"


def _checks(plan: Plan, row: int, report: VehicleReport, limits: PreflightLimits) -> list[PreflightCheck]:
    sysid = plan.sysids[row]

    def check(name: str, found: str | None, asked: str, ok: bool) -> PreflightCheck:
        return PreflightCheck(sysid, name, "does not tell" if found is None else found, asked, ok and found is not None)

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
        found = f"{away_m[row]:.2f} m away" + (f", on the pad of vehicle {plan.sysids[nearest]}" if wrong else "")
        checks.append(
            check("pad", found, f"within {limits.pad_m:g} m", not wrong and float(away_m[row]) <= limits.pad_m)
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
    asked = f"at most {1e3 * limits.round_trip_s:.0f} ms"
    checks.append(check("clock", trip, asked, sync is not None and sync.round_trip_s <= limits.round_trip_s))
    return checks


def _battery(sysid: int, share: float | None, needed: float, plan: Plan, limits: PreflightLimits) -> PreflightCheck:
    have = "does not tell" if share is None else f"has {share:.0%}"
    enough = share is not None and share >= needed + limits.reserve
    return PreflightCheck(sysid, "battery", f"{have}, needs {needed:.0%}", reserve_asked(plan, limits), enough)


def _distance(place: Array | None, wanted: Array, most_m: float) -> tuple[str | None, str, bool]:
    """Found, asked, and whether that is good."""
    asked = f"within {most_m:g} m"
    if place is None:
        return None, asked, False
    away_m = float(np.linalg.norm((place - wanted)[:2]))
    return f"{away_m:.2f} m away", asked, away_m <= most_m


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
    """Ask all vehicles, show what was found. Raises `FlightError` for a no-go, `DuplicateSystemId`."""
    asked = ((sysid, status_report(s, fleet.where(s.station.sysid))) for sysid, s in sessions.items())
    sysids, surveys = zip(*asked, strict=True)
    reports = dict(zip(sysids, await asyncio.gather(*surveys), strict=True))
    fleet.check()
    checks = preflight(plan, reports, limits)
    show(checks)
    refuse_no_go(checks)
    return checks


async def put_back(
    sessions: Mapping[int, VehicleSession], changes: tuple[ParameterChange, ...], say: Callable[[str], None]
) -> None:
    """Parameters as they were before the upload; who does not answer is told, and the flight's own end stays."""
    if not changes:
        return
    try:
        await restore(sessions, changes)
    except GcsError as error:
        say(f"parameters were not all put back: {error.message}")
    else:
        say(f"{len(changes)} parameters are as they were")
