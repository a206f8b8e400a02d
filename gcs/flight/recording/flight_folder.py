"""The folder of a flight: its name, the names of its files, its events and its report."""

import math
from collections.abc import Iterable
from dataclasses import asdict
from datetime import datetime
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from gcs.errors import FileFormatError, PlanningError
from gcs.flight.assessment.criterion import Criterion, FlightOutcome
from gcs.flight.assessment.judge import Verdict
from gcs.flight.monitoring.progress import Event, FlightTimes, NearestPair
from gcs.plan.plan_file import read_plan
from gcs.plan.replanning.plan_pieces import in_pieces
from gcs.plan.trajectory.plan import Plan
from gcs.types import JsonObject
from gcs.util.bounded_file import EVENT_FILE, read_file, read_json


def new_folder(root: Path, mission: str, now: datetime) -> Path:
    """Make and return `<root>/<date>-<mission>`; a second flight in the same second gets a number."""
    stem = f"{now:%Y-%m-%d-%H%M%S}-{mission}"
    folder = root / stem
    number = 2
    while True:
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            if not folder.exists():  # `root` is a link to nowhere
                raise
            folder = root / f"{stem}-{number}"
            number += 1
        else:
            return folder


TELEMETRY, EVENTS, PLAN, SCENARIO = "telemetry.tlog", "events.jsonl", "plan.skein", "scenario.json"
PREDICTED = "predicted.npz"  # the tracks of missions on board, for `gcs attach`
BEFORE = "before.json"  # what was on the vehicles before the upload, for `gcs restore`
_LATER = "plan-*.skein"
_EVENT = TypeAdapter(Event)
OUTCOMES = {
    FlightOutcome.OK: "Flight verified: all criteria within limits.",
    FlightOutcome.FAILED: "Flight FAILED: at least one criterion outside its limit.",
    FlightOutcome.UNKNOWN: "Flight not decided: at least one criterion is not known from what the vehicles reported.",
}
TRUE_STATES, REPORTS = "true states", "reports"  # what a flight was judged from


def later_plans(folder: Path) -> tuple[Path, ...]:
    """Return the files of the plans that replaced the first one in flight, in their order."""
    found = {int(path.stem.rpartition("-")[2]): path for path in folder.glob(_LATER) if _is_numbered(path)}
    return tuple(found[number] for number in sorted(found))


def _is_numbered(path: Path) -> bool:
    return path.stem.rpartition("-")[2].isdecimal()


def read_flown_plan(folder: Path) -> Plan:
    """Return the plan as it was flown, with what orders changed in flight, unverified. Raises FileFormatError."""
    first, _ = read_plan(folder / PLAN)
    later = later_plans(folder)
    try:
        return in_pieces(first, [read_plan(path)[0] for path in later])
    except PlanningError as problem:
        raise FileFormatError(f"{later[-1]}: {problem.message}", hint="put the flight's own files back") from problem


def read_events(path: Path) -> tuple[Event, ...]:
    """Return the events of `events.jsonl`, none without the file; a line that was cut off is left out.

    Raises FileFormatError for a file that is too large.
    """
    found = []
    data = read_file(path, EVENT_FILE) if path.exists() else b""
    for line in data.decode("utf-8", errors="replace").splitlines():
        try:
            values = read_json(line)
            times = {key: math.nan for key in ("unix_s", "t_s") if values[key] is None}
            found.append(_EVENT.validate_python({**values, **times}))
        except (ValueError, TypeError, KeyError):
            continue
    return tuple(found)


def report_data(
    mission: str, plan_hash: str, times: FlightTimes, verdict: Verdict | None, extra: JsonObject
) -> JsonObject:
    """Return the report as plain values, for `report.json` and `--json`."""
    return {
        "ok": verdict is not None and verdict.ok,
        "verdict": (FlightOutcome.UNKNOWN if verdict is None else verdict.outcome).value,
        "mission": mission,
        "plan_hash": plan_hash,
        **extra,
        "times": {name: getattr(times, name) for name in ("airborne_unix_s", "t0_unix_s", "landing_unix_s")},
        **({} if verdict is None else criteria_data(verdict)),
    }


def criteria_data(verdict: Verdict) -> JsonObject:
    """Return the criteria and errors of a verdict as plain values."""
    return {
        # A vehicle that never arrives is infinitely late, which JSON has no number for.
        "criteria": [
            asdict(c)
            | {name: finite(getattr(c, name)) for name in ("value", "lowest", "highest")}
            | {"ok": c.ok, "verdict": c.outcome.value}
            for c in verdict.criteria
        ],
        "position_rms_m": {str(k): finite(v) for k, v in verdict.rms_m.items()},
        "position_max_m": {str(k): finite(v) for k, v in verdict.max_m.items()},
        "formation_error_max_m": finite(verdict.formation_error_m),
        **({"off_plan_s": verdict.off_plan_s} if verdict.off_plan_s else {}),
    }


def nearest_data(nearest: Iterable[NearestPair], times: FlightTimes) -> JsonObject:
    """Return the least separations that vehicles reported, by the part of the flight, as plain values."""
    rows = (
        {
            "part": str(one.part),
            "vehicles": list(one.pair),
            "distance_m": one.distance_m,
            "t_s": float(times.plan_time.t_s(np.array(one.unix_s))),
        }
        for one in nearest
    )
    return {"separation_reported": list(rows)}


def finite(value: float | None) -> float | None:
    """Return a value that JSON knows: None for one that is infinite or NaN."""
    return None if value is None or not math.isfinite(value) else value


def limit_text(criterion: Criterion) -> str:
    """Return a limit in words, and what the plan keeps where that is another: "at least 1.3 m (plan: 5 m)"."""
    plan = f" (plan: {planned})" if (planned := planned_text(criterion)) else ""
    return f"{short_limit(criterion)}{plan}"


def short_limit(criterion: Criterion) -> str:
    """Return a limit in words: "at most 0.15 m"."""
    return f"{'at least' if criterion.at_least else 'at most'} {criterion.limit:g} {criterion.unit}"


def planned_text(criterion: Criterion) -> str:
    """Return what the plan keeps, "5 m"; empty where it is the limit of the flight, or nothing."""
    planned = criterion.planned
    return "" if planned is None or planned == criterion.limit else f"{planned:g} {criterion.unit}"
