"""What a campaign has shown: pass rates by stratum, quantiles, which factor matters, and the worst flights.

It reads the rows that are there, so that it can be asked while flights are under way.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcs.campaign.campaign_flight import ABORTED, FAILED, HELD, NO_PLAN
from gcs.campaign.flight_window import flights_counted
from gcs.campaign.kept_flights import FLIGHTS
from gcs.campaign.records import INDEX, INFRASTRUCTURE, MARGIN, OUTCOME, TEXT, CampaignFolder, Row, margins, of_fault
from gcs.campaign.statistics import CONFIDENCE, Interval, pass_rate, quantile, rank_correlation
from gcs.flight.recording.flight_folder import finite
from gcs.physics.wind import GUSTS_MPS
from gcs.types import Array, JsonObject

QUANTILES = (0.05, 0.5, 0.95)
LEVELS_MAX = 8  # of a factor with a stratum each; more values are divided into quarters
WORST = 3
_NOT_FACTORS = (INDEX, "seed")


@dataclass(frozen=True)
class Stratum:
    """The flights in which a factor had one value, or values within a range; all flights have no factor."""

    factor: str
    values: str
    flights: int
    held: int

    @property
    def rate(self) -> Interval:
        """The share that held, with its Clopper-Pearson interval."""
        return pass_rate(self.held, self.flights)


@dataclass(frozen=True)
class FigureRow:
    """The quantiles of one criterion's worst measured value, with order-statistic intervals, and its worst flights."""

    name: str
    flights: int
    quantiles: tuple[Interval, ...]
    least_margin: float
    worst: tuple[int, ...]


@dataclass(frozen=True)
class Effect:
    """The rank correlation of a factor and the margin of a criterion, or of whether the flight held."""

    factor: str
    figure: str
    correlation: Interval


@dataclass(frozen=True)
class CampaignSummary:
    """All of a campaign's results."""

    mission: str
    asked: int
    outcomes: Counter[str]
    not_counted: int  # beyond the flight at which the interval was narrow enough
    complete: bool
    strata: tuple[Stratum, ...]
    figures: tuple[FigureRow, ...]
    effects: tuple[Effect, ...]
    kept: frozenset[int]  # flights whose folder is there
    reasons: tuple[tuple[str, str, int], ...]  # outcome, why, in how many flights

    def data(self) -> JsonObject:
        """The summary as plain values."""
        return {
            "mission": self.mission,
            "flights": self.asked,
            "ended": self.outcomes.total(),
            "complete": self.complete,
            "not_counted": self.not_counted,
            "outcomes": {name: self.outcomes[name] for name in (HELD, FAILED, ABORTED, NO_PLAN, INFRASTRUCTURE)},
            "confidence": CONFIDENCE,
            "pass_rates": [
                {"factor": s.factor, "values": s.values, "flights": s.flights, "held": s.held, "rate": _ends(s.rate)}
                for s in self.strata
            ],
            "figures": [
                {
                    "name": f.name,
                    "flights": f.flights,
                    "quantiles": {f"{q:g}": _ends(one) for q, one in zip(QUANTILES, f.quantiles, strict=True)},
                    "least_margin": finite(f.least_margin),
                    "worst": list(f.worst),
                }
                for f in self.figures
            ],
            "effects": [{"factor": e.factor, "figure": e.figure, "rho": _ends(e.correlation)} for e in self.effects],
            "kept": sorted(self.kept),
            "reasons": [{"outcome": o, "reason": r, "flights": n} for o, r, n in self.reasons],
        }


def summarise(folder: CampaignFolder, until: float | None) -> CampaignSummary:
    """Return what the rows of a campaign's folder show; `until` is the width that ended it. Raises FileFormatError."""
    asked, design, every = folder.asked(), folder.design(), folder.results()
    outcomes = {row[INDEX]: row[OUTCOME] for row in every}
    enough = None if until is None else flights_counted(outcomes, until)
    results = every if enough is None else [row for row in every if row[INDEX] < enough]
    judged = [row for row in results if row[OUTCOME] != INFRASTRUCTURE]
    joined = [design[row[INDEX]] | row for row in judged]
    factors = [name for name in (design[0] if design else {}) if _is_factor(name)]
    names = list(dict.fromkeys(name for row in judged for name in margins(row)))
    held = [row for row in joined if row.get(names[0]) is not None] if names else []
    kept = {int(one.name) for one in (folder.path / FLIGHTS).glob("[0-9]*") if one.name.isdigit()}
    reasons = Counter((row[OUTCOME], row.get("reason") or "") for row in results if row[OUTCOME] != HELD)
    return CampaignSummary(
        str(asked.get("mission", "")),
        len(design),
        Counter(row[OUTCOME] for row in results),
        len(every) - len(results),
        enough is not None or len(judged) == len(design),
        tuple(_strata(joined, factors)),
        tuple(_figure(held, name) for name in names),
        tuple(_effects(joined, held, factors, names)),
        frozenset(kept),
        tuple((outcome, reason, count) for (outcome, reason), count in reasons.most_common()),
    )


def _is_factor(name: str) -> bool:
    return name not in _NOT_FACTORS and of_fault(name)[1] != TEXT


def _strata(rows: Sequence[Row], factors: Iterable[str]) -> Iterable[Stratum]:
    yield Stratum("", "all", len(rows), sum(row[OUTCOME] == HELD for row in rows))
    for factor in factors:
        of_it = _flights_of(rows, factor)
        values = [row[factor] for row in of_it]
        levels = sorted(set(values), key=lambda value: (_number(value), str(value)))
        if len(levels) < 2:
            continue
        if len(levels) <= LEVELS_MAX and (isinstance(levels[0], str) or len(levels) < len(of_it)):
            parts = [(_words(level), [row for row in of_it if row[factor] == level]) for level in levels]
        else:
            edges = np.linspace(min(levels), max(levels), 5)
            place = np.clip(np.searchsorted(edges, np.array(values, dtype=np.float64), side="right") - 1, 0, 3)
            parts = [
                (
                    f"{edges[n]:.3g} to {edges[n + 1]:.3g}",
                    [row for row, at in zip(of_it, place, strict=True) if at == n],
                )
                for n in range(4)
            ]
        for text, part in parts:
            yield Stratum(factor, text, len(part), sum(row[OUTCOME] == HELD for row in part))


def _figure(rows: Sequence[Row], name: str) -> FigureRow:
    known = [row for row in rows if row.get(name) is not None]
    values = np.array([row[name] for row in known], dtype=np.float64)
    worst = sorted(known, key=lambda row: (row[name + MARGIN], row[INDEX]))
    return FigureRow(
        name,
        len(known),
        tuple(quantile(values, share) for share in QUANTILES),
        float(worst[0][name + MARGIN]) if worst else math.nan,
        tuple(row[INDEX] for row in worst[:WORST]),
    )


def _effects(
    joined: Sequence[Row], held: Sequence[Row], factors: Iterable[str], names: Iterable[str]
) -> Iterable[Effect]:
    for factor in factors:
        of_it = _flights_of(joined, factor)
        passed = np.array([row[OUTCOME] == HELD for row in of_it], dtype=np.float64)
        found = [Effect(factor, "held", rank_correlation(_numbers(of_it, factor), passed))]
        for name in names:
            known = [row for row in _flights_of(held, factor) if row.get(name) is not None]
            margins = np.array([row[name + MARGIN] for row in known], dtype=np.float64)
            found.append(Effect(factor, name, rank_correlation(_numbers(known, factor), margins)))
        if any(not math.isnan(one.correlation.value) for one in found):
            yield from found


def _flights_of(rows: Sequence[Row], factor: str) -> Sequence[Row]:
    """The flights in which a factor means something: vehicle and time of a fault, where the fault happens."""
    fault, _ = of_fault(factor)
    return [row for row in rows if row[fault]] if fault else rows


def _numbers(rows: Sequence[Row], factor: str) -> Array:
    words = sorted({row[factor] for row in rows if isinstance(row[factor], str)})
    place = {word: float(n) for n, word in enumerate(words)}  # of words that are neither numbers nor gusts
    return np.array([_number(row[factor], place.get(row[factor], 0.0)) for row in rows], dtype=np.float64)


def _number(value: float | str, otherwise: float = 0.0) -> float:
    """The place of a level: words of gusts by their strength, others by the number that they may be."""
    if not isinstance(value, str):
        return float(value)
    try:
        return GUSTS_MPS[value] if value in GUSTS_MPS else float(value)
    except ValueError:
        return otherwise


def _words(level: float | str) -> str:
    return level if isinstance(level, str) else f"{level:.4g}"


def _ends(one: Interval) -> JsonObject:
    return {"value": finite(one.value), "low": finite(one.low), "high": finite(one.high)}


def flight_folder(campaign: Path, index: int) -> Path:
    """Return the folder of a kept flight."""
    return campaign / FLIGHTS / f"{index:06d}"
