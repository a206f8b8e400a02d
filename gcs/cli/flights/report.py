"""`gcs report`: compare plan, estimate and truth of a flight."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from gcs.cli.planning.plan_tables import flown_table
from gcs.cli.shared.console import Screen
from gcs.cli.shared.shared_options import DebugOption, FlightArgument, JsonOption

if TYPE_CHECKING:
    import pyarrow as pa
    from rich.table import Table

    from gcs.flight.assessment.comparison import LandingError
    from gcs.flight.assessment.flown_coverage import FlownCoverage
    from gcs.flight.assessment.judge import Truth, Verdict
    from gcs.flight.assessment.route_passing import Track
    from gcs.flight.monitoring.progress import PlanTime
    from gcs.plan.trajectory.plan import Plan
    from gcs.types import JsonObject

_NAMED = 5  # parts of a survey that were not seen


def report(folder: FlightArgument, json: JsonOption = False, debug: DebugOption = False) -> int:
    """Compare the planned, the reported and, for emulated vehicles, the true positions of a flight.

    It writes record.parquet into the folder: every reported position beside the planned one. It accepts flights
    that were cut short. For each landing it prints the horizontal distance from the landing point at touchdown, and
    the largest vertical deviation from the descent of the vehicle's own autopilot. The verdict comes
    from the true states, or from what the vehicles reported: "ok", "FAILED", or "not known" where the uncertainty of
    the reports spans the limit.

    Example: gcs report flights/2026-01-31-120000-simulation1
    """
    screen = Screen(json=json)
    from rich.table import Table

    from gcs.errors import FileFormatError
    from gcs.flight.assessment.comparison import compare, landing_errors
    from gcs.flight.assessment.flown_coverage import flown_coverage
    from gcs.flight.assessment.judge import judge, judge_reports, load_truth, reported_tracks
    from gcs.flight.assessment.route_passing import points_passed
    from gcs.flight.monitoring.lateness import skew_s
    from gcs.flight.monitoring.progress import FlightTimes, flown_plan_time
    from gcs.flight.recording.flight_folder import (
        EVENTS,
        REPORTS,
        TRUE_STATES,
        criteria_data,
        read_events,
        read_flown_plan,
    )
    from gcs.flight.recording.flight_state import read_flight_state
    from gcs.flight.recording.record_table import NAME, write_record

    book = read_flight_state(folder)
    if book.t0_unix_s is None:
        raise FileFormatError(
            f"the flight in {folder} ended before its T0 ({book.step}): there is nothing to compare.",
            hint="name a flight that reached T0",
        )
    plan = read_flown_plan(folder)
    happened = read_events(folder / EVENTS)
    plan_time = flown_plan_time(book.t0_unix_s, happened)
    record = write_record(folder, plan, plan_time, book.systems, screen.say)
    truth = load_truth(folder / "truth.npz") if (folder / "truth.npz").is_file() else None
    found = compare(plan, record, truth, plan_time)
    title = f"{book.mission}: m RMS from T0 to the planned arrival"
    table = Table("vehicle", "plan - estimate", "estimate - truth", "plan - truth", "late", title=title)
    for c in found:
        numbers = (c.plan_estimate_m, c.estimate_truth_m, c.plan_truth_m)
        late = "–" if math.isnan(c.late_s) else f"{1e3 * c.late_s:+.0f} ms"
        table.add_row(str(c.sysid), *("–" if math.isnan(n) else f"{n:.3f}" for n in numbers), late)
    screen.show(table)
    skew = skew_s(c.late_s for c in found)
    shape = _formation_error(record, plan.flight_s)
    if not math.isnan(skew):
        screen.say(f"time skew between vehicles: {1e3 * skew:.0f} ms; last step of the flight: {book.step}")
    if shape is not None:
        screen.say(f"formation error: at most {shape[0]:.3f} m at t = {shape[1]:.1f} s (Definition 1, from telemetry)")
    landings, landing_limit_m = landing_errors(plan, record), plan.scenario.judge.arrival_position_m
    flown = _tracks(plan, record, truth, plan_time)
    passed = points_passed(plan, flown)
    if passed:
        screen.show(flown_table(plan, passed, "true states" if truth is not None else "telemetry"))
    surveyed = flown_coverage(plan, flown)
    if surveyed is not None:
        _say_coverage(screen, surveyed)
    screen.show(_landing_table(landings, landing_limit_m))
    tracks = reported_tracks(plan, record, plan_time)
    verdict, judged = None if tracks is None else judge_reports(plan, tracks), REPORTS
    if truth is not None:
        hover_s, landing_s = plan.airborne_s, plan.landing_s
        times = FlightTimes(book.t0_unix_s + hover_s, book.t0_unix_s, book.t0_unix_s + landing_s, plan_time)
        verdict, judged = judge(plan, truth, times), TRUE_STATES
    if verdict is not None:
        screen.show(verdict_table(verdict, judged))
    for event in happened:
        screen.say(str(event))
    for gap in book.incomplete:
        screen.warn(f"the record of this flight is incomplete: {gap}")
    screen.say(f"{record.num_rows} positions in {folder / NAME}")
    data = [
        _known(vars(c)) | {"landing": _known(vars(landing)) | {"ok": landing.within(landing_limit_m)}}
        for c, landing in zip(found, landings, strict=True)
    ]
    screen.result(
        {
            "folder": folder,
            "vehicles": data,
            "skew_s": None if math.isnan(skew) else skew,
            "landing_limit_m": landing_limit_m,
            **({"route_points": [each.data(plan.sysids[plan.leader]) for each in passed]} if passed else {}),
            **({} if surveyed is None else {"coverage": surveyed.data()}),
            "formation_error_max_m": None if shape is None else shape[0],
            "judged": None
            if verdict is None
            else {"from": judged, "verdict": verdict.outcome, **criteria_data(verdict)},
            "events": [vars(event) for event in happened],
            "positions": record.num_rows,
            "step": book.step,
            "incomplete": [vars(gap) for gap in book.incomplete],
        }
    )
    return 0


def _known(values: JsonObject) -> JsonObject:
    return {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in values.items()}


def _tracks(plan: Plan, record: pa.Table, truth: Truth | None, plan_time: PlanTime) -> dict[int, Track]:
    """The true track of every vehicle, or the reported one where no true states are known."""
    import numpy as np

    from gcs.physics.states import POSITION

    if truth is not None:
        at_s = plan_time.t_s(truth.unix_s)
        rows = zip(truth.sysids, truth.states, strict=True)
        return {sysid: (at_s, states[:, POSITION]) for sysid, states in rows if sysid in plan.sysids}
    columns = {name: record.column(name).to_numpy() for name in ("sysid", "t_s", "north_m", "east_m", "down_m")}
    places = np.stack([columns[name] for name in ("north_m", "east_m", "down_m")], axis=1)
    mine = ((sysid, columns["sysid"] == sysid) for sysid in plan.sysids)
    return {sysid: (columns["t_s"][rows], places[rows]) for sysid, rows in mine}


def _say_coverage(screen: Screen, found: FlownCoverage) -> None:
    percent = int(1e3 * found.share) / 10.0  # cut, not rounded
    screen.say(f"survey: {percent:g} % of {found.area_m2 / 1e4:.2f} ha was seen from the tracks flown")
    for north_m, east_m, area_m2 in found.missed[:_NAMED]:
        screen.warn(f"  not seen: {area_m2:.3g} m² at north {north_m:.1f} m, east {east_m:.1f} m")


def verdict_table(verdict: Verdict, judged: str) -> Table:
    """The criteria of a flight, judged from true states or reports."""
    from rich.table import Table

    from gcs.flight.recording.flight_folder import short_limit

    title, caption = f"judged from the {judged}", verdict.not_counted or None
    table = Table("criterion", "measured", "limit", "verdict", title=title, caption=caption)
    for c in verdict.criteria:
        vehicle = f" ({c.vehicles})" if c.vehicles else ""
        table.add_row(c.name, f"{c.value:.3f} {c.unit}{vehicle}", short_limit(c), c.verdict)
    return table


def _landing_table(landings: tuple[LandingError, ...], limit_m: float) -> Table:
    from rich.table import Table

    from gcs.cli.shared.plan_argument import verdict_word

    title = f"landing: m from the landing point and from the expected descent, limit {limit_m:g} m horizontally"
    table = Table("vehicle", "horizontal", "vertical, at most", "touchdown", "verdict", title=title)
    for landing in landings:
        ok = landing.within(limit_m)
        metres = ("–" if math.isnan(n) else f"{n:.2f}" for n in (landing.horizontal_m, landing.vertical_max_m))
        when = "–" if math.isnan(landing.touchdown_s) else f"t = {landing.touchdown_s:.1f} s"
        table.add_row(str(landing.sysid), *metres, when, "not seen" if ok is None else verdict_word(ok))
    return table


def _formation_error(record: pa.Table, flight_s: float) -> tuple[float, float] | None:
    import numpy as np

    errors, t_s = (record.column(name).to_numpy() for name in ("formation_error_m", "t_s"))
    errors = np.where((t_s >= 0.0) & (t_s <= flight_s), errors, np.nan)
    if np.isnan(errors).all():
        return None
    worst = int(np.nanargmax(errors))
    return float(errors[worst]), float(t_s[worst])
