"""The same missions as autopilots really fly them: corners cut or braked for, speeds reached late or not at all.

Knows: which stretches of a mission a navigator flies in one go, that a formation's vehicles fly the same legs. Does not
know: navigators (`navigator`), what other commands do (`flown`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from gcs.autopilots.navigation.navigator import UNLIMITED, Ability, NavigatorOrders, vector
from gcs.autopilots.navigation.predict import predict
from gcs.autopilots.traits import Autopilot
from gcs.errors import VerificationError
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.model import MissionItem
from gcs.mission.predicted.planned_flight import Flying, PredictedFlight, Surroundings
from gcs.mission.waypoints.placement import Deviation, SampledFlight, fewest_indices
from gcs.physics.quadrotor import Array

_STEP_S = 0.2  # between knots: an autopilot's accelerations bend a line by a centimetre in that time
_BENT_M = 0.01  # knots that are nearer to where the vehicle would be without them are left out
_NOWHERE_M = 1e-3
_LONGEST_S, _MOST = 3600.0, 1000  # of what is flown in one go: the model takes steps of some hundredths of a second
_ALIKE_M, _ALIKE_S = 0.03, 0.01  # legs of a formation differ by what degE7 and float32 round
_KEPT = 24
_SETTLES_S = 3.0  # after the last waypoint a vehicle creeps on to it


@dataclass(frozen=True)
class _Way:
    """Knots of a stretch flown from a place: times since, places from there, numbers of the stops flown to."""

    t_s: Array
    moved_ned_m: Array
    stop: Array


class AutopilotFlight:
    """Flies missions as the models of their autopilots do, each stretch that vehicles have in common once."""

    def __init__(self, ability: Ability = UNLIMITED, climb_s: float = 0.0) -> None:
        """For vehicles that can do no more than `ability` and all leave the ground `climb_s` before the hover."""
        self._ability = ability
        self.climb_s = climb_s
        self._flown: list[tuple[Autopilot, NavigatorOrders, _Way]] = []

    def __call__(self, mission: MissionFile, around: Surroundings) -> PredictedFlight:
        """The mission as the model of its autopilot flies it, from the start at time 0."""
        return _Modelled(mission, around, modelled=self).run()

    def way(self, firmware: Autopilot, orders: NavigatorOrders) -> _Way:
        """Fly orders. Raises `VerificationError` where they lead nowhere."""
        for known, others, way in self._flown:
            if known is firmware and _alike(orders, others):
                return way
        flown = predict(firmware.navigator.within(self._ability), orders)
        rows = np.append(np.flatnonzero(np.diff(np.floor(flown.t_s / _STEP_S)) > 0) + 1, len(flown.t_s) - 1)
        rows = np.concatenate([[0], rows[rows > 0]])
        stop = np.minimum(np.searchsorted(flown.completed_s, flown.t_s[rows]), orders.count - 1)
        moved = flown.position_ned_m[rows] - np.array(orders.start_ned_m)
        kept = _bends(flown.t_s[rows], moved, stop)
        way = _Way(flown.t_s[rows][kept], moved[kept], stop[kept])
        self._flown = [*self._flown[-_KEPT:], (firmware, orders, way)]
        return way


def fly_modelled(mission: MissionFile, around: Surroundings) -> PredictedFlight:
    """One mission as the model of its autopilot flies it."""
    return AutopilotFlight()(mission, around)


def _alike(one: NavigatorOrders, other: NavigatorOrders) -> bool:
    if one.count != other.count or one.speeds_mps != other.speeds_mps:
        return False
    if not np.allclose((*one.holds_s, one.airborne_s), (*other.holds_s, other.airborne_s), rtol=0, atol=_ALIKE_S):
        return False
    places = [np.array(orders.waypoints_ned_m) - np.array(orders.start_ned_m) for orders in (one, other)]
    return bool(np.allclose(places[0], places[1], rtol=0, atol=_ALIKE_M))


def _bends(t_s: Array, places: Array, stop: Array) -> list[int]:
    """Knots that are needed, and those at which the next stop is flown to."""
    limits = Deviation(math.inf, _BENT_M)
    turns = [0, *(np.flatnonzero(np.diff(stop)) + 1).tolist(), len(t_s) - 1]
    kept = [0]
    for begin, end in pairwise(turns):
        part = SampledFlight(t_s[begin : end + 1], places[None, begin : end + 1])
        if end > begin:
            kept += [begin + i for i in fewest_indices(part, limits)[1:]]
    return kept


@dataclass(frozen=True)
class _Stop:
    """A place to be flown to."""

    place: Array
    speed_mps: float
    hold_s: float
    index: int


@dataclass
class _Modelled(Flying):
    """Puts waypoints off until something else comes, and flies them in one go."""

    modelled: AutopilotFlight = field(default_factory=AutopilotFlight)
    waiting: list[_Stop] = field(default_factory=list)
    resting: Array | None = None

    def _visit(self, place: Array, index: int, hold_s: float, *, along_ground: bool) -> None:
        if along_ground and self.around.ground is not None:
            self._settle()
            super()._visit(place, index, hold_s, along_ground=True)
            return
        last = self.waiting[-1].place if self.waiting else self.here
        if np.linalg.norm(place - last) < _NOWHERE_M:
            self._wait(hold_s, index)
        else:
            self.waiting.append(_Stop(place, self.speed_mps, _finite(hold_s), index))

    def _wait(self, seconds: float, index: int) -> None:
        if not self.waiting:
            super()._wait(seconds, index)
        else:
            last = self.waiting[-1]
            self.waiting[-1] = _Stop(last.place, last.speed_mps, last.hold_s + _finite(seconds), last.index)

    def _settle(self) -> None:
        stops, self.waiting = self.waiting, []
        if not stops:
            return
        if self.up_s is None:
            self.up_s = self.t_s
        orders = NavigatorOrders(
            vector(*self.here),
            tuple(vector(*stop.place) for stop in stops),
            tuple(stop.speed_mps for stop in stops),
            tuple(stop.hold_s for stop in stops),
            self.t_s - self.up_s + self.modelled.climb_s,
        )
        why = _too_long(orders)
        try:
            way = None if why else self.modelled.way(self.mission.firmware, orders)
        except VerificationError as error:
            way, why = None, error.message
        if way is None:
            self.remarks[stops[0].index] = f"flown at planned speeds: {why}"
            for stop in stops:
                self.speed_mps = stop.speed_mps
                super()._go(stop.place, stop.index)
                super()._wait(stop.hold_s, stop.index)
            return
        begin_s, begin = self.t_s, self.here
        for t_s, moved, number in zip(way.t_s.tolist(), way.moved_ned_m, way.stop.tolist(), strict=True):
            self.t_s, self.here = begin_s + t_s, begin + moved
            self._knot(stops[number].index)
        self.resting = stops[-1].place

    def _rest(self, seconds: float, index: int) -> None:
        super()._rest(seconds - self._creep(index, seconds), index)

    def _land(self, item: MissionItem, index: int) -> None:
        self._settle()
        self._creep(index, _SETTLES_S)
        place = self._place(index)
        if np.linalg.norm(place[:2] - self.here[:2]) < _ALIKE_M:
            self.here = np.array([*place[:2], self.here[2]])
        super()._land(item, index)

    def _return(self, index: int) -> None:
        self._settle()
        self._creep(index, _SETTLES_S)
        super()._return(index)

    def _creep(self, index: int, seconds: float) -> float:
        """Come to rest at the last waypoint, if there is time; returns how long that took."""
        place, self.resting = self.resting, None
        if place is None or seconds < _SETTLES_S:
            return 0.0
        self.t_s += _SETTLES_S
        self.here = place
        self._knot(index)
        return _SETTLES_S


def _finite(seconds: float) -> float:
    """A wait that ends; none where the file names no number."""
    return seconds if math.isfinite(seconds) and seconds > 0.0 else 0.0


def _too_long(orders: NavigatorOrders) -> str:
    """Why the model is not asked; empty if it is."""
    points = np.array([orders.start_ned_m, *orders.waypoints_ned_m])
    asked_s = float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1) / orders.speeds_mps) + sum(orders.holds_s))
    if asked_s > _LONGEST_S or orders.count > _MOST:
        return f"{orders.count} waypoints in {asked_s:.0f} s are too many for the model of the autopilot"
    return ""
