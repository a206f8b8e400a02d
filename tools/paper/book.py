"""The page: its sections in order, measured one after another, and printed from the record alone.

Knows: sections, files. Does not know: what is in a section.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from types import ModuleType
from typing import Any

from gcs.files import atomic_write
from tools.paper import flights, peers, readings, rivals, scale, simulations, weighting
from tools.paper.readme import updated
from tools.paper.run import DOCS, ROOT, Run, about, about_line

SECTIONS: dict[str, ModuleType] = {
    "weighting": weighting,
    "simulations": simulations,
    "readings": readings,
    "swarms": rivals,
    "scale": scale,
    "flights": flights,
    "peers": peers,
}
JSON, PAGE, README = "paper.json", "paper.md", ROOT / "README.md"


def make(run: Run, wanted: list[str]) -> dict[str, Any]:
    """Measure the sections asked for, keep the others of the last run, write record and page."""
    file, fresh = run.folder / JSON, {}
    for name in wanted:
        began = time.perf_counter()
        machine = about()
        run.log(f"section {name}")
        measured = SECTIONS[name].measure(run)
        fresh[name] = {"about": machine, "took_s": time.perf_counter() - began, **measured}
    record: dict[str, Any] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    record |= fresh
    record = {name: record[name] for name in SECTIONS if name in record}
    run.folder.mkdir(parents=True, exist_ok=True)
    atomic_write(file, json.dumps(record, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    write(run.folder, record)
    return record


def write(folder: Path, record: dict[str, Any]) -> None:
    """The page, and in the documents the numbers of the README; a record that lacks sections leaves that alone."""
    atomic_write(folder / PAGE, page(record))
    if folder == DOCS and len(record) == len(SECTIONS):
        atomic_write(README, updated(README.read_text(encoding="utf-8"), record))


def page(record: dict[str, Any]) -> str:
    """Markdown of a record."""
    lines = [
        "# The paper, reproduced",
        "",
        "This page is written by `./tools/run python tools/paper.py` from the scenarios in `missions/`; no "
        "number is typed by hand. All numbers stand in [paper.json](paper.json). Each sentence of the paper stands "
        "with what was measured on our flights. Where its words leave a choice, *read as* names the sense in which it "
        "is judged. Values the paper leaves out are marked in the scenarios; the last column of the tables names "
        "those that decide a sentence.",
        "",
    ]
    for name, section in record.items():
        lines += [f"## {SECTIONS[name].TITLE}", "", *SECTIONS[name].page(section), ""]
        lines += [f"<sub>Measured {about_line(section['about'])}; took {section['took_s']:.0f} s.</sub>", ""]
    return "\n".join(lines)
