"""A result is computed once for an object and its other arguments, and forgotten with the object."""

from __future__ import annotations

import pytest

from gcs.once import once


class Thing:
    """Equal to every other one, so only identity tells them apart."""

    def __eq__(self, other: object) -> bool:
        return True

    __hash__ = None  # type: ignore[assignment]


def test_once_for_each_object_and_each_set_of_arguments() -> None:
    calls: list[tuple[int, str]] = []

    @once
    def count(thing: Thing, how: str = "") -> int:
        calls.append((id(thing), how))
        return len(calls)

    first, second = Thing(), Thing()
    assert [count(first), count(first), count(second), count(first, "a"), count(first, how="a"), count(first)] == [
        1,
        1,
        2,
        3,
        4,
        1,
    ]
    assert len(calls) == 4


def test_a_new_object_in_the_place_of_an_old_one_is_new() -> None:
    @once
    def born(thing: Thing) -> object:
        return object()

    results = []
    for _ in range(50):  # most of them have the address of the one before
        thing = Thing()
        results.append(born(thing))
        assert born(thing) is results[-1]
        del thing
    assert len({id(result) for result in results}) == len(results)


def test_an_error_is_not_kept() -> None:
    answers = iter([ValueError("once"), None])

    @once
    def fails(thing: Thing) -> int:
        if (problem := next(answers)) is not None:
            raise problem
        return 7

    thing = Thing()
    with pytest.raises(ValueError, match="once"):
        fails(thing)
    assert fails(thing) == 7
