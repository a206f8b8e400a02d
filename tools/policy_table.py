"""The contingency policy as tables in docs/flying.md; `tools/reference.py` writes them."""

from __future__ import annotations

import re
from pathlib import Path

from gcs.flight.contingency.detection import DETECTED
from gcs.flight.contingency.policy import ALL, MEANING, Row, State
from gcs.flight.contingency.policy_rows import KEEPS, POLICY
from tools.markdown import table

PAGE = Path(__file__).resolve().parent.parent / "docs" / "flying.md"
BEGIN = "<!-- made by tools/policy_table.py from gcs/flight/contingency/policy_rows.py; change that -->\n"
END = "<!-- end -->\n"
RULES = ("incident", "in state", "if", "new state", "order", "rule")


def policy_tables() -> str:
    """The states, the incidents and the rules, as three tables."""
    states = table(("state", "the vehicle"), ((state, MEANING[state]) for state in State))
    incidents = table(("incident", "detected by"), DETECTED.items())
    return "\n".join([states, incidents, table(RULES, (_cells(row) for row in POLICY if row.rule != KEEPS))])


def with_policy_tables() -> str:
    """The page with its tables made anew, between the two marks."""
    between = re.compile(f"(?<={re.escape(BEGIN)}).*?(?={re.escape(END)})", re.S)
    return between.sub(lambda _: f"\n{policy_tables()}\n", PAGE.read_text(encoding="utf-8"))


def _cells(row: Row) -> tuple[str, ...]:
    states = "any" if row.states == ALL else ", ".join(state for state in State if state in row.states)
    return str(row.trigger), states, row.when.words, row.to or "", row.action or "", row.rule
