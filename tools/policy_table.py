"""The contingency policy as three tables of docs/flying.md."""

from __future__ import annotations

from gcs.flight.contingency.detection import DETECTED
from gcs.flight.contingency.policy import ALL, MEANING, Row, State
from gcs.flight.contingency.policy_rows import KEEPS, POLICY
from tools.markdown import table

RULES = ("incident", "in state", "if", "new state", "order", "rule")


def policy_tables() -> str:
    """The states, the incidents and the rules."""
    states = table(("state", "the vehicle"), ((state, MEANING[state]) for state in State))
    incidents = table(("incident", "detected by"), DETECTED.items())
    return "\n".join([states, incidents, table(RULES, (_cells(row) for row in POLICY if row.rule != KEEPS))])


def _cells(row: Row) -> tuple[str, ...]:
    states = "any" if row.states == ALL else ", ".join(state for state in State if state in row.states)
    return str(row.trigger), states, row.when.words, row.to or "", row.action or "", row.rule
