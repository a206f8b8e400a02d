"""The line of each key in a TOML text, for messages that name it; `tomllib` does not give lines.

It handles tables, arrays of tables, dotted and quoted keys, and values over several lines. The text must be valid TOML.
"""

import re
from typing import Any

Key = tuple[str | int, ...]
Table = dict[str, Any]  # of a file, or of a JSON Schema, before it is checked

_NAME = r"""(?:[A-Za-z0-9_-]+|"(?:[^"\\]|\\.)*"|'[^']*')"""
_DOTTED = rf"{_NAME}(?:\s*\.\s*{_NAME})*"
_ARRAY_OF_TABLES = re.compile(rf"\s*\[\[\s*({_DOTTED})\s*\]\]")
_TABLE = re.compile(rf"\s*\[\s*({_DOTTED})\s*\]")
_ASSIGNMENT = re.compile(rf"\s*({_DOTTED})\s*=")
# Strings and comments, which may contain brackets and line ends; then the brackets themselves.
_TOKEN = re.compile(
    r'"""(?:[^\\]|\\.)*?"""|\'\'\'.*?\'\'\'|"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'|#[^\n]*|[\[\]{}\n]', re.DOTALL
)


def key_lines(text: str) -> dict[Key, int]:
    """The line (from 1) of every table and key; items of an array of tables carry their index in the key."""
    lines: dict[Key, int] = {}
    counts: dict[Key, int] = {}
    table: Key = ()
    for number, statement in _statements(text):
        if found := _ARRAY_OF_TABLES.match(statement):
            base = _within_arrays(_names(found[1]), counts)
            lines.setdefault(base, number)
            counts[base] = counts.get(base, -1) + 1
            table = (*base, counts[base])
            lines[table] = number
        elif found := _TABLE.match(statement):
            table = _within_arrays(_names(found[1]), counts)
            lines[table] = number
        elif found := _ASSIGNMENT.match(statement):
            lines[table + _names(found[1])] = number
    return lines


def line_of(lines: dict[Key, int], key: Key) -> int | None:
    """The line of the key, else of the innermost table or list that contains it."""
    return next((lines[key[:n]] for n in range(len(key), 0, -1) if key[:n] in lines), None)


def _statements(text: str) -> list[tuple[int, str]]:
    """The pieces of the text that end outside every bracket and string, with their first lines."""
    text = text.replace("\r\n", "\n")
    found, begin, depth = [], 0, 0
    for token in _TOKEN.finditer(text):
        mark = token[0]
        if mark in "[{":
            depth += 1
        elif mark in "]}":
            depth -= 1
        elif mark == "\n" and depth == 0:
            found.append((begin, text[begin : token.start()]))
            begin = token.end()
    found.append((begin, text[begin:]))
    return [(text.count("\n", 0, start) + 1, statement) for start, statement in found]


def _names(dotted: str) -> Key:
    return tuple(name.strip("\"'") for name in re.findall(_NAME, dotted))


def _within_arrays(names: Key, counts: dict[Key, int]) -> Key:
    """The table's key, with the index of the latest item of every array of tables in it."""
    key: Key = ()
    for name in names[:-1]:
        key = (*key, name)
        if key in counts:
            key = (*key, counts[key])
    return (*key, names[-1])
