"""Intervals against closed forms, published values, and their coverage in simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs.campaign.statistics import flights_needed, pass_rate, quantile, rank_correlation

DRAWS = 4000


@pytest.mark.parametrize("flights", [1, 10, 1000])
def test_no_failure_has_the_closed_form(flights: int) -> None:
    assert pass_rate(0, flights).high == pytest.approx(1.0 - 0.025 ** (1.0 / flights))
    assert pass_rate(flights, flights).low == pytest.approx(0.025 ** (1.0 / flights))


def test_a_published_interval() -> None:
    """81 of 263, from Newcombe (1998), table I."""
    found = pass_rate(81, 263)
    assert (found.low, found.high) == (pytest.approx(0.2527, abs=5e-5), pytest.approx(0.3676, abs=5e-5))


def test_without_flights_nothing_is_known() -> None:
    found = pass_rate(0, 0)
    assert math.isnan(found.value)
    assert found[1:] == (0.0, 1.0)


@pytest.mark.parametrize("share", [0.01, 0.2, 0.75, 0.99])
@pytest.mark.parametrize("flights", [8, 50])
def test_a_pass_rate_is_covered(share: float, flights: int) -> None:
    """Exactly: the chance of every count, summed over those whose interval has the share."""
    chances = [math.comb(flights, k) * share**k * (1.0 - share) ** (flights - k) for k in range(flights + 1)]
    found = [pass_rate(k, flights) for k in range(flights + 1)]
    assert sum(p for p, one in zip(chances, found, strict=True) if one.low <= share <= one.high) >= 0.95


@pytest.mark.parametrize(("share", "count"), [(0.5, 6), (0.5, 41), (0.05, 100), (0.95, 100), (0.95, 20)])
def test_a_quantile_is_covered_whatever_the_distribution(share: float, count: int) -> None:
    random = np.random.default_rng(count)
    true = math.expm1(-math.log1p(-share))  # of exp(E) - 1, E exponential: a heavy tail
    found = [quantile(np.expm1(random.exponential(size=count)), share) for _ in range(DRAWS)]
    covered = np.mean([one.low <= true <= one.high for one in found])
    assert covered >= 0.95 - 3.0 * math.sqrt(0.05 * 0.95 / DRAWS)


def test_a_quantile_of_few_figures_is_open_to_its_side() -> None:
    found = quantile(np.arange(10.0), 0.95)
    assert found.high == math.inf
    assert math.isfinite(found.low)


def test_the_median_of_six_lies_between_the_extremes() -> None:
    """1 - 2 / 2**6 = 0.969: the textbook's first sample size with an interval."""
    assert quantile(np.arange(6.0), 0.5)[1:] == (0.0, 5.0)
    assert quantile(np.arange(5.0), 0.5)[1:] == (-math.inf, math.inf)


def test_ranks_know_order_only() -> None:
    factor = np.arange(20.0)
    assert rank_correlation(factor, np.exp(factor)).value == pytest.approx(1.0)
    assert rank_correlation(factor, -(factor**3)).value == pytest.approx(-1.0)
    assert math.isnan(rank_correlation(factor, np.ones(20)).value)


def test_a_rank_correlation_is_covered() -> None:
    """Of a normal pair: Spearman's coefficient is 6 / pi asin(r / 2)."""
    random, r = np.random.default_rng(1), 0.6
    true = 6.0 / math.pi * math.asin(r / 2.0)
    covered = 0
    for _ in range(DRAWS // 2):
        x, noise = random.standard_normal((2, 60))
        found = rank_correlation(x, r * x + math.sqrt(1.0 - r * r) * noise)
        covered += found.low <= true <= found.high
    assert 0.93 <= covered / (DRAWS // 2) <= 0.975


def test_a_campaign_ends_at_the_first_narrow_interval() -> None:
    passed = np.ones(2000)
    passed[::10] = 0.0
    width = 0.05
    count = flights_needed(passed, width)
    assert count is not None
    good = [int(passed[:n].sum()) for n in (count - 1, count)]
    before, then = pass_rate(good[0], count - 1), pass_rate(good[1], count)
    assert then.high - then.low <= width < before.high - before.low
    assert flights_needed(passed, 1e-4) is None
    assert flights_needed(passed[: count + 3], width) == count
    assert flights_needed(np.ones(29), 0.5) is None
