"""Speeds to ask for so that an autopilot passes its legs when they are due, as far as it can.

Knows: a navigator that predicts, a course with due times. Does not know: plans, items, where waypoints should be.

Lateness over all legs is brought down by least squares (Levenberg-Marquardt on the logarithms of the speeds), in which
what is later than a second counts with its fourth power, so that what cannot be had is spread. A speed
acts on its own leg, on its neighbours and on one after them, so every fourth leg is tried in the same flight, and the
whole Jacobian costs four flights in coarse steps. A weak pull towards the planned speeds keeps apart what has no
effect: a slow-down that is lost, a leg too short for its speed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from gcs.autopilots.navigation.navigator import Navigator
from gcs.autopilots.navigation.predict import Prediction, predict
from gcs.errors import VerificationError
from gcs.mission.waypoints.leg_profile import SHARES, LegProfile
from gcs.physics.quadrotor import Array

_EVERY = 4  # legs between two that are tried at once
_BEFORE, _AFTER = 1, 2  # legs that a speed acts on, beside its own
_TRIAL = 0.05  # of a speed
_STEP_MAX = 0.6  # of the logarithm of a speed, per round
_COARSE = 2.0  # times the navigator's step
_PULL = 0.1  # s of lateness that a speed off by a factor of e is worth
_ROUNDS, _TRIES = 8, 4
_GOOD_S = 0.2
_STALE = 0.1  # of what is to be brought down
_SLOW_COUNTS = 0.3  # how much a second counts between waypoints where the course is slow, against 1 where it is fastest


@dataclass(frozen=True)
class Corrected:
    """Speeds (N,), the flight they become, and how late it passes the end of each leg (N,), negative for early.

    `lead_s` is how long before time 0 it leaves: starts from rest cost time.
    """

    speeds_mps: Array
    lead_s: float
    flown: Prediction
    late_s: Array


def correct(navigator: Navigator, course: LegProfile, lead_s: tuple[float, float] = (0.0, 0.0)) -> Corrected:
    """The best speeds found, and the best lead within these two.

    Raises `VerificationError` where the planned speeds lead nowhere.
    """
    problem = _Problem(navigator, course, lead_s)
    now = problem.at(problem.planned)
    damping = 0.3
    for number in range(_ROUNDS):
        slopes = problem.slopes(now.x)
        better = None
        for _ in range(_TRIES):
            better = problem.stepped(now, slopes, damping)
            if better is not None:
                break
            damping *= 4.0
        if better is None:
            break
        gained, now = now.cost - better.cost, better
        damping = max(damping / 3.0, 0.01)
        if np.abs(now.late_s).max() < _GOOD_S or (number > 1 and gained < _STALE * now.cost):
            break
    return Corrected(np.exp(now.x[:-1]), float(now.x[-1]), now.flown, now.late_s.reshape(-1, len(SHARES))[:, -1])


@dataclass(frozen=True)
class _Trial:
    """Logarithms of speeds, then the lead, and what came of them; lateness at every share of every leg in turn."""

    x: Array
    flown: Prediction
    late_s: Array
    cost: float


class _Problem:
    """Unknowns (N + 1,): the logarithms of the speeds, and the lead."""

    def __init__(self, navigator: Navigator, course: LegProfile, lead_s: tuple[float, float]) -> None:
        self._navigator, self._course = navigator, course
        self._coarse: Navigator = replace(navigator, step_s=_COARSE * navigator.step_s)  # type: ignore[type-var]
        slowest = np.full(len(course.fastest_mps), course.slowest_mps)
        self._low = np.append(np.log(slowest), lead_s[0])
        self._high = np.append(np.log(course.fastest_mps), lead_s[1])
        self.planned = np.append(np.log(course.planned_mps), lead_s[0])
        counts = _SLOW_COUNTS + (1.0 - _SLOW_COUNTS) * course.planned_mps / course.planned_mps.max()
        parts = np.repeat(counts[:, None], len(SHARES), axis=1)
        parts[:, -1] = 1.0
        self._counts = parts.ravel()

    def at(self, x: Array) -> _Trial:
        """Fly as x says."""
        flown = predict(self._navigator, self._course.orders(np.exp(x[:-1])))
        late = (self._course.passed_s(flown) - x[-1] - self._course.due_s).ravel()
        weighed, pulled = self._counts * late * np.sqrt(1.0 + late**2), _PULL * (x - self.planned)
        return _Trial(x, flown, late, float(weighed @ weighed / len(SHARES) + pulled @ pulled))

    def slopes(self, x: Array) -> Array:
        """Lateness (N * shares) by each unknown (N + 1)."""
        legs, parts = len(x) - 1, len(SHARES)
        before = self._durations(x[:-1])
        slopes = np.zeros((legs * parts, legs + 1))
        for first in range(min(_EVERY, legs)):
            tried = np.arange(first, legs, _EVERY)
            step = np.zeros(legs)
            step[tried] = np.where(x[tried] + _TRIAL > self._high[tried], -_TRIAL, _TRIAL)
            gained = self._durations(x[:-1] + step) - before
            for leg in tried.tolist():
                acts = slice(max(leg - _BEFORE, 0) * parts, (leg + _AFTER + 1) * parts)
                slopes[acts, leg] = gained[acts] / step[leg]
        slopes[0, -1] = -1.0
        return np.cumsum(slopes, axis=0)

    def stepped(self, now: _Trial, slopes: Array, damping: float) -> _Trial | None:
        """A better trial, or None."""
        unit, weight = np.eye(len(now.x)), 1.0 / np.sqrt(len(SHARES))
        late, stretch = now.late_s, np.sqrt(1.0 + now.late_s**2)
        counts = weight * self._counts
        steeper = counts * (1.0 + 2.0 * late**2) / stretch
        matrix = np.vstack([slopes * steeper[:, None], _PULL * unit, damping * unit])
        pulled = _PULL * (self.planned - now.x)
        wanted = np.concatenate([-counts * late * stretch, pulled, np.zeros(len(now.x))])
        bounds = (
            np.maximum(self._low - now.x, -_STEP_MAX) - 1e-9,
            np.minimum(self._high - now.x, _STEP_MAX) + 1e-9,
        )
        step = lsq_linear(matrix, wanted, bounds).x
        try:
            trial = self.at(np.clip(now.x + step, self._low, self._high))
        except VerificationError:
            return None
        return trial if trial.cost < now.cost else None

    def _durations(self, logarithms: Array) -> Array:
        """Of every part of every leg, in coarse steps."""
        flown = predict(self._coarse, self._course.orders(np.exp(logarithms)))
        return np.diff(self._course.passed_s(flown).ravel(), prepend=0.0)
