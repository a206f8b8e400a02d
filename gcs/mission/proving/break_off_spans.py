"""The spans of instants at which a flight cannot be broken off, to a hundredth of a second and to a centimetre."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gcs.mission.proving.track_criteria import TrackCriterion
from gcs.mission.proving.track_report import CELLS_MAX, TrackCheck, UnsafeSpan, settled_checks
from gcs.plan.verification.proof.subdivision import Cells, Family, Looks, Mask, Rows, joined
from gcs.plan.verification.proof.verdict import ProofVerdict
from gcs.types import Array
from gcs.util.long_work import report

SPAN_S = 0.01  # a span begins and ends so near to the instant at which it does
NEAR_M = 0.01  # a margin that is less, and not proved, counts as undecided
_BATCH = 8192


# How much margins (N,) in the middle of cells differ at equal times for other instants of the breaking off, at most.
Moved = Callable[[Cells], Array]


def proved_or_spans(
    names: tuple[str, ...], family: Family, criteria: tuple[TrackCriterion, ...], cells: Cells, moved_m: Moved
) -> tuple[list[TrackCheck], list[UnsafeSpan]]:
    """A check for each criterion, and where one is not proved, the spans of instants in which it is not."""
    checks = settled_checks(names, family, criteria, cells)
    if all(check.ok for check in checks):
        return checks, []
    return checks, unsafe_spans(names, family, criteria, cells, moved_m)


class _Spans:
    """Spans of time, joined where they touch."""

    def __init__(self) -> None:
        self.starts_s, self.ends_s = np.zeros(0), np.zeros(0)

    def add(self, starts_s: Array, ends_s: Array) -> None:
        starts_s, ends_s = np.concatenate([self.starts_s, starts_s]), np.concatenate([self.ends_s, ends_s])
        order = np.argsort(starts_s, kind="stable")
        starts_s, until_s = starts_s[order], np.maximum.accumulate(ends_s[order])
        first = np.concatenate([[True], starts_s[1:] > until_s[:-1]]) if len(order) else np.zeros(0, dtype=bool)
        self.starts_s = starts_s[first]
        self.ends_s = until_s[np.concatenate([first[1:], [True]])] if len(order) else until_s

    def of(self, starts_s: Array, ends_s: Array) -> tuple[Rows, Mask]:
        """The span (N,) that each of these may lie in, and whether all of it does."""
        number = np.searchsorted(self.starts_s, starts_s, side="right") - 1
        if not len(self.starts_s):
            return number, np.zeros(len(number), dtype=bool)
        return number, (number >= 0) & (self.ends_s[number] >= ends_s)


def unsafe_spans(
    names: tuple[str, ...], family: Family, criteria: tuple[TrackCriterion, ...], cells: Cells, moved_m: Moved
) -> list[UnsafeSpan]:
    """The spans in which one of the criteria is not proved, each with the criterion that is missed by most."""
    tolerance = np.array([constraint.tolerance for constraint in family.constraints])[:, None]
    spans, looks, level = _Spans(), Looks(CELLS_MAX), cells
    worst: list[tuple[Array, Array, Array, Rows]] = []  # margins, instants, criteria and vehicles
    while len(level):
        report("looking for the instants at which the flight cannot be broken off")
        last = looks.last(len(level))
        parts = []
        for first in range(0, len(level), _BATCH):
            last = last or looks.last(0)
            batch = level[first : first + _BATCH]
            batch = batch[~spans.of(batch.start_s, batch.end_s)[1]]
            if not len(batch):
                continue
            low, seen = (np.where(np.isnan(each), -np.inf, each) for each in family.bounds(batch))
            is_open = np.any(low < -tolerance, axis=0)
            violated = seen < -tolerance
            everywhere = np.any(seen + moved_m(batch) < -tolerance, axis=0)
            short = batch.end_s - batch.start_s <= SPAN_S
            near = np.any((low < -tolerance) & (seen < NEAR_M), axis=0)
            unsafe = is_open & (everywhere | (short & near) | last)
            children, origin = family.children(batch, is_open & ~unsafe)
            whole = is_open & ~unsafe
            whole[origin] = False
            unsafe |= whole
            parts.append(children)
            spans.add(batch.start_s[unsafe], batch.end_s[unsafe])
            looked = np.flatnonzero(unsafe | violated.any(axis=0))
            missed = seen[:, looked]
            which = np.argmin(missed, axis=0)
            worst.append((missed.min(axis=0), batch.middle_s[looked], which, batch.who[looked]))
        level = joined(parts) if parts else cells[:0]
    if not len(spans.starts_s):
        return []
    margin, t_s, which, who = (np.concatenate(each) for each in zip(*worst, strict=True))
    number, _ = spans.of(t_s, t_s)
    found = []
    for span in range(len(spans.starts_s)):
        inside = np.flatnonzero((number == span) & (t_s <= spans.ends_s[span]))
        at = inside[np.argmin(margin[inside])]
        criterion = criteria[which[at]]
        sign = -1.0 if criterion.most else 1.0
        found.append(
            UnsafeSpan(
                float(spans.starts_s[span]),
                float(spans.ends_s[span]),
                criterion.name,
                ProofVerdict.VIOLATED if margin[at] < -tolerance[which[at], 0] else ProofVerdict.UNDECIDED,
                criterion.limit + sign * float(margin[at]),
                criterion.unit,
                tuple(names[row] for row in who[at]),
                float(t_s[at]),
            )
        )
    return found
