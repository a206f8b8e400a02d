"""A result is computed once for equal content and equal arguments; errors are not kept."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from gcs.util.cache import KEPT, once


@dataclass(frozen=True)
class Thing:
    content: str = ""


def test_once_for_each_content_and_each_set_of_arguments() -> None:
    calls: list[str] = []

    @once
    def count(thing: Thing, how: str = "") -> int:
        calls.append(thing.content + how)
        return len(calls)

    asked = [
        count(Thing("a")),
        count(Thing("a")),
        count(Thing("b")),
        count(Thing("a"), "x"),
        count(Thing("a"), how="x"),
    ]
    assert asked == [1, 1, 2, 3, 4]
    assert calls == ["a", "b", "ax", "ax"]


def test_an_error_is_not_kept() -> None:
    answers = iter([ValueError("once"), None])

    @once
    def fails(thing: Thing) -> int:
        if (problem := next(answers)) is not None:
            raise problem
        return 7

    with pytest.raises(ValueError, match="once"):
        fails(Thing())
    assert fails(Thing()) == 7


def test_the_least_recently_used_is_forgotten() -> None:
    calls: list[str] = []

    @once
    def say(thing: Thing) -> None:
        calls.append(thing.content)

    say(Thing("old"))
    for number in range(KEPT):
        say(Thing(str(number)))
        say(Thing("0"))
    say(Thing("0"))
    say(Thing("old"))
    assert calls.count("0") == 1
    assert calls.count("old") == 2
