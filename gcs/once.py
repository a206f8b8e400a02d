"""Results that are computed once for an object that never changes, and forgotten with it."""

from __future__ import annotations

import functools
import weakref
from collections.abc import Callable
from typing import Any, Concatenate, ParamSpec, TypeVar

T = TypeVar("T")
P = ParamSpec("P")
R = TypeVar("R")


def once(function: Callable[Concatenate[T, P], R]) -> Callable[Concatenate[T, P], R]:
    """The function, which remembers its result for each first argument (by identity) and each set of the others.

    The first argument must be immutable. `__wrapped__` is the function that remembers nothing. Errors are not kept.
    """
    known: dict[tuple[Any, ...], tuple[weakref.ref[T], R]] = {}

    @functools.wraps(function)
    def remembering(subject: T, /, *others: P.args, **named: P.kwargs) -> R:
        key = id(subject), others, tuple(sorted(named.items()))
        found = known.get(key)
        if found is None or found[0]() is not subject:
            found = weakref.ref(subject, lambda _: known.pop(key, None)), function(subject, *others, **named)
            known[key] = found
        return found[1]

    return remembering
