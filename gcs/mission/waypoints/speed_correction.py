"""Correct the leg speeds so that the modelled autopilot reaches each waypoint on time.

Lateness over all legs is minimised by least squares (Levenberg-Marquardt on the logarithms of the speeds). Lateness
above a second counts with its fourth power, so that unavoidable lateness is spread over legs. A speed acts on its own
leg, on its neighbours and on one leg after them. Every fourth speed is therefore varied in the same flight, and the
whole Jacobian takes four flights in coarse steps. A weak pull towards the planned speeds fixes speeds without effect,
such as those of legs too short for them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from gcs.autopilots.navigation.navigator import Navigator
from gcs.autopilots.navigation.predict import Prediction, predict
from gcs.errors import VerificationError
from gcs.mission.machine_independent import on_grid
from gcs.mission.waypoints.leg_profile import SHARES, LegProfile
from gcs.physics.quadrotor import Array

_LOGARITHM_GRID, _SPEED_GRID = 2.0**-16, 2.0**-20  # of speeds in m/s: every machine flies the same trials
_EVERY = 4  # distance, in legs, of speeds varied in one flight
_BEFORE, _AFTER = 1, 2  # legs before and after its own that a speed acts on
_TRIAL = 0.05  # variation of the logarithm of a speed
_STEP_MAX = 0.6  # of the logarithm of a speed, per round
_COARSE = 2.0  # factor on the navigator's step
_PULL = 0.1  # cost of a speed off by a factor of e, in s of lateness
_ROUNDS, _TRIES = 8, 4
_GOOD_S = 0.2
_STALE = 0.1  # least relative gain of a round
_SLOW_COUNTS = 0.3  # weight of a second between waypoints on the slowest legs, against 1 on the fastest


@dataclass(frozen=True)
class Corrected:
    """Speeds (N,), their predicted flight, and its lateness at the end of each leg (N,), negative for early.

    The flight starts `lead_s` before time 0, because a start from rest takes time.
    """

    speeds_mps: Array
    lead_s: float
    flown: Prediction
    late_s: Array


def correct(navigator: Navigator, profile: LegProfile, lead_s: tuple[float, float] = (0.0, 0.0)) -> Corrected:
    """The best speeds found, and the best lead between the two given.

    Raises `VerificationError` if the model does not complete the legs at the planned speeds.
    """
    problem = _Problem(navigator, profile, lead_s)
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
    return Corrected(_speeds_mps(now.x[:-1]), float(now.x[-1]), now.flown, now.late_s.reshape(-1, len(SHARES))[:, -1])


@dataclass(frozen=True)
class _Trial:
    """Logarithms of speeds and the lead (`x`), their flight, its lateness at every share of every leg, and the cost."""

    x: Array
    flown: Prediction
    late_s: Array
    cost: float


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

    def at(self, x: Array) -> _Trial:
        """The trial of x."""
        flown = predict(self._navigator, self._profile.orders(_speeds_mps(x[:-1])))
        late = (self._profile.passed_s(flown) - x[-1] - self._profile.due_s).ravel()
        weighed, pulled = self._counts * late * np.sqrt(1.0 + late**2), _PULL * (x - self.planned)
        return _Trial(x, flown, late, float(weighed @ weighed / len(SHARES) + pulled @ pulled))

    def slopes(self, x: Array) -> Array:
        """The Jacobian: lateness (N * shares) by each unknown (N + 1)."""
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
        """The trial after one damped step, or None if it is no better."""
        unit, weight = np.eye(len(now.x)), 1.0 / np.sqrt(len(SHARES))
        late, stretch = now.late_s, np.sqrt(1.0 + now.late_s**2)
        counts = weight * self._counts
        steeper = counts * (1.0 + 2.0 * late**2) / stretch
        matrix = np.vstack([slopes * steeper[:, None], _PULL * unit, damping * unit])
        pulled = _PULL * (self.planned - now.x)
        target = np.concatenate([-counts * late * stretch, pulled, np.zeros(len(now.x))])
        bounds = (
            np.maximum(self._low - now.x, -_STEP_MAX) - 1e-9,
            np.minimum(self._high - now.x, _STEP_MAX) + 1e-9,
        )
        step = lsq_linear(matrix, target, bounds).x
        try:
            trial = self.at(np.clip(on_grid(now.x + step, _LOGARITHM_GRID), self._low, self._high))
        except VerificationError:
            return None
        return trial if trial.cost < now.cost else None

    def _durations(self, logarithms: Array) -> Array:
        """Durations of every share of every leg, in coarse steps."""
        flown = predict(self._coarse, self._profile.orders(_speeds_mps(logarithms)))
        return np.diff(self._profile.passed_s(flown).ravel(), prepend=0.0)


def _speeds_mps(logarithms: Array) -> Array:
    return on_grid(np.exp(logarithms), _SPEED_GRID)
