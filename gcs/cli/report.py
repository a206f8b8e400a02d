"""`gcs report`: plan, estimate and truth of a flight beside each other."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.console import Screen
from gcs.cli.options import DebugOption, JsonOption


def report(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="A flight's folder.", show_default=False)],
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Compare what was planned, what vehicles told and, where they were emulated, where they truly were.

    Writes record.parquet (every position told, beside the plan) into the folder, from its telemetry. Works for flights
    that were cut short.

    Example: gcs report flights/2026-01-31-120000-simulation1
    """
    screen = Screen(json=json)
    from rich.table import Table

    from gcs.errors import FileFormatError
    from gcs.flight.compare import compare, skew_s
    from gcs.flight.journal import EVENTS, read_events
    from gcs.flight.logbook import read_logbook
    from gcs.flight.record import NAME, write_record
    from gcs.flight.truth import load_truth
    from gcs.plan.store import load_plan

    book = read_logbook(folder)
    if book.t0_unix_s is None:
        raise FileFormatError(f"the flight in {folder} ended before its T0 ({book.step}): there is nothing to compare.")
    plan, _ = load_plan(folder / "plan.skein")
    record = write_record(folder, plan, book.t0_unix_s, book.systems)
    truth = load_truth(folder / "truth.npz") if (folder / "truth.npz").is_file() else None
    found = compare(plan, record, book.t0_unix_s, truth)
    happened = read_events(folder / EVENTS)
    title = f"{book.mission}: m RMS from T0 to the planned arrival"
    table = Table("vehicle", "plan - estimate", "estimate - truth", "plan - truth", "late", title=title)
    for c in found:
        numbers = (c.plan_estimate_m, c.estimate_truth_m, c.plan_truth_m)
        late = "–" if math.isnan(c.late_s) else f"{1e3 * c.late_s:+.0f} ms"
        table.add_row(str(c.sysid), *("–" if math.isnan(n) else f"{n:.3f}" for n in numbers), late)
    screen.show(table)
    screen.say(f"vehicles fly the plan within {1e3 * skew_s(found):.0f} ms of each other; step reached: {book.step}")
    for event in happened:
        screen.say(str(event))
    screen.say(f"{record.num_rows} positions in {folder / NAME}")
    data = [{k: None if isinstance(v, float) and math.isnan(v) else v for k, v in vars(c).items()} for c in found]
    skew = skew_s(found)
    screen.result(
        {
            "folder": folder,
            "vehicles": data,
            "skew_s": None if math.isnan(skew) else skew,
            "events": [vars(event) for event in happened],
            "positions": record.num_rows,
            "step": book.step,
        }
    )
    return 0
