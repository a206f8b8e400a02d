"""Faults on demand, for testing what a ground station does about them.

Knows: their names and how they are written. Does not know: how they come about.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from gcs.errors import UsageError


@dataclass(frozen=True)
class Faults:
    """What is wrong with one vehicle."""

    silent: bool = False  # never says anything
    reject_mission: bool = False  # refuses every upload at its first item
    dies_after_s: float = math.inf  # of flight: its motors stop and it falls silent


NO_FAULTS = Faults()
_HINT = "write for example --fault 3:silent, --fault 3:reject-mission or --fault 3:die@30"


def parse_faults(texts: Iterable[str], sysids: Iterable[int]) -> dict[int, Faults]:
    """Faults by system id from texts like `3:silent`. Raises `UsageError` that quotes the wrong one."""
    known = tuple(sysids)
    faults: dict[int, Faults] = {}
    for text in texts:
        number, _, name = text.partition(":")
        if not number.isdecimal() or int(number) not in known:
            ids = ", ".join(map(str, known))
            raise UsageError(f"fault {text!r} names no vehicle of this mission ({ids}).", hint=_HINT)
        faults[int(number)] = _with(faults.get(int(number), NO_FAULTS), name, text)
    return faults


def _with(faults: Faults, name: str, text: str) -> Faults:
    if name == "silent":
        return replace(faults, silent=True)
    if name == "reject-mission":
        return replace(faults, reject_mission=True)
    kind, _, seconds = name.partition("@")
    try:
        after_s = float(seconds)
    except ValueError:
        after_s = math.nan
    if kind != "die" or not 0 <= after_s < math.inf:
        raise UsageError(f"there is no fault {text!r}.", hint=_HINT)
    return replace(faults, dies_after_s=after_s)
