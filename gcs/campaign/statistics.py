"""Pass rates, quantiles and rank correlations, each with an interval that assumes no distribution of the figures.

Intervals are for a fixed number of flights: where a campaign ends as soon as one is narrow, it covers a little less.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy import stats

from gcs.types import Array

CONFIDENCE = 0.95


class Interval(NamedTuple):
    """An estimate and the ends of its confidence interval, in the unit of the figure; an end may be infinite."""

    value: float
    low: float
    high: float


def pass_rate(passed: int, flights: int, confidence: float = CONFIDENCE) -> Interval:
    """Return the share of flights that passed, with its two-sided Clopper-Pearson interval; 0 to 1 without flights."""
    if not 0 <= passed <= flights:
        raise ValueError(f"{passed} of {flights} flights")
    if flights == 0:
        return Interval(math.nan, 0.0, 1.0)
    tail, failed = (1.0 - confidence) / 2.0, flights - passed
    low = float(stats.beta.ppf(tail, passed, failed + 1)) if passed else 0.0
    high = float(stats.beta.ppf(1.0 - tail, passed + 1, failed)) if failed else 1.0
    return Interval(passed / flights, low, high)


def quantile(figures: Array, share: float, confidence: float = CONFIDENCE) -> Interval:
    """Return a quantile of figures (N,), between two of them: the interval's ends are order statistics.

    Each end is passed with at most half of the chance left, whatever the distribution. An end that so few figures
    cannot give is infinite. Figures may be infinite, not NaN.
    """
    ordered = np.sort(figures)
    count, tail = len(ordered), (1.0 - confidence) / 2.0
    if count == 0:
        return Interval(math.nan, -math.inf, math.inf)
    # So many figures lie below the quantile, or more, with a chance of at most `tail`; the same from the other side.
    first = int(stats.binom.ppf(tail, count, share))
    last = int(stats.binom.ppf(1.0 - tail, count, share))
    low = float(ordered[first - 1]) if first > 0 else -math.inf
    high = float(ordered[last]) if last < count else math.inf
    return Interval(float(np.quantile(ordered, share, method="inverted_cdf")), low, high)


def rank_correlation(factor: Array, figure: Array, confidence: float = CONFIDENCE) -> Interval:
    """Return Spearman's coefficient of a factor (N,) and a figure (N,), -1 to 1; NaN where one of them is constant.

    The interval is Fisher's, with the variance of Bonett and Wright (2000) for ranks. Ties share their mean rank.
    """
    count = len(factor)
    if count < 4 or np.all(factor == factor[0]) or np.all(figure == figure[0]):
        return Interval(math.nan, -1.0, 1.0)
    ranks = stats.rankdata(factor), stats.rankdata(figure)
    found = float(np.clip(np.corrcoef(*ranks)[0, 1], -1.0, 1.0))
    if abs(found) > 1.0 - 1e-12:
        return Interval(found, found, found)
    half = float(stats.norm.ppf((1.0 + confidence) / 2.0)) * math.sqrt((1.0 + found**2 / 2.0) / (count - 3))
    return Interval(found, math.tanh(math.atanh(found) - half), math.tanh(math.atanh(found) + half))


def flights_needed(passed: Array, width: float, first: int = 30) -> int | None:
    """Return after how many flights, in the order of the design, the interval of the pass rate is that narrow.

    `passed` (N,) has 1 for a flight that passed and 0 for another. None where all of them do not suffice. Only the
    order of the design counts, not that of the results: any number of workers ends a campaign after the same flight.
    """
    count = np.arange(1, len(passed) + 1)
    good = np.cumsum(passed)
    tail = (1.0 - CONFIDENCE) / 2.0
    low = np.where(good > 0, stats.beta.ppf(tail, np.maximum(good, 1), count - good + 1), 0.0)
    high = np.where(good < count, stats.beta.ppf(1.0 - tail, good + 1, np.maximum(count - good, 1)), 1.0)
    narrow = np.flatnonzero((high - low <= width) & (count >= first))
    return int(count[narrow[0]]) if len(narrow) else None
