"""Slips in the text of a TOML file: read as they were meant, so that they do not hide the mistakes after them."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from typing import Any

from gcs.scenario.validation.mistakes import Mistake
from gcs.scenario.validation.slips.number_units import ANY_UNIT

_SLIPS_MAX = 20  # corrected in one file
_TEXT_MAX, _LINE_MAX = 200_000, 2_000  # characters of what a person wrote
_PLACE = re.compile(r" \(at (?:line (\d+), column \d+|end of document)\)$")
_KEY = r"""[A-Za-z0-9_.-]+"""
_STRING_OR_REMARK = re.compile(r"""("(?:[^"\\\n]|\\.)*"|'[^'\n]*'|#[^\n]*)""")
_UNIT = re.compile(rf"(?<![\w.])([-+]?[0-9][0-9_]*(?:\.[0-9]+)?)(\s*)({ANY_UNIT})(?![\w/²^])")
_COMMA = re.compile(rf"^(\s*{_KEY}\s*=\s*)([-+]?[0-9]+,[0-9]+)(\s*(?:\0\d+\0)?\s*)$")
_COLON = re.compile(rf"^(\s*{_KEY})\s*:\s+(?=\S)")
_TRUTH = re.compile(r"(?<![\w.])(True|TRUE|False|FALSE|yes|no)(?![\w.])")
_WORD = re.compile(r"(=\s*)([A-Za-z][\w-]*)(?=\s*(?:[,}\]]|$))")
_NAME = re.compile(rf"^\s*({_KEY})\s*=")
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
            number = min(line_at(text, error), len(lines))
            mended, found = _meant(lines[number - 1], number)
            if mended == lines[number - 1] or len(text) > _TEXT_MAX:
                raise
            mistakes += found
            lines[number - 1] = mended
            text = "\n".join(lines)
    return loads(text), text, mistakes


def line_at(text: str, error: tomllib.TOMLDecodeError) -> int:
    """The line (from 1) of a syntax error."""
    place = _PLACE.search(str(error))
    return int(place[1]) if place and place[1] else max(len(text.splitlines()), 1)


def syntax_mistake(text: str, error: tomllib.TOMLDecodeError) -> Mistake:
    """The mistake of a text that is not TOML."""
    said = _PLACE.sub("", str(error))
    if found := re.fullmatch(r"Cannot declare \((.*?),?\) twice", said):
        name = re.sub(r"\W*, \W*", ".", found[1]).strip("'\" ")
        said = f"table [{name}] stands twice. Keep one, with the keys of both"
    return Mistake((), f"not TOML: {_WORDS.get(said, said)}", line=line_at(text, error))


def _meant(line: str, number: int) -> tuple[str, list[Mistake]]:
    """A line as it was meant, and what was wrong with it where the value does not show that itself."""
    if len(line) > _LINE_MAX:
        return line, []
    pieces = _STRING_OR_REMARK.split(line)
    code = "".join(piece if n % 2 == 0 else f"\0{n}\0" for n, piece in enumerate(pieces))
    mistakes = []

    def told(text: str, step: str) -> None:
        mistakes.append(Mistake((), text, remedy=step, line=number))

    if found := _COLON.match(code):
        code = f"{found[1]} = {code[found.end() :]}"
        told(f"a colon stands after {found[1].strip()}", f"write {found[1].strip()} = ...")
    code = _UNIT.sub(r'"\1\2\3"', code)
    code = _COMMA.sub(r'\1"\2"\3', code)
    if found := _TRUTH.search(code):
        right = "true" if found[1].lower() in ("true", "yes") else "false"
        told(f"{found[1]} is not a value of TOML", f"write {right}, in lower case, without quotes")
        code = _TRUTH.sub(right, code)
    for found in _WORD.finditer(code):
        if found[2] not in ("true", "false", "inf", "nan"):
            told(f"the text {found[2]} stands without quotes", f'write "{found[2]}"')
    code = _WORD.sub(
        lambda word: word[0] if word[2] in ("true", "false", "inf", "nan") else f'{word[1]}"{word[2]}"', code
    )
    return re.sub(r"\0(\d+)\0", lambda mark: pieces[int(mark[1])], code), mistakes
