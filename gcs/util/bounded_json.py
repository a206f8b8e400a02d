"""JSON of others, with bounds on the number of its values and on their nesting."""

from __future__ import annotations

import json
from typing import Any, NoReturn

JSON_VALUES_MAX = 1_000_000


def read_json(data: bytes | str, *, not_finite: bool = False) -> Any:
    """The value of a JSON text. Raises ValueError, also for too many values, deep nesting and numbers without end.

    `not_finite` accepts NaN and Infinity, which are not JSON and which Python writes.
    """
    refuse_crowded_json(data)
    try:
        return json.loads(data, parse_constant=None if not_finite else _not_json)
    except RecursionError:
        raise ValueError("values are nested too deeply") from None


def refuse_crowded_json(data: bytes | str, most: int = JSON_VALUES_MAX) -> None:
    """Raise ValueError for a text of more values than any file has: each takes many times its length in memory."""
    if isinstance(data, str):
        count = sum(data.count(mark) for mark in ",[{")
    else:
        count = sum(data.count(mark) for mark in (b",", b"[", b"{"))
    if count > most:
        raise ValueError(f"about {count:,} values; the limit is {most:,}")


def _not_json(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is not JSON")
