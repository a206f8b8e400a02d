"""Slips in the text of a TOML file: read as they were meant, so that they do not hide the mistakes after them."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from typing import Any

from gcs.scenario.mistakes.mistake import Mistake
from gcs.scenario.mistakes.number_units import UNIT

_SLIPS_MAX = 20  # corrected in one file
_TEXT_MAX, _LINE_MAX = 200_000, 2_000  # characters of what a person wrote
_PLACE = re.compile(r" \(at (?:line (\d+), column \d+|end of document)\)$")
_TWICE = re.compile(r"Cannot declare \((.*?),?\) twice")
_TEXT_OR_REMARK = re.compile(r"""("(?:[^"\\\n]|\\.)*"|'[^'\n]*'|#[^\n]*)""")
_VALUE, _AFTER = r"(?<=[=\[,])(\s*)", r"(?=\s*(?:[,}\]\0]|$))"
_TRUTH, _TRUE = "{} is not a value of TOML", "write %s, in lower case, without quotes"
_BARE = rf"{_VALUE}(?!(?:true|false|inf|nan)\b)([A-Za-z][\w-]*){_AFTER}"
_SLIPS = [  # what is looked for in a line, what was meant, and a sentence where the value does not show that
    (r"^(\s*)([\w.-]+)\s*:\s+(?=\S)", r"\1\2 = ", "a colon stands after {}", "write {} = ..."),
    (rf"(?<![\w.:])()([-+]?[0-9][0-9_]*(?:\.[0-9]+)?\s*(?:{UNIT})|[0-9]+:[0-9]+)(?![\w/²^:-])", r'\1"\2"', "", ""),
    (r"^(\s*[\w.-]+\s*=\s*)([-+]?[0-9]+,[0-9]+)(?=\s*(?:\0|$))", r'\1"\2"', "", ""),
    (rf"{_VALUE}(True|TRUE|[Yy]es){_AFTER}", r"\1true", _TRUTH, _TRUE % "true"),
    (rf"{_VALUE}(False|FALSE|[Nn]o){_AFTER}", r"\1false", _TRUTH, _TRUE % "false"),
    (_BARE, r'\1"\2"', "the text {} stands without quotes", 'write "{}"'),
]
_WORDS = {  # what tomllib says, as this program says it
    "Cannot overwrite a value": "this key stands twice in its table. Keep one of the two",
    "Unclosed array": "a list is not closed. Give the missing ]",
    "Unclosed inline table": "a table in one line is not closed. Give the missing }",
    "Invalid value": "no value of TOML stands here. Give a number, true, false, text in quotes or a list",
    "Unterminated string": "text is not closed. Give the missing quote",
    "Expected '=' after a key in a key/value pair": "a key has no value. Write key = value",
    "Expected newline or end of document after a statement": "something stands after the value. Remove it",
}


def read_toml(text: str, loads: Callable[[str], dict[str, Any]]) -> tuple[dict[str, Any], str, list[Mistake]]:
    """The tables of a text, the text that was read, and the slips in it.

    Raises tomllib.TOMLDecodeError where it is not plain what was meant.
    """
    mistakes: list[Mistake] = []
    for _ in range(_SLIPS_MAX):
        try:
            return loads(text), text, mistakes
        except tomllib.TOMLDecodeError as error:
            lines = text.split("\n")
            number = min(_line_at(text, error), len(lines))
            mended, found = _meant(lines[number - 1], number)
            if mended == lines[number - 1] or len(text) > _TEXT_MAX:
                raise
            mistakes += found
            lines[number - 1] = mended
            text = "\n".join(lines)
    return loads(text), text, mistakes


def syntax_mistake(text: str, error: tomllib.TOMLDecodeError) -> Mistake:
    """The mistake of a text that is not TOML."""
    said = _PLACE.sub("", str(error))
    if found := _TWICE.fullmatch(said):
        name = re.sub(r"\W*, \W*", ".", found[1]).strip("'\" ")
        said = f"table [{name}] stands twice. Keep one, with the keys of both"
    return Mistake((), f"not TOML: {_WORDS.get(said, said)}", line=_line_at(text, error))


def _line_at(text: str, error: tomllib.TOMLDecodeError) -> int:
    place = _PLACE.search(str(error))
    return int(place[1]) if place and place[1] else max(len(text.splitlines()), 1)


def _meant(line: str, number: int) -> tuple[str, list[Mistake]]:
    """A line as it was meant, and what was wrong with it where the value does not show that itself."""
    told: list[Mistake] = []
    if len(line) > _LINE_MAX:
        return line, told
    pieces = _TEXT_OR_REMARK.split(line)
    code = "".join(piece if n % 2 == 0 else f"\0{n}\0" for n, piece in enumerate(pieces))
    for pattern, right, text, step in _SLIPS:
        slips = [found[2] for found in re.finditer(pattern, code)] if text else []
        told += [Mistake((), text.format(one), remedy=step.format(one), line=number) for one in slips]
        code = re.sub(pattern, right, code)
    return re.sub(r"\0(\d+)\0", lambda mark: pieces[int(mark[1])], code), told
