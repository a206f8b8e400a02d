"""Every key is found on the line it stands on."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from gcs.scenario.schema.toml_lines import Key, key_lines, line_of

TEXT = '''\
a = 1
"q x".b = [  # a [comment
  "]",
  2,
]
text = """
[not.a.table]
x = 3
"""
[t]  # table
k = { in = [1] }
[[t.list]]
y = 1
[[t.list]]
y = 2
[t.list.sub]
z = 'it # is'
'''


def test_tables_lists_strings_and_comments() -> None:
    assert key_lines(TEXT) == {
        ("a",): 1,
        ("q x", "b"): 2,
        ("text",): 6,
        ("t",): 10,
        ("t", "k"): 11,
        ("t", "list"): 12,
        ("t", "list", 0): 12,
        ("t", "list", 0, "y"): 13,
        ("t", "list", 1): 14,
        ("t", "list", 1, "y"): 15,
        ("t", "list", 1, "sub"): 16,
        ("t", "list", 1, "sub", "z"): 17,
    }


def test_windows_line_ends_count_the_same() -> None:
    assert key_lines(TEXT.replace("\n", "\r\n")) == key_lines(TEXT)


def test_what_has_no_line_takes_the_nearest_around_it() -> None:
    lines = key_lines(TEXT)
    assert line_of(lines, ("t", "k", "in", 0)) == 11
    assert line_of(lines, ("t", "list", 1, "missing")) == 14
    assert line_of(lines, ("nowhere",)) is None


def test_every_key_tomllib_reads_has_a_line_that_names_it(repo_root: Path) -> None:
    text = (repo_root / "missions" / "simulation1" / "scenario.toml").read_text(encoding="utf-8")
    lines, rows = key_lines(text), text.splitlines()
    for key in _keys(tomllib.loads(text)):
        name = next(part for part in reversed(key) if isinstance(part, str))
        assert name in rows[lines[key] - 1], key


def _keys(node: Any, key: Key = ()) -> list[Key]:
    found: list[Key] = []
    if isinstance(node, dict):
        for name, inner in node.items():
            if not (isinstance(inner, dict) and name == "terrain"):  # [terrain] itself is never written
                found.append((*key, name))
            found += _keys(inner, (*key, name))
    elif isinstance(node, list) and node and isinstance(node[0], dict):
        for index, inner in enumerate(node):
            found += _keys(inner, (*key, index))
    return found
