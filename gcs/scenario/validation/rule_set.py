"""What a rule about several tables is: a check, and the tables it cannot do without.

Knows: which rules can be asked of a scenario that is right only in part. Does not know: any rule.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator

from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.validation.mistakes import Mistake

Mistakes = Iterator[Mistake]
Rule = Callable[[Scenario], Mistakes]


class Rules:
    """Rules of one kind. Each names the tables it needs, so that a mistake in one does not hide those in others."""

    def __init__(self) -> None:
        self._rules: list[tuple[frozenset[str], Rule]] = []

    def needs(self, *tables: str) -> Callable[[Rule], Rule]:
        """A rule that compares these tables."""

        def register(rule: Rule) -> Rule:
            self._rules.append((frozenset(tables), rule))
            return rule

        return register

    def broken(self, scenario: Scenario, tables: Collection[str]) -> list[Mistake]:
        """What the rules that need no more than `tables` find."""
        present = set(tables)
        return [mistake for needed, rule in self._rules if needed <= present for mistake in rule(scenario)]
