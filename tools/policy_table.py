"""Prints the contingency policy into docs/flying.md:  ./tools/run python tools/policy_table.py"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from gcs.files import atomic_write
from gcs.flight.contingency.detection import DETECTED
from gcs.flight.contingency.policy import ALL, MEANING, Row, State
from gcs.flight.contingency.policy_rows import KEEPS, POLICY

PAGE = Path(__file__).resolve().parent.parent / "docs" / "flying.md"
BEGIN = "<!-- made by tools/policy_table.py from gcs/flight/contingency/policy_rows.py; change that -->\n"
END = "<!-- end -->\n"


def policy_tables() -> str:
    """The states, the incidents and the rules, as three tables."""
    return "\n".join(
        [
            _table(("state", "the vehicle"), ((state, MEANING[state]) for state in State)),
            _table(("incident", "detected by"), DETECTED.items()),
            _table(
                ("incident", "in state", "if", "new state", "order", "rule"),
                (_cells(row) for row in POLICY if row.rule != KEEPS),
            ),
        ]
    )


def with_policy_tables(page: str) -> str:
    """The page with its tables made anew, between the two marks."""
    between = re.compile(f"(?<={re.escape(BEGIN)}).*?(?={re.escape(END)})", re.S)
    return between.sub(lambda _: f"\n{policy_tables()}\n", page)


def _cells(row: Row) -> tuple[str, ...]:
    states = "any" if row.states == ALL else ", ".join(state for state in State if state in row.states)
    return str(row.trigger), states, row.when.words, row.to or "", row.action or "", row.rule


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


if __name__ == "__main__":
    atomic_write(PAGE, with_policy_tables(PAGE.read_text(encoding="utf-8")))
    print(PAGE)
