"""The command: what is measured, and where the page goes.

Knows: options. Does not know: sections.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from tools.bench_flights import MODES
from tools.paper.book import JSON, SECTIONS, make, write
from tools.paper.peers import ALL, refresh
from tools.paper.run import DOCS, Run

app = typer.Typer(add_completion=False)


@app.command()
def paper(
    to: Annotated[Path, typer.Option(help="Folder of the page, its record and its figures.")] = DOCS,
    section: Annotated[
        list[str] | None, typer.Option(help=f"Only these of {', '.join(SECTIONS)}; the others stay as they are.")
    ] = None,
    short: Annotated[bool, typer.Option("--short", help="Little of everything, in seconds: for tests.")] = False,
    benchmarks: Annotated[
        list[str] | None, typer.Option(help=f"Run these of {', '.join(ALL)} (or: all) anew for the page.")
    ] = None,
    seeds: Annotated[int, typer.Option(help="Of the benchmark of flights.")] = 20,
    mode: Annotated[list[str] | None, typer.Option(help="Of the benchmark of flights; all when left out.")] = None,
    render: Annotated[
        bool, typer.Option("--render", help="Measure nothing, print the page of the record again.")
    ] = False,
) -> None:
    """Measure, draw, and write paper.md, paper.json and paper/."""
    if unknown := [name for name in section or () if name not in SECTIONS]:
        raise typer.BadParameter(f"no section {', '.join(unknown)}; there are {', '.join(SECTIONS)}")
    if short and to == DOCS:
        raise typer.BadParameter("--short is for trials: name another folder with --to")
    if render:
        write(to, json.loads((to / JSON).read_text(encoding="utf-8")))
        return
    if benchmarks:
        flights = ("--seeds", str(seeds), "--mode", *(mode or MODES))
        refresh(list(ALL) if "all" in benchmarks else benchmarks, flights)
        section = [*(section or ()), "flights", "peers"]
    make(Run(to, short=short), section or list(SECTIONS))
