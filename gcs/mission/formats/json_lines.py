"""The line of a JSON value, and the refusal of one with its line."""

from __future__ import annotations

import re
from collections.abc import Sequence

from gcs.errors import FileFormatError

Key = str | int

_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[{}\[\],]|[^\s{}\[\]:,"]+')


def line_of(text: str, path: Sequence[Key]) -> int:
    """The line, from 1, on which the value at `path` begins, or the innermost value around it that exists."""
    wanted = tuple(path)
    here: list[Key | None] = []  # key or index inside each open bracket; None if an object's key comes next
    found, depth = 0, -1
    for token in _TOKEN.finditer(text):
        word = token.group()
        if word in "}]":
            del here[-1:]
        elif word == ",":
            if here:
                last = here[-1]
                here[-1] = last + 1 if isinstance(last, int) else None
        elif here and here[-1] is None:
            here[-1] = word[1:-1]
        else:
            if len(here) > depth and tuple(here) == wanted[: len(here)]:
                found, depth = token.start(), len(here)
                if depth == len(wanted):
                    break
            if word in "{[":
                here.append(0 if word == "[" else None)
    return text.count("\n", 0, found) + 1


def refused(text: str, source: str, path: Sequence[Key], reason: str, *, hint: str = "") -> FileFormatError:
    """The error for one value, with its line. If the text is not JSON, the reason contains the line."""
    syntax = re.fullmatch(r"Invalid JSON: (.*) at line (\d+) column \d+", reason)
    if syntax:
        return FileFormatError(f"{source}, line {syntax[2]}: not JSON: {syntax[1]}.")
    key = ".".join(map(str, path))
    return FileFormatError(f"{source}, line {line_of(text, path)}: {f'{key}: ' if key else ''}{reason}.", hint=hint)
