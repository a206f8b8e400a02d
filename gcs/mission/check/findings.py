"""Findings of a check: each names a rule, what violates it, and where."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum


class Level(StrEnum):
    """Severity. A mission with an error must not fly; a warning needs your decision; a note states an assumption."""

    ERROR = "error"
    WARNING = "warning"
    NOTE = "note"


class Rule(StrEnum):
    """The rule that a finding violates; the value is its name in `--json`."""

    SEPARATION = "separation"
    TERRAIN = "terrain"
    HEIGHT = "height"
    AREA = "area"
    FENCE = "fence"
    RALLY = "rally"
    RETURN = "return"
    SPEED = "speed"
    ITEMS = "items"
    COMMAND = "command"
    FRAME = "frame"
    JUMP = "jump"
    VALUE = "value"
    PLACE = "place"
    ORDER = "order"
    CHANGED = "changed"
    ASSUMED = "assumed"
    FORMAT = "format"


@dataclass(frozen=True)
class Finding:
    """One finding. `item` is the number ground stations show, `t_s` the time since the common start."""

    rule: Rule
    level: Level
    message: str
    source: str
    line: int | None = None
    item: int | None = None
    t_s: float | None = None

    def __str__(self) -> str:
        place = self.source
        if self.line is not None:
            place += f":{self.line}"
        item = "" if self.item is None else f" item {self.item}:"
        when = "" if self.t_s is None else f" (at {self.t_s:.1f} s)"
        return f"{place}: {self.level} [{self.rule}]{item} {self.message}{when}"

    def data(self) -> dict[str, object]:
        """The finding for `--json`, without keys that do not apply."""
        fields = {("file" if key == "source" else key): value for key, value in vars(self).items()}
        return {key: value for key, value in fields.items() if value is not None}


def worst(findings: Iterable[Finding]) -> Level | None:
    """The most severe level; None without findings."""
    found = {f.level for f in findings}
    return next((level for level in Level if level in found), None)
