"""A course: what a vehicle flies, piece after piece, and what happens on the way.

Knows: polynomials in time and marks beside them. Does not know: where they come from, who flies them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from sim_bridge.guidance.piece import Piece


@dataclass(frozen=True)
class Mark:
    """At `t_s` mission item `reached` was completed, and `current` begins; either may be absent."""

    t_s: float
    reached: int | None = None
    current: int | None = None


@dataclass(frozen=True)
class Course:
    """Pieces one after the other, then what `rest` has; after the last the vehicle stands where it ended.

    The rest is worked out as it is flown, course by course; each says anew what is climbing and what is landing.
    """

    pieces: tuple[Piece, ...]
    marks: tuple[Mark, ...] = ()
    climbing_until_s: float = -math.inf  # a take-off from the ground
    landing_from_s: float = math.inf
    rest: Iterator[Course] | None = None
