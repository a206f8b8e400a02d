"""Pre-flight checks: every vehicle's report against the plan. A missing report is a no-go.

Every vehicle has every check of `_KINDS`, so that the table of a fleet has no holes.

Battery: with battery and propellers in the scenario, the flight needs the energy of its plan
(`gcs.plan.trajectory.energy`), in percent of the battery that the vehicle is set to. Otherwise a full battery is
assumed to hover for `endurance_s`, and the flight needs its own duration of that, times `effort` for climbs and wind.
`reserve` is left at the end. In the hover before T0 the measured current takes the place of both
(`gcs.flight.execution.hover_charge`).
"""

import asyncio
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from gcs.autopilots.traits import link_behaviour
from gcs.errors import PeerError
from gcs.flight.monitoring.fleet_time import AGREE_S, differences_s
from gcs.flight.monitoring.own_battery import ChargeRule, OwnBattery, nominal_V, own_battery
from gcs.flight.monitoring.preflight_check import NOT_REPORTED, CheckName, PreflightCheck, refuse_no_go, waive
from gcs.flight.monitoring.progress import ALL_VEHICLES, Event, Watcher
from gcs.flight.setup.timing_check import timing_check
from gcs.frames import geodetic_to_ned
from gcs.link.session.linked_fleet import LinkedFleet
from gcs.link.session.status_report import REPEATED_S, VehicleReport, status_report, until_reason
from gcs.link.session.vehicle_load import VehicleLoad
from gcs.link.session.vehicle_session import VehicleSession
from gcs.mission.model import Home
from gcs.plan.trajectory.energy import charge_needed
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.wind_envelope import proved_everywhere, proved_mps, wind_envelope
from gcs.scenario.schema.scenario import Power, PreflightTable
from gcs.scenario.values.si import local_origin
from gcs.types import Array
from gcs.util.steady_loop import host_s

_RTK_FIXED = 6
_CONFUSED_M = {True: 0.15, False: 1.5}  # with and without an RTK fix: nearer to another pad by more than this


@dataclass(frozen=True)
class _Situation:
    """One vehicle on its pad, and what the plan needs of it."""

    plan: Plan
    row: int
    report: VehicleReport
    limits: PreflightTable
    needed: float  # share of the full battery of the scenario

    @property
    def battery(self) -> OwnBattery:
        return own_battery(self.report, self.plan.scenario.vehicle.power)

    @property
    def pad_ned_m(self) -> Array:
        return np.asarray(self.plan.pads_ned_m[self.row])

    def ned_m(self, place: Home | None) -> Array | None:
        """Return a place in the plan's frame (3,)."""
        if place is None:
            return None
        origin = local_origin(self.plan.scenario)
        ned = geodetic_to_ned(np.array(place.lat_deg), np.array(place.lon_deg), np.array(place.alt_amsl_m), origin)
        return np.asarray(ned, dtype=float).reshape(3)


class _Measured(NamedTuple):
    text: str | None  # None: not reported
    ok: bool
    warning: str = ""


_ABSENT = _Measured(None, ok=False)


@dataclass(frozen=True)
class _Kind:
    """One kind of check: what it requires by plan and limits, and how a vehicle's report is measured."""

    required: Callable[[Plan, PreflightTable], str]
    measure: Callable[[_Situation], _Measured]


def preflight(
    plan: Plan, reports: Mapping[int, VehicleReport], limits: PreflightTable | None = None
) -> tuple[PreflightCheck, ...]:
    """Return every check of every vehicle, in the plan's order. What is not reported is a no-go.

    The limits are those of the scenario unless others are given.
    """
    limits = limits or plan.scenario.preflight
    needed = charge_needed(plan, limits)
    checks = []
    for row, sysid in enumerate(plan.sysids):
        report = reports.get(sysid)
        for name, kind in _KINDS.items():
            found = _ABSENT
            if report is not None:
                found = kind.measure(_Situation(plan, row, report, limits, float(needed[row])))
            text = NOT_REPORTED if found.text is None else found.text
            checks.append(
                PreflightCheck(sysid, name, text, kind.required(plan, limits), found.ok, warning=found.warning)
            )
    return tuple(checks)


def _disarmed(now: _Situation) -> _Measured:
    return _Measured("armed" if now.report.armed else "disarmed", not now.report.armed)


def _can_arm(now: _Situation) -> _Measured:
    """The autopilot's own word; where it is not known, the reasons against arming that were heard."""
    if texts := now.report.not_ready_texts:
        return _Measured("; ".join(texts), ok=False)
    good = now.report.prearm_ok
    return _ABSENT if good is None else _Measured("yes" if good else "no, reason not told", good)


def _estimate(now: _Situation) -> _Measured:
    good = now.report.estimate_ok
    return _ABSENT if good is None else _Measured("healthy" if good else "not healthy", good)


def _sensors(now: _Situation) -> _Measured:
    """A sensor that is only mentioned may be ailing; one that the scenario requires must be there."""
    ailing, limits = now.report.ailing, now.limits
    if ailing is None:
        return _ABSENT
    tolerated = {*now.report.mentioned_sensors, *limits.mentioned_sensors} - {*limits.required_sensors}
    bad = [name for name in ailing if name not in tolerated]
    bad += [
        f"{name} not enabled"
        for name in limits.required_sensors
        if name not in (now.report.working or ()) and name not in ailing
    ]
    mentioned = [name for name in ailing if name in tolerated]
    text = ", ".join(bad) or "healthy"
    return _Measured(text + (f" (mentioned: {', '.join(mentioned)} not healthy)" if mentioned else ""), not bad)


def _sensors_required(_: Plan, limits: PreflightTable) -> str:
    return "healthy" + (f", also {', '.join(limits.required_sensors)}" if limits.required_sensors else "")


def _pad(now: _Situation) -> _Measured:
    place = now.ned_m(now.report.position)
    if place is None:
        return _ABSENT
    away_m = np.linalg.norm(now.plan.pads_ned_m[:, :2] - place[:2], axis=1)
    nearest, own_m = int(np.argmin(away_m)), float(away_m[now.row])
    sure_m = _CONFUSED_M[now.report.fix_type == _RTK_FIXED]
    wrong = nearest != now.row and own_m - away_m[nearest] > sure_m
    there = wrong and away_m[nearest] <= now.limits.pad_m
    text = f"{own_m:.2f} m away" + (f", on the pad of vehicle {now.plan.sysids[nearest]}" if there else "")
    return _Measured(text, bool(not wrong and own_m <= now.limits.pad_m))


def _height(now: _Situation) -> _Measured:
    place = now.ned_m(now.report.position)
    if place is None:
        return _ABSENT
    high_m = float(now.pad_ned_m[2] - place[2])
    return _Measured(f"{high_m:+.1f} m", abs(high_m) <= now.limits.height_m)


def _home(now: _Situation) -> _Measured:
    place = now.ned_m(now.report.position)
    return _distance(now.ned_m(now.report.home), now.pad_ned_m if place is None else place, now.limits.home_m)


def _local_frame(now: _Situation) -> _Measured:
    return _distance(now.ned_m(now.report.origin), now.pad_ned_m, now.limits.origin_m)


def _distance(place: Array | None, expected: Array, most_m: float) -> _Measured:
    if place is None:
        return _ABSENT
    away_m = float(np.linalg.norm((place - expected)[:2]))
    return _Measured(f"{away_m:.2f} m away", away_m <= most_m)


def _clock(now: _Situation) -> _Measured:
    sync = now.report.timesync
    if sync is None:
        return _ABSENT
    off_s = now.report.gnss_off_s
    text = f"{1e3 * sync.round_trip_s:.0f} ms round trip"
    if abs(off_s) > AGREE_S + sync.round_trip_s:
        return _Measured(f"GNSS time is off by {off_s:+.2f} s from the others, {text}", ok=False)
    return _Measured(text, sync.round_trip_s <= now.limits.round_trip_s)


def _clock_required(_: Plan, limits: PreflightTable) -> str:
    return f"at most {1e3 * limits.round_trip_s:.0f} ms, GNSS times within {AGREE_S:g} s"


def _battery(now: _Situation) -> _Measured:
    share = now.report.battery_share
    have = "charge not reported" if share is None else f"has {share:.0%}"
    needed = now.needed * now.battery.scale(now.plan.scenario.vehicle.power)
    enough = share is not None and share >= needed + now.limits.reserve
    own = now.battery
    of = "" if own.full_Wh is None else f" of {own.full_Wh:.1f} Wh ({own} at {own.nominal_V:.3g} V)"
    return _Measured(f"{have}, needs {needed:.0%}{of}", enough)


def _battery_required(plan: Plan, limits: PreflightTable) -> str:
    """The required reserve, and what the need is computed from."""
    power = plan.scenario.vehicle.power
    if power is None:
        known = f"{limits.endurance_s / 60:g} min of hover assumed: no [vehicle.power]"
    else:
        known = f"need from the plan; {power.battery_Wh:g} Wh in [vehicle.power]"
    return f"{limits.reserve:.0%} left ({known})"


def _capacity(now: _Situation) -> _Measured:
    """A vehicle computes its charge from its own capacity, so a wrong one makes every limit of charge wrong."""
    return compare_capacity(now.report, now.plan.scenario.vehicle.power, now.limits.capacity_tolerance)


def _wind(now: _Situation) -> _Measured:
    """Most vehicles know no wind before they fly, so one that reports none passes."""
    wind = now.report.wind
    if wind is None:
        return _Measured("not reported", ok=True)
    envelope = wind_envelope(now.plan)
    allowed = f"up to {proved_mps(envelope.ok_from(wind.from_deg))} m/s from there"
    text = f"{wind.speed_mps:.1f} m/s from {wind.from_deg:.0f}°, {allowed}"
    return _Measured(text, envelope.allows(wind.speed_mps, wind.from_deg))


def _wind_required(plan: Plan, _: PreflightTable) -> str:
    return f"in the plan's wind envelope: {proved_everywhere(plan)}"


def _messages(now: _Situation) -> _Measured:
    texts = now.report.critical_texts
    return _Measured("; ".join(texts) or "none", not texts)


def compare_capacity(report: VehicleReport, power: Power | None, tolerance: float) -> _Measured:
    """Compare the capacity that a vehicle is set to with that of `[vehicle.power]`, where both are known."""
    name, own_mAh = report.capacity_parameter, report.capacity_mAh
    if name is None or own_mAh is None:
        return _Measured("not reported", ok=True)
    if not own_mAh > 0.0:
        return _Measured(f"not set on board ({name} is {own_mAh:g})", ok=True)
    volt = None if power is None else nominal_V(power, report.battery_V)
    own = _Measured(f"{own_mAh:.0f} mAh", ok=True)
    if power is None or volt is None:
        return own
    planned_mAh = 1000.0 * power.battery_Wh / volt
    if abs(own_mAh - planned_mAh) <= tolerance * planned_mAh:
        return own
    known = f"{planned_mAh:.0f} mAh ({power.battery_Wh:g} Wh at {volt:g} V)"
    warning = (
        f"{name} is {own_mAh:.0f} mAh, [vehicle.power] has {known}: what the flight needs is told in percent of "
        "its own. Set both to the battery that flies"
    )
    return own._replace(warning=warning)


def capacity_required(plan: Plan, limits: PreflightTable) -> str:
    """Return the capacity of the scenario, as far as it is known without a vehicle."""
    power = plan.scenario.vehicle.power
    if power is None:
        return "any: no [vehicle.power]"
    if power.battery_V is None:
        return f"{power.battery_Wh:g} Wh"
    return f"{1000.0 * power.battery_Wh / power.battery_V:.0f} mAh ± {limits.capacity_tolerance:.0%}"


async def go_or_no_go(
    fleet: LinkedFleet,
    sessions: Mapping[int, VehicleSession],
    plan: Plan,
    limits: PreflightTable,
    watcher: Watcher,
    waived: Collection[CheckName] = (),
    timed: Sequence[VehicleLoad] = (),
) -> tuple[tuple[PreflightCheck, ...], ChargeRule | None]:
    """Return the checks of all vehicles and the rule for their charge in flight; None where the battery is waived.

    `watcher` gets the checks first. Failed ones that are `waived` do not stop the flight. `timed` are loads whose
    missions keep the plan's times.

    Raises `FlightError` for a no-go, and `DuplicateSystemId`.
    """
    requests = (
        (sysid, preflight_report(s, watcher.say, fleet.where(s.station.sysid))) for sysid, s in sessions.items()
    )
    sysids, surveys = zip(*requests, strict=True)
    reports = dict(zip(sysids, await asyncio.gather(*surveys), strict=True))
    fleet.check()
    clocks = {sysid: session.clock for sysid, session in sessions.items()}
    for sysid, off_s in differences_s(clocks, host_s(asyncio.get_running_loop())).items():
        reports[sysid] = replace(reports[sysid], gnss_off_s=off_s)
    timings = await asyncio.gather(*(timing_check(sessions[load.sysid], load) for load in timed))
    checks = waive((*preflight(plan, reports, limits), *timings), waived)
    watcher.checks(checks)
    refuse_no_go(checks)
    if CheckName.BATTERY in waived:
        return checks, None
    power = plan.scenario.vehicle.power
    batteries = {sysid: own_battery(report, power) for sysid, report in reports.items()}
    return checks, ChargeRule(limits.reserve, limits.effort, batteries)


async def preflight_report(session: VehicleSession, say: Callable[[str], None], where: str = "") -> VehicleReport:
    """Return the status report of a vehicle, with the battery capacity that it is set to.

    `prearm_ok` is True where it depends on the mode or mission that the flight replaces. One that cannot be armed
    has REPEATED_S to tell the reason.
    """
    behaviour = link_behaviour(session.autopilot)
    name, cured = behaviour.capacity_parameter, behaviour.cured_text
    report = await status_report(session, where)
    if behaviour.prearm_bit and report.prearm_ok is False and not report.not_ready_texts:
        say(f"vehicle {session.sysid} reports that it cannot be armed; waiting {REPEATED_S:g} s for its reason")
        await until_reason(session)
        report = await status_report(session, where)
    reasons = report.not_ready_texts
    report = replace(
        report,
        prearm_ok=report.prearm_ok if behaviour.prearm_bit and {*reasons} != {cured} else True,
        not_ready_texts=tuple(text for text in reasons if text != cured),
        critical_texts=tuple(text for text in report.critical_texts if text != cured),
    )
    if name is None:
        return report
    try:
        capacity_mAh = (await session.read_parameters([name]))[name].value
    except PeerError:
        return replace(report, capacity_parameter=name)
    return replace(report, capacity_parameter=name, capacity_mAh=float(capacity_mAh))


def waived_events(checks: Iterable[PreflightCheck], sessions: dict[int, VehicleSession]) -> list[Event]:
    """Return an event for each check that failed and was waived, for the flight's folder."""
    now_s = host_s(asyncio.get_running_loop())
    times = {sysid: session.clock.now_unix_s(now_s) for sysid, session in sessions.items()}
    return [
        Event(
            math.nan if (unix_s := times[c.sysid]) is None else unix_s,
            math.nan,
            c.sysid,
            f"failed the pre-flight check {c.name}, waived: {c.measured} (required: {c.required})",
            f"The operator waived it for this flight: --waive {c.name}",
        )
        for c in checks
        if c.waived
    ]


def confirmed_event(by: str, sessions: Mapping[int, VehicleSession]) -> Event:
    """Return the event of the permission to arm, with who gave it."""
    now_s = host_s(asyncio.get_running_loop())
    known = [unix_s for s in sessions.values() if (unix_s := s.clock.now_unix_s(now_s)) is not None]
    return Event(max(known, default=math.nan), math.nan, ALL_VEHICLES, f"may be armed, confirmed by {by or 'nobody'}")


_KINDS = {
    CheckName.DISARMED: _Kind(lambda _, __: "disarmed", _disarmed),
    CheckName.CAN_ARM: _Kind(lambda _, __: "yes", _can_arm),
    CheckName.ESTIMATE: _Kind(lambda _, __: "healthy", _estimate),
    CheckName.SENSORS: _Kind(_sensors_required, _sensors),
    CheckName.PAD: _Kind(lambda _, limits: f"within {limits.pad_m:g} m", _pad),
    CheckName.HEIGHT: _Kind(lambda _, limits: f"within {limits.height_m:g} m", _height),
    CheckName.HOME: _Kind(lambda _, limits: f"within {limits.home_m:g} m", _home),
    CheckName.LOCAL_FRAME: _Kind(lambda _, limits: f"within {limits.origin_m:g} m", _local_frame),
    CheckName.CLOCK: _Kind(_clock_required, _clock),
    CheckName.BATTERY: _Kind(_battery_required, _battery),
    CheckName.CAPACITY: _Kind(capacity_required, _capacity),
    CheckName.WIND: _Kind(_wind_required, _wind),
    CheckName.MESSAGES: _Kind(lambda _, __: "no critical text", _messages),
}
