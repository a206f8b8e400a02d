"""Corrects leg speeds so that the modelled autopilot reaches each waypoint on time.

Lateness over all legs is minimised by least squares (Levenberg-Marquardt on the logarithms of the speeds). Lateness
above a second counts with its fourth power, so that unavoidable lateness is spread over legs. A speed acts on its own
leg, on its neighbours and on one leg after them. Every fourth speed is therefore varied in the same flight, and the
whole Jacobian takes four flights in coarse steps. A weak pull towards the planned speeds fixes speeds without effect,
such as those of legs too short for them.

A leg profile has the end points of a vehicle's legs, and the times at which shares of each leg are due.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from gcs.autopilots.waypoint_models.navigator import Navigator, NavigatorOrders
from gcs.autopilots.waypoint_models.predict import NEAR_M, Prediction, predict
from gcs.errors import VerificationError
from gcs.mission.machine_independent import ORDER_GRID, on_grid
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
_PULL = 0.1  # cost of a speed off by a factor of e, in s of lateness
_ROUNDS, _TRIES = 8, 4
_TIMES, _AGAIN, _DEARER = (
    4,
    3,
    3.0,
)  # corrections and their rounds while legs are still faster, at so many times the cost
_GOOD_S = 0.2
_STALE = 0.1  # least relative gain of a round
_SLOW_COUNTS = 0.3  # weight of a second between waypoints on the slowest legs, against 1 on the fastest
SHARES = (1.0 / 3.0, 2.0 / 3.0, 1.0)  # of a leg, at which lateness is measured
_STILL_M = 0.01
OBEYED_WITHIN = 0.1  # share of a commanded speed by which the cruise of its leg may be faster


@dataclass(frozen=True)
class LegProfile:
    """Legs between points (N + 1, 3), from rest at time 0.

    `due_s` (N, len(SHARES)) are the times at which these shares of each leg are due, `holds_s` (N,) the holds at leg
    ends. The end of a leg with a hold is due when the autopilot's delay begins. Speeds are between `slowest_mps` and
    `fastest_mps` (N,). `airborne_s` is the time flown before time 0.
    """

    points_ned_m: Array
    due_s: Array
    holds_s: Array
    slowest_mps: float
    fastest_mps: Array
    airborne_s: float = math.inf

    @property
    def lengths_m(self) -> Array:
        """Lengths of the legs (N,)."""
        return np.asarray(np.linalg.norm(np.diff(self.points_ned_m, axis=0), axis=1))

    @property
    def planned_mps(self) -> Array:
        """Speeds (N,) that keep the due times if each is reached at once."""
        left_s = np.concatenate([[0.0], (self.due_s[:, -1] + self.holds_s)[:-1]])
        speeds = self.lengths_m / np.maximum(self.due_s[:, -1] - left_s, 1e-3)
        return np.asarray(np.clip(speeds, self.slowest_mps, self.fastest_mps))

    def orders(self, speeds_mps: Array) -> NavigatorOrders:
        """The orders to fly these legs at speeds (N,)."""
        return NavigatorOrders.through(
            self.points_ned_m, speeds_mps.tolist(), self.holds_s.tolist(), airborne_s=self.airborne_s
        )

    def passed_s(self, flown: Prediction) -> Array:
        """The times (N, len(SHARES)) at which a flight passed the shares of each leg, between its steps."""
        chords = np.diff(self.points_ned_m, axis=0)
        times = np.empty((len(chords), len(SHARES)))
        begin = 0
        for leg, chord in enumerate(chords):
            end = max(int(np.searchsorted(flown.t_s, flown.passed_s[leg] - 1e-9)), begin + 1)
            end = min(end, len(flown.t_s) - 1)
            rows = slice(begin, end + 1)
            along = (flown.position_ned_m[rows] - self.points_ned_m[leg]) @ chord / (chord @ chord)
            times[leg] = np.interp(SHARES, np.maximum.accumulate(along), flown.t_s[rows])
            times[leg, -1] = self._nearest_s(flown, leg, end)
            left_s = flown.completed_s[leg] if self.holds_s[leg] > 0.0 else flown.t_s[end]
            begin = min(int(np.searchsorted(flown.t_s, left_s - 1e-9)), len(flown.t_s) - 2)
        return times

    def _nearest_s(self, flown: Prediction, leg: int, row: int) -> float:
        """The time of passing the end of a leg, refined within one step of `row`."""
        t_s = float(flown.t_s[row])
        if leg + 1 == len(self.holds_s):
            return t_s
        if self.holds_s[leg] > 0.0:
            return float(flown.completed_s[leg] - self.holds_s[leg])
        away, velocity = self.points_ned_m[leg + 1] - flown.position_ned_m[row], flown.velocity_ned_mps[row]
        step_s = float(flown.t_s[1] - flown.t_s[0])
        beside_s = float(away @ velocity) / max(float(velocity @ velocity), 1e-6)
        return t_s + min(max(beside_s, -step_s), step_s)


@dataclass(frozen=True)
class NavigatorLimits:
    """What a vehicle and its autopilot allow on a leg.

    No component of a speed exceeds `speed_ned_mps` (3,), and no speed `fastest_mps`. The autopilot's delay at a
    waypoint begins `delay_begins_m` from it, or with 0 once the vehicle rests there.
    """

    speed_ned_mps: Array
    slowest_mps: float
    fastest_mps: float
    delay_begins_m: float = 0.0


def leg_profile(
    t_s: Array, position_ned_m: Array, waypoints: list[int], limits: NavigatorLimits, airborne_s: float
) -> tuple[LegProfile, list[int]]:
    """The profile through samples (M, 3) at t_s (M,), and for each leg its number among pairs of `waypoints`.

    If the samples rest from one waypoint to the next, there is a hold instead of a leg, which ends when the samples
    leave. `airborne_s` is the time flown before the first sample. Points and due times are on `ORDER_GRID`.
    """
    ends_ned_m = on_grid(position_ned_m[waypoints], ORDER_GRID)
    legs: list[int] = []
    points = [ends_ned_m[0]]
    due: list[Array] = []
    holds: list[float] = []
    fastest: list[float] = []
    waited_s = 0.0
    for number, (i, j) in enumerate(pairwise(waypoints)):
        chord = ends_ned_m[number + 1] - points[-1]
        length = float(np.linalg.norm(chord))
        if length < _STILL_M and j != waypoints[-1]:
            if holds:
                if holds[-1] == 0.0:
                    begins_s = _near_s(t_s[: i + 1], position_ned_m[: i + 1], limits.delay_begins_m)
                    holds[-1] = float(t_s[i]) - begins_s
                    due[-1] = np.minimum(due[-1], begins_s - t_s[waypoints[0]] - waited_s)
                holds[-1] += float(t_s[j] - t_s[i])
            else:
                waited_s += float(t_s[j] - t_s[i])
            continue
        legs.append(number)
        moved = position_ned_m[i : j + 1] - points[-1]
        along = np.maximum.accumulate(moved @ chord) / max(length * length, 1e-12)
        due.append(np.interp(SHARES, along, t_s[i : j + 1]) - t_s[waypoints[0]] - waited_s)
        due[-1][-1] = t_s[j] - t_s[waypoints[0]] - waited_s
        holds.append(0.0)
        fastest.append(float(np.min(limits.speed_ned_mps / np.maximum(np.abs(chord) / max(length, _STILL_M), 1e-9))))
        points.append(ends_ned_m[number + 1])
        if j == waypoints[-1]:
            near = np.linalg.norm(position_ned_m[i : j + 1] - position_ned_m[j], axis=1) <= NEAR_M
            due[-1][-1] = min(due[-1][-1], t_s[i + int(np.argmax(near))] - t_s[waypoints[0]] - waited_s)
            due[-1] = np.minimum(due[-1], due[-1][-1])
    return (
        LegProfile(
            np.array(points),
            on_grid(np.array(due), ORDER_GRID),
            np.array(holds),
            limits.slowest_mps,
            np.clip(fastest, limits.slowest_mps, limits.fastest_mps),
            airborne_s + waited_s,
        ),
        legs,
    )


def _near_s(t_s: Array, position_ned_m: Array, near_m: float) -> float:
    """The time from which the samples stay within this distance of the last one."""
    far = np.flatnonzero(np.linalg.norm(position_ned_m - position_ned_m[-1], axis=1) > max(near_m, 1e-9))
    return float(t_s[far[-1] + 1]) if near_m > 0.0 and len(far) else float(t_s[-1])


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

    No speed counts on an autopilot's not obeying it: no cruise is, or may be, faster than commanded by more than
    `OBEYED_WITHIN`.

    Raises `VerificationError` if the model does not complete the legs at the planned speeds.
    """
    problem = _Problem(navigator, profile, lead_s)
    now = _solved(problem, problem.at(problem.planned), _ROUNDS)
    for _ in range(_TIMES):
        if not now.bets.any():
            break
        problem.bet *= _DEARER
        now = _solved(problem, problem.at(now.x), _AGAIN)
    now = problem.without_bets(now)
    return Corrected(_speeds_mps(now.x[:-1]), float(now.x[-1]), now.flown, now.late_s.reshape(-1, len(SHARES))[:, -1])


def _progress(now: _Trial) -> str:
    return f"timing a mission by the model of its autopilot: waypoints at most {np.abs(now.late_s).max():.2f} s off"


def _solved(problem: _Problem, now: _Trial, rounds: int) -> _Trial:
    """The best trial that so many damped steps lead to."""
    damping = 0.3
    for number in range(rounds):
        slopes = problem.slopes(now)
        better = None
        for _ in range(_TRIES):
            report(partial(_progress, now))
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
    return now


@dataclass(frozen=True)
class _Trial:
    """Logarithms of speeds and the lead (`x`), their flight, its lateness at every share of every leg, and the cost."""

    x: Array
    flown: Prediction
    late_s: Array
    obeyed: Array  # (N,) cruise of each leg over its commanded speed, at most
    cost: float

    @property
    def bets(self) -> NDArray[np.bool_]:
        """The legs (N,) that are, or may be, flown faster than commanded."""
        return self.obeyed > 1.0 + OBEYED_WITHIN

    @property
    def faster(self) -> Array:
        """By how much (N,) they are, as a logarithm, with a little to spare."""
        return np.maximum(np.log(self.obeyed / (1.0 + _SPARE * OBEYED_WITHIN)), 0.0)


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

    def inside(self, x: Array) -> Array:
        """The nearest unknowns within their bounds."""
        return np.clip(x, self._low, self._high)

    def without_bets(self, now: _Trial) -> _Trial:
        """The trial in which legs that are flown faster than commanded are commanded what they are flown at.

        They are flown as before. The legs after them may change.
        """
        for _ in range(len(now.faster)):
            bets = now.bets
            if not bets.any():
                break
            report(partial(_progress, now))
            x = now.x.copy()
            x[:-1][bets] = np.ceil((x[:-1] + np.log(now.obeyed))[bets] / _LOGARITHM_GRID) * _LOGARITHM_GRID
            now = self.at(self.inside(x))
        return now

    def at(self, x: Array) -> _Trial:
        """The trial of x."""
        orders = self._profile.orders(_speeds_mps(x[:-1]))
        flown = predict(self._navigator, orders)
        least = flown if self._least is self._navigator else predict(self._least, orders)
        late = (self._profile.passed_s(flown) - x[-1] - self._profile.due_s).ravel()
        weighed, pulled = self._counts * late * np.sqrt(1.0 + late**2), _PULL * (x - self.planned)
        trial = _Trial(x, flown, late, np.maximum(flown.obeyed, least.obeyed), 0.0)
        bets = self.bet * trial.faster
        return replace(trial, cost=float(weighed @ weighed / len(SHARES) + pulled @ pulled + bets @ bets))

    def slopes(self, now: _Trial) -> Array:
        """The Jacobian at a trial: lateness (N * shares) by each unknown (N + 1)."""
        x, legs, parts = now.x, len(now.x) - 1, len(SHARES)
        report(partial(_progress, now))
        before = self._durations(x)
        slopes = np.zeros((legs * parts, legs + 1))
        for first in range(min(_EVERY, legs)):
            report(partial(_progress, now))
            tried = np.arange(first, legs, _EVERY)
            step = np.zeros(legs + 1)
            step[tried] = np.where(x[tried] + _TRIAL > self._high[tried], -_TRIAL, _TRIAL)
            gained = self._durations(x + step) - before
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
        # The cruise of a leg that is faster than commanded has the speed of the leg before.
        bets = np.flatnonzero(now.faster)
        fairer = self.bet * (unit[bets - 1] - unit[bets])
        matrix = np.vstack([slopes * steeper[:, None], fairer, _PULL * unit, damping * unit])
        pulled = _PULL * (self.planned - now.x)
        target = np.concatenate([-counts * late * stretch, -self.bet * now.faster[bets], pulled, np.zeros(len(now.x))])
        bounds = (np.maximum(self._low - now.x, -_STEP_MAX) - 1e-9, np.minimum(self._high - now.x, _STEP_MAX) + 1e-9)
        step = lsq_linear(matrix, target, bounds).x
        try:
            trial = self.at(self.inside(on_grid(now.x + step, _LOGARITHM_GRID)))
        except VerificationError:
            return None
        return trial if trial.cost < now.cost else None

    def _durations(self, x: Array) -> Array:
        """Durations of every share of every leg, in coarse steps."""
        flown = predict(self._coarse, self._profile.orders(_speeds_mps(x[:-1])))
        return np.diff(self._profile.passed_s(flown).ravel(), prepend=0.0)


def _speeds_mps(logarithms: Array) -> Array:
    return on_grid(np.exp(logarithms), _SPEED_GRID)
