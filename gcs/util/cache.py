"""A cache of results by content: a plan that is loaded again is not verified again."""

import functools
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Concatenate, ParamSpec, Protocol, TypeVar

KEPT = 32  # results of each function; the least recently used goes first


class HasContent(Protocol):
    """An immutable value with a key of its content."""

    @property
    def content(self) -> Hashable:
        """Equal for values of which every result is equal."""
        ...


T = TypeVar("T", bound=HasContent)
P = ParamSpec("P")
R = TypeVar("R")


def once(function: Callable[Concatenate[T, P], R]) -> Callable[Concatenate[T, P], R]:
    """The function with a cache of its results, by the content of its first argument and by the other arguments.

    `__wrapped__` is the function without the cache. Errors are not kept.
    """
    known: OrderedDict[tuple[object, ...], R] = OrderedDict()

    @functools.wraps(function)
    def remembering(subject: T, /, *others: P.args, **named: P.kwargs) -> R:
        key = subject.content, others, tuple(sorted(named.items()))
        if key not in known:
            known[key] = function(subject, *others, **named)
        result = known[key]
        known.move_to_end(key)
        while len(known) > KEPT:
            known.popitem(last=False)
        return result

    return remembering
