"""Corrects leg speeds so that the modelled autopilot reaches each waypoint on time.

Lateness over all legs is minimised by least squares (Levenberg-Marquardt on the logarithms of the speeds). Lateness
above a second counts with its fourth power, so that unavoidable lateness is spread over legs. A speed acts on its own
leg, on its neighbours and on one leg after them. Every fourth speed is therefore varied in the same flight, and the
whole Jacobian takes four flights in coarse steps; after each step Schubert's sparse form of Broyden's update corrects
it by the flight flown, and only where that leads no further it is flown again. A vehicle begins with the correction and
the Jacobian of another one whose legs are alike. A weak pull towards the planned speeds fixes speeds without effect,
such as those of legs too short for them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from gcs.autopilots.waypoint_models.navigator import Navigator
from gcs.autopilots.waypoint_models.predict import Prediction, predict
from gcs.errors import VerificationError
from gcs.mission.machine_independent import on_grid
from gcs.mission.waypoints.leg_profile import SHARES, LegProfile
from gcs.types import Array
from gcs.util.long_work import report

_LOGARITHM_GRID, _SPEED_GRID = 2.0**-16, 2.0**-20  # of speeds in m/s: every machine flies the same trials
_EVERY = 4  # distance, in legs, of speeds varied in one flight
_BEFORE, _AFTER = 1, 2  # legs before and after its own that a speed acts on
_TRIAL = 0.05  # variation of the logarithm of a speed
_STEP_MAX = 0.6  # of the logarithm of a speed, per round
_COARSE = 2.0  # factor on the navigator's step
_BET = 5.0  # cost of a cruise faster than commanded by a factor of e, in s of lateness
_SPARE = 0.8  # share of OBEYED_WITHIN from which it costs
_PULL = 0.2  # cost of a speed off by a factor of e, in s of lateness
_ROUNDS, _TRIES, _DAMPED = 8, 3, 6.0
_TIMES, _AGAIN, _DEARER = (
    4,
    3,
    3.0,
)  # corrections and their rounds while legs are still faster, at so many times the cost
_GOOD_S = 0.2
_WORSE = 1.2  # factor on the cost that it may take to command the speeds that are flown
_NO_STEP = 1e-12  # square of a change of speeds that says nothing about slopes
_STALE = 0.1  # least relative gain of a round
_SLOW_COUNTS = 0.3  # weight of a second between waypoints on the slowest legs, against 1 on the fastest
OBEYED_WITHIN = 0.1  # share of a commanded speed by which the cruise of its leg may be faster


@dataclass(frozen=True)
class Corrected:
    """Speeds (N,), their predicted flight, and its lateness at the end of each leg (N,), negative for early.

    The flight starts `lead_s` before time 0, because a start from rest takes time. `found` is what a vehicle with the
    same number of similar legs may begin with.
    """

    speeds_mps: Array
    lead_s: float
    flown: Prediction
    late_s: Array
    found: Found


@dataclass(frozen=True)
class Found:
    """What a correction ended with: by how much (N + 1,) its unknowns differ from the planned ones, and its slopes."""

    moved: Array
    slopes: _Slopes


def correct(
    navigator: Navigator, profile: LegProfile, lead_s: tuple[float, float] = (0.0, 0.0), like: Found | None = None
) -> Corrected:
    """The best speeds found, and the best lead between the two given.

    No speed counts on an autopilot's not obeying it: no cruise is, or may be, faster than commanded by more than
    `OBEYED_WITHIN`. The search begins at the planned speeds, or at what was found for a vehicle `like` this one where
    that is better.

    Raises `VerificationError` if the model does not complete the legs at the planned speeds.
    """
    problem = _Problem(navigator, profile, lead_s)
    search = problem.search(like)
    search.go(_ROUNDS)
    now = problem.without_bets(search.now)
    for _ in range(_TIMES):
        if now.cost <= _WORSE * search.now.cost or now.off_s < _GOOD_S:
            break
        search.make_bets_dearer()
        search.go(_AGAIN)
        now = problem.without_bets(search.now)
    found = Found(now.x - problem.planned, search.slopes)
    return Corrected(_speeds_mps(now.x[:-1]), float(now.x[-1]), now.flown, now.ends_late_s, found)


def _progress(now: _Trial) -> str:
    return f"timing a mission by the model of its autopilot: waypoints at most {np.abs(now.late_s).max():.2f} s off"


@dataclass(frozen=True)
class _Trial:
    """Logarithms of speeds and the lead (`x`), their flight, its lateness at every share of every leg, and the cost."""

    x: Array
    flown: Prediction
    late_s: Array
    obeyed: Array  # (N,) cruise of each leg over its commanded speed, at most
    cost: float
    both: bool  # whether `obeyed` counts the least obedient autopilot too

    @property
    def ends_late_s(self) -> Array:
        """The lateness at the end of each leg (N,)."""
        return self.late_s.reshape(-1, len(SHARES))[:, -1]

    @property
    def off_s(self) -> float:
        """The largest of them, late or early."""
        return float(np.abs(self.ends_late_s).max())

    @property
    def bets(self) -> NDArray[np.bool_]:
        """The legs (N,) that are, or may be, flown faster than commanded."""
        return self.obeyed > 1.0 + OBEYED_WITHIN

    @property
    def faster(self) -> Array:
        """By how much (N,) they are, as a logarithm, with a little to spare."""
        return np.maximum(np.log(self.obeyed / (1.0 + _SPARE * OBEYED_WITHIN)), 0.0)


@dataclass(frozen=True)
class _Slopes:
    """How the duration of every share of every leg goes with each unknown: (N * shares, N + 1).

    They are `fresh` if they were flown where the search is.
    """

    durations: Array
    fresh: bool = True

    @property
    def late(self) -> Array:
        """The Jacobian of the lateness."""
        return np.cumsum(self.durations, axis=0)

    def after(self, before: _Trial, then: _Trial) -> _Slopes:
        """The slopes after a step, corrected by what its flight did (Schubert's update, row by row)."""
        step = then.x - before.x
        gained = np.diff(then.late_s - before.late_s, prepend=0.0)
        reach = _reach(len(step) - 1) * step
        size = np.sum(reach * reach, axis=1)
        wrong = (gained - self.durations @ step) / np.where(size > _NO_STEP, size, np.inf)
        return _Slopes(self.durations + wrong[:, None] * reach, fresh=False)


def _reach(legs: int) -> Array:
    """1 where a speed acts on the duration of a share (N * shares, N + 1), and 0 elsewhere."""
    parts = len(SHARES)
    reach = np.zeros((legs * parts, legs + 1))
    for leg in range(legs):
        reach[max(leg - _BEFORE, 0) * parts : (leg + _AFTER + 1) * parts, leg] = 1.0
    return reach


class _Search:
    """Damped steps from a trial on."""

    def __init__(self, problem: _Problem, now: _Trial, slopes: _Slopes | None) -> None:
        self.now, self._problem = now, problem
        self.slopes = slopes or problem.slopes(now)

    def go(self, rounds: int) -> None:
        """To the best trial that so many steps lead to."""
        damping = 0.3
        for number in range(rounds):
            before = self.now
            better, damping = self._step(damping)
            if better is None:
                break
            flown_here = self.slopes.fresh
            self.now, self.slopes = better, self.slopes.after(before, better)
            if better.off_s < _GOOD_S and not better.bets.any():
                break
            if number > 1 and before.cost - better.cost < _STALE * before.cost:
                if flown_here or better.off_s < _GOOD_S:
                    break
                self.slopes = self._problem.slopes(better)

    def make_bets_dearer(self) -> None:
        """From now on a faster cruise than commanded costs more."""
        self._problem.bet *= _DEARER
        self.now = self._problem.weighed(self.now)

    def _step(self, damping: float) -> tuple[_Trial | None, float]:
        """A better trial if there is one, and the damping for the next step."""
        while True:
            tried = damping
            for _ in range(_TRIES):
                report(partial(_progress, self.now))
                better = self._problem.stepped(self.now, self.slopes.late, tried)
                if better is not None:
                    return better, max(tried / 3.0, 0.01)
                tried *= _DAMPED
            if self.slopes.fresh or self.now.off_s < _GOOD_S:
                return None, damping
            self.slopes = self._problem.slopes(self.now)


class _Problem:
    """The least-squares problem; its unknowns (N + 1,) are the logarithms of the speeds, and the lead."""

    def __init__(self, navigator: Navigator, profile: LegProfile, lead_s: tuple[float, float]) -> None:
        self._navigator, self._profile = navigator, profile
        self._coarse: Navigator = replace(navigator, step_s=_COARSE * navigator.step_s)  # type: ignore[type-var]
        slowest = np.full(len(profile.fastest_mps), profile.slowest_mps)
        self._low = np.append(np.log(slowest), lead_s[0])
        self._high = np.append(np.log(profile.fastest_mps), lead_s[1])
        self.planned = on_grid(np.append(np.log(profile.planned_mps), lead_s[0]), _LOGARITHM_GRID)
        counts = _SLOW_COUNTS + (1.0 - _SLOW_COUNTS) * profile.planned_mps / profile.planned_mps.max()
        parts = np.repeat(counts[:, None], len(SHARES), axis=1)
        parts[:, -1] = 1.0
        self._counts = parts.ravel()
        self.bet = _BET
        self._least = navigator.least_obedient
        self._flown: dict[bytes, _Trial] = {}
        self._fair: _Trial | None = None  # the cheapest trial without bets

    def inside(self, x: Array) -> Array:
        """The nearest unknowns within their bounds."""
        return np.clip(x, self._low, self._high)

    def without_bets(self, now: _Trial) -> _Trial:
        """The cheapest trial so far without legs that are flown faster than commanded.

        In this trial they are commanded what they are flown at: they are flown as before, but the legs after them may
        change.
        """
        for _ in range(len(now.faster)):
            bets = now.bets
            if not bets.any():
                break
            report(partial(_progress, now))
            x = now.x.copy()
            x[:-1][bets] = np.ceil((x[:-1] + np.log(now.obeyed))[bets] / _LOGARITHM_GRID) * _LOGARITHM_GRID
            now = self.at(self.inside(x))
        return self._fair or now

    def at(self, x: Array) -> _Trial:
        """The trial of x."""
        trial = self._cheaper(x, math.inf)
        assert trial is not None
        return trial

    def _cheaper(self, x: Array, cost: float) -> _Trial | None:
        """The trial of x, or None if it costs as much as this: often one flight is enough to tell."""
        trial = self._flown.get(x.tobytes()) or self._trial(x, self._navigator)
        trial = self.weighed(trial)
        if trial.flown.doubtful and trial.cost < cost and not trial.both:
            least = self._trial(x, self._least)
            trial = self.weighed(replace(trial, obeyed=np.maximum(trial.obeyed, least.obeyed), both=True))
        self._flown[x.tobytes()] = trial
        if trial.cost >= cost:
            return None
        if not trial.bets.any() and (self._fair is None or trial.cost < self._fair.cost):
            self._fair = trial
        return trial

    def _trial(self, x: Array, navigator: Navigator) -> _Trial:
        flown = predict(navigator, self._profile.orders(_speeds_mps(x[:-1])))
        late = (self._profile.passed_s(flown) - x[-1] - self._profile.due_s).ravel()
        return _Trial(x, flown, late, flown.obeyed, math.inf, both=navigator is self._least)

    def weighed(self, trial: _Trial) -> _Trial:
        """The trial with its cost."""
        late = trial.late_s
        weighed, pulled = self._counts * late * np.sqrt(1.0 + late**2), _PULL * (trial.x - self.planned)
        bets = self.bet * trial.faster
        return replace(trial, cost=float(weighed @ weighed / len(SHARES) + pulled @ pulled + bets @ bets))

    def search(self, like: Found | None) -> _Search:
        """The search from the planned speeds, or from those of a vehicle like this one."""
        planned = self.at(self.planned)
        if like is None or len(like.moved) != len(self.planned):
            return _Search(self, planned, None)
        try:
            alike = self.at(self.inside(on_grid(self.planned + like.moved, _LOGARITHM_GRID)))
        except VerificationError:
            return _Search(self, planned, None)
        if alike.cost >= planned.cost:
            return _Search(self, planned, None)
        return _Search(self, alike, replace(like.slopes, fresh=False))

    def slopes(self, now: _Trial) -> _Slopes:
        """The slopes at a trial, by flights in which every fourth speed is varied."""
        x, legs = now.x, len(now.x) - 1
        report(partial(_progress, now))
        before = self._durations(x)
        reach = _reach(legs)
        slopes = np.zeros_like(reach)
        for first in range(min(_EVERY, legs)):
            report(partial(_progress, now))
            tried = np.arange(first, legs, _EVERY)
            step = np.zeros(legs + 1)
            step[tried] = np.where(x[tried] + _TRIAL > self._high[tried], -_TRIAL, _TRIAL)
            gained = self._durations(x + step) - before
            slopes[:, tried] = reach[:, tried] * gained[:, None] / step[tried]
        slopes[0, -1] = -1.0
        return _Slopes(slopes)

    def stepped(self, now: _Trial, slopes: Array, damping: float) -> _Trial | None:
        """The trial after one damped step, or None if it is no better."""
        unit, weight = np.eye(len(now.x)), 1.0 / np.sqrt(len(SHARES))
        late, stretch = now.late_s, np.sqrt(1.0 + now.late_s**2)
        counts = weight * self._counts
        steeper = counts * (1.0 + 2.0 * late**2) / stretch
        # The cruise of a leg that is faster than commanded has the speed of the leg before.
        bets = np.flatnonzero(now.faster)
        fairer = self.bet * (unit[bets - 1] - unit[bets])
        matrix = np.vstack([slopes * steeper[:, None], fairer, _PULL * unit, damping * unit])
        pulled = _PULL * (self.planned - now.x)
        target = np.concatenate([-counts * late * stretch, -self.bet * now.faster[bets], pulled, np.zeros(len(now.x))])
        bounds = (np.maximum(self._low - now.x, -_STEP_MAX) - 1e-9, np.minimum(self._high - now.x, _STEP_MAX) + 1e-9)
        step = lsq_linear(matrix, target, bounds).x
        try:
            return self._cheaper(self.inside(on_grid(now.x + step, _LOGARITHM_GRID)), now.cost)
        except VerificationError:
            return None

    def _durations(self, x: Array) -> Array:
        """Durations of every share of every leg, in coarse steps."""
        flown = predict(self._coarse, self._profile.orders(_speeds_mps(x[:-1])))
        return np.diff(self._profile.passed_s(flown).ravel(), prepend=0.0)


def _speeds_mps(logarithms: Array) -> Array:
    return on_grid(np.exp(logarithms), _SPEED_GRID)
