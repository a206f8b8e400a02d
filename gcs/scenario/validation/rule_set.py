"""A set of rules between tables. Each rule names the tables it needs, so it also checks a partly valid scenario."""

from collections.abc import Callable, Collection, Iterator

from gcs.scenario.schema.mistake import Mistake
from gcs.scenario.schema.scenario import Scenario

Mistakes = Iterator[Mistake]
Rule = Callable[[Scenario], Mistakes]


class Rules:
    """Rules with the tables they need: a mistake in one table does not hide mistakes in others."""

    def __init__(self) -> None:
        self._rules: list[tuple[frozenset[str], Rule]] = []

    def needs(self, *tables: str) -> Callable[[Rule], Rule]:
        """A decorator that registers a rule about these tables."""

        def register(rule: Rule) -> Rule:
            self._rules.append((frozenset(tables), rule))
            return rule

        return register

    def violated(self, scenario: Scenario, tables: Collection[str]) -> list[Mistake]:
        """The mistakes found by the rules that need no more than `tables`."""
        present = set(tables)
        return [mistake for needed, rule in self._rules if needed <= present for mistake in rule(scenario)]
