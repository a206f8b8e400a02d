"""Lines of values in JSON texts, against what a person counts."""

from __future__ import annotations

import pytest

from gcs.mission.formats.mission_file import line_of

TEXT = """{
  "a": [10, {"b": "x, ]} \\" [{",
    "c": null}, [],
    [1,
     2]],
  "empty": {},
  "d":
    {"a": 3}
}
"""


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ((), 1),
        (("a",), 2),
        (("a", 0), 2),
        (("a", 1, "b"), 2),
        (("a", 1, "c"), 3),
        (("a", 2), 3),
        (("a", 3, 0), 4),
        (("a", 3, 1), 5),
        (("empty",), 6),
        (("d",), 8),
        (("d", "a"), 8),
        (("d", "missing"), 8),
        (("missing",), 1),
        (("a", 1, "c", "deeper"), 3),
        (("a", 99), 2),
    ],
)
def test_the_line_a_value_begins_on(path: tuple[str | int, ...], line: int) -> None:
    assert line_of(TEXT, path) == line
    assert line_of(TEXT.replace("\n", "\r\n"), path) == line


@pytest.mark.parametrize("text", ["", "]", "}{", ",,", ":", '"', "[[[", "{]}", '{"a" "b" ,'])
def test_what_is_no_json_has_a_line_too(text: str) -> None:
    assert line_of(text, ("a", 0)) == 1
