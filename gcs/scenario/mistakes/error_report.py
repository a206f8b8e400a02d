"""All mistakes of a file as one error: a line for each, in the order of the file, and one next step."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gcs.errors import ScenarioError
from gcs.scenario.mistakes.mistake import Mistake, dotted, value_at
from gcs.scenario.mistakes.slips import Meant
from gcs.scenario.validation.toml_lines import Key, key_lines, line_of


def error_report(
    file: Path, mistakes: Sequence[Mistake], meant: Meant | None = None, elsewhere: ScenarioError | None = None
) -> ScenarioError:
    """The error that tells every mistake of a file, after those of another file (its vehicle's)."""
    lines = {} if meant is None or file.suffix == ".json" else key_lines(meant.text)

    def line(one: Mistake) -> int:
        return one.line or line_of(lines, meant.in_file(one.key) if meant else one.key) or 0

    def sentence(one: Mistake, text: str) -> str:
        place = f"{file}:{line(one)}" if line(one) else str(file)
        is_absent = one.value is not None and meant is not None and value_at(meant.data, one.key) is None
        return f"{place}: {one.place}{' (not in this file)' * is_absent}: {text}" if one.key else f"{place}: {text}"

    alike: dict[tuple[int, Key, str], dict[str, Mistake]] = {}  # rows of one list with the same mistake
    for one in sorted(mistakes, key=lambda one: (line(one), str(one))):
        table = one.key[:-1] if one.key and isinstance(one.key[-1], int) else one.key
        alike.setdefault((line(one), table, one.whole), {})[str(one)] = one
    placed, listed = [], []
    for one, *others in (rows.values() for rows in alike.values()):
        placed.append(one)
        text = one.told[0] if len(alike) == 1 and elsewhere is None else one.whole
        listed.append(sentence(one, text) + (f" (and {len(others)} more in this list)" if others else ""))
    if len(listed) > 1:
        listed.insert(0, f"{file} has {len(placed)} mistakes")
    if elsewhere is not None:
        return ScenarioError("\n".join((elsewhere.message, *listed)), hint=elsewhere.hint)
    steps = [
        one.told[1] or (f"change {dotted(one.key)}" if one.key else "correct the line; the file is TOML 1.0")
        for one in placed
    ]
    number = "both" if len(placed) == 2 else f"all {len(placed)}"
    hint = steps[0] if len({*steps}) == 1 else f"correct {number}; the first: {steps[0]}"
    return ScenarioError("\n".join(listed), hint=hint)
