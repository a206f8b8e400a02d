"""Emulated vehicles fly the plans in wind that no plan knows: truth against plan, over seeds.

Knows: how the record of `tools/bench_flights.py` becomes a table. Does not know: flights. They take hours, so they are
flown apart (`--benchmarks flights --seeds N`) and kept with version, machine and date.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

from tools.bench_flights import FIGURES, summary
from tools.paper.peers import load
from tools.paper.run import Run, about_line

TITLE = "Flights: truth against plan, in wind"


def measure(run: Run) -> dict[str, Any]:
    """The figures of the record, by mission and mode."""
    kept = load("flights")
    if kept is None:
        run.log("no flights are recorded: fly some with --benchmarks flights")
        return {"rows": [], "flown": None}
    flights = kept["record"]["flights"]
    rows = summary(flights)
    for row in rows:
        group = [f for f in flights if (f["mission"], f["mode"]) == (row["mission"], row["mode"])]
        for key, _ in FIGURES.values():  # a vehicle that never arrives is infinitely late, for which JSON has no number
            row[key] = [value if math.isfinite(value) else None for value in row.get(key, ())]
        row["wind"] = f"{group[0]['wind']}, gusts {group[0]['gusts']}" if group else ""
    return {"rows": rows, "flown": kept["about"], "took_s": kept["took_s"]}


def page(record: dict[str, Any]) -> list[str]:
    """One table, and why flights ended early."""
    if not record["rows"]:
        return ["No flights are recorded yet: `tools/paper.py --benchmarks flights --seeds 20`."]
    names = [f"{name}: mean / {'95' if large else '5'} % / worst" for name, (_, large) in FIGURES.items()]
    head = ["mission", "mode", "wind", "held", *names]
    lines = [
        "Flown by `tools/paper.py --benchmarks flights` in wind and gusts that no plan knows "
        "([record](bench/flights.json)). Each flight gives its worst vehicle's figure, from true states; the table has "
        "the mean, the tail and the worst over flights. `held` counts flights that the scenario's judge accepts. A "
        "vehicle arrives when it comes into the judge's circle to stay: one that a gust pushes out arrives again.",
        "",
        f"| {' | '.join(head)} |",
        "|" + " --- |" * len(head),
    ]
    for row in record["rows"]:
        figures = [" / ".join(map(_text, row[key])) or "none" for key, _ in FIGURES.values()]
        cells = [row["mission"], row["mode"], row["wind"], f"{row['held']} of {row['flights']}", *figures]
        lines.append(f"| {' | '.join(cells)} |")
    early = [
        f"- {row['mission']}, {row['mode']}, {times} of {row['flights']}: {words}"
        for row in record["rows"]
        for words, times in Counter(row["ended"]).items()
    ]
    if early:
        lines += ["", "Flights that ended early:", "", *early]
    return [*lines, "", f"<sub>Flown {about_line(record['flown'])}.</sub>"]


def _text(value: float | None) -> str:
    return "never" if value is None else f"{value:.2f}"
