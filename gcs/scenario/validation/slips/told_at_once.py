"""All mistakes of a file as one error: a line for each, in the order of the file, and one next step."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gcs.errors import ScenarioError
from gcs.scenario.validation.mistakes import EVERY_KEY, Mistake
from gcs.scenario.validation.slips.key_slips import Meant
from gcs.scenario.validation.slips.shown_values import dotted
from gcs.scenario.validation.toml_lines import Key, key_lines, line_of


def all_at_once(
    file: Path,
    mistakes: Sequence[Mistake],
    meant: Meant | None = None,
    elsewhere: ScenarioError | None = None,
) -> ScenarioError:
    """The error that tells every mistake of a file, after those of another file (its vehicle's)."""
    places = _Places(file, meant)
    once = {(places.line(mistake), str(mistake)): mistake for mistake in mistakes}
    placed = [once[key] for key in sorted(once)]
    if len(placed) == 1 and elsewhere is None:
        return ScenarioError(places.sentence(placed[0], placed[0].problem), hint=_step(placed[0]))
    listed = [places.sentence(mistake, mistake.whole) for mistake in placed]
    if len(listed) > 1:
        listed.insert(0, f"{file} has {len(placed)} mistakes")
    if elsewhere is not None:
        return ScenarioError("\n".join((elsewhere.message, *listed)), hint=elsewhere.hint)
    first = _step(placed[0])
    number = "both" if len(placed) == 2 else f"all {len(placed)}"
    alike = all(_step(mistake) == first for mistake in placed)
    return ScenarioError("\n".join(listed), hint=first if alike else f"correct {number}; the first: {first}")


class _Places:
    """Where mistakes stand in a file."""

    def __init__(self, file: Path, meant: Meant | None) -> None:
        self._file, self._meant = file, meant
        self._lines = {} if meant is None or file.suffix == ".json" else key_lines(meant.text)

    def line(self, mistake: Mistake) -> int:
        """The line (from 1); 0 where the file has none."""
        return mistake.line or line_of(self._lines, self._in_file(mistake.key)) or 0

    def sentence(self, mistake: Mistake, text: str) -> str:
        """The file, the line, the key with its value, and a text about it."""
        number = self.line(mistake)
        place = f"{self._file}:{number}" if number else str(self._file)
        if not mistake.key:
            return f"{place}: {text}"
        absent = mistake.value is not None and self._meant is not None and _lacks(self._meant.data, mistake.key)
        return f"{place}: {mistake.place}{' (not in this file)' if absent else ''}: {text}"

    def _in_file(self, key: Key) -> Key:
        return key if self._meant is None else self._meant.in_file(key)


def _step(mistake: Mistake) -> str:
    if not mistake.key:
        return mistake.next_step or "correct the line; the file is TOML 1.0"
    change = f"change {dotted(mistake.key)}" + (f"; {EVERY_KEY}" if mistake.is_unknown else "")
    return mistake.next_step or change


def _lacks(data: dict[str, Any], key: Key) -> bool:
    node: Any = data
    for part in key:
        try:
            node = node[part]
        except (KeyError, IndexError, TypeError):
            return True
    return False
