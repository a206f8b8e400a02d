"""The predicted flight of a mission by a model of its autopilot: corners cut, speeds reached late or not at all.

`gcs.autopilots.waypoint_models` holds the models; they fly several legs at once. `planned_flight` flies all other
commands.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gcs.autopilots.traits import Autopilot
from gcs.autopilots.waypoint_models.navigator import UNLIMITED, Ability, NavigatorOrders, vector
from gcs.autopilots.waypoint_models.predict import Prediction, predict
from gcs.errors import VerificationError
from gcs.mission.flight_limits import Surroundings
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.model import MissionItem
from gcs.mission.predicted.planned_flight import Flying, PredictedFlight
from gcs.mission.waypoints.placement import Deviation, SampledFlight, fewest_indices
from gcs.types import Array

_STEP_S = 0.1  # between knots: an autopilot's acceleration bends a line by some millimetres in that time
_BENT_M = 0.004  # a knot is left out if the flight without it differs by less
_CUBIC = 4.0 / 27.0  # the most of s (1 - s)^2 for s in [0, 1]
_NOWHERE_M = 1e-3
_LONGEST_S, _MOST = 3600.0, 1000  # flown at once: the model takes steps of some hundredths of a second
_ALIKE_M, _ALIKE_S = 0.05, 0.01  # legs of a formation differ through rounding by degE7 and float32
_CACHED_MAX = 24
_SETTLES_S = 3.0  # after its last corner a vehicle settles on the waypoint


@dataclass(frozen=True)
class _Segment:
    """Knots of legs flown at once: times and positions since their start, and the number of the leg's end.

    The bends and top speeds are those of the piece that ends at each knot.
    """

    t_s: Array
    moved_ned_m: Array
    stop: Array
    bends_m: Array
    top_mps: Array


class AutopilotFlight:
    """Predicts missions by the models of their autopilots. Legs that vehicles have in common are flown once."""

    def __init__(
        self,
        ability: Ability = UNLIMITED,
        climb_s: Mapping[Autopilot, float] | None = None,
        reaction: int | None = None,
    ) -> None:
        """For vehicles with this ability, which leave the ground `climb_s` before the hover, all of one autopilot.

        With a `reaction`, autopilots react as that one of `Navigator.reactions`.
        """
        self._ability = ability
        self._reaction = reaction
        self.climb_s = climb_s or {}
        self._flown: list[tuple[Autopilot, NavigatorOrders, _Segment]] = []

    @property
    def others(self) -> tuple[AutopilotFlight, ...]:
        """The same with both ends of what the autopilots may do."""
        return tuple(AutopilotFlight(self._ability, self.climb_s, reaction) for reaction in (0, -1))

    def __call__(self, mission: MissionFile, around: Surroundings) -> PredictedFlight:
        """The predicted flight, which starts at time 0."""
        return _Modelled(mission, around, modelled=self).run()

    def segment(self, firmware: Autopilot, orders: NavigatorOrders) -> _Segment:
        """The flight of these orders. Raises `VerificationError` if the model does not complete them."""
        for known, others, segment in self._flown:
            if known is firmware and _alike(orders, others):
                return replace(segment, bends_m=segment.bends_m + _apart_m(orders, others))
        navigator = firmware.navigator.within(self._ability)
        if self._reaction is not None and navigator.reactions:
            navigator = navigator.reactions[self._reaction]
        flown = predict(navigator, orders)
        last = len(flown.t_s) - 1
        rows = np.unique([0, *np.flatnonzero(np.diff(np.floor(flown.t_s / _STEP_S)) > 0) + 1, last])
        stop = np.minimum(np.searchsorted(flown.completed_s, flown.t_s[rows]), orders.count - 1)
        moved = flown.position_ned_m[rows] - np.array(orders.start_ned_m)
        kept = _bends(flown.t_s[rows], moved, stop)
        steps = rows[kept]
        bent_m = np.append(0.0, bends_m(flown, steps))
        top_mps = np.append(np.zeros((1, 3)), fastest_mps(flown, steps), axis=0)
        segment = _Segment(flown.t_s[steps], moved[kept], stop[kept], bent_m, top_mps)
        self._flown = [*self._flown[-_CACHED_MAX:], (firmware, orders, segment)]
        return segment


def _alike(one: NavigatorOrders, other: NavigatorOrders) -> bool:
    if one.count != other.count or one.speeds_mps != other.speeds_mps:
        return False
    if not np.allclose((*one.holds_s, one.airborne_s), (*other.holds_s, other.airborne_s), rtol=0, atol=_ALIKE_S):
        return False
    return _apart_m(one, other) <= _ALIKE_M


def _apart_m(one: NavigatorOrders, other: NavigatorOrders) -> float:
    """The largest distance between waypoints of two vehicles, each relative to the vehicle's start."""
    first, second = (np.array(orders.waypoints_ned_m) - np.array(orders.start_ned_m) for orders in (one, other))
    return float(np.max(np.linalg.norm(second - first, axis=1)))


def _bends(t_s: Array, places: Array, stop: Array) -> list[int]:
    """Indices of the knots to keep: those that bend the flight, and those at which a leg ends."""
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
    """A position to fly to, the speed to it, and the hold there."""

    place: Array
    speed_mps: float
    hold_s: float
    index: int


@dataclass
class _Modelled(Flying):
    """Collects waypoints until another command comes, and has the model fly them at once."""

    modelled: AutopilotFlight = field(default_factory=AutopilotFlight)
    pending: list[_Stop] = field(default_factory=list)
    last_place: Array | None = None  # the waypoint to settle on

    def _visit(self, place: Array, index: int, hold_s: float, *, along_ground: bool) -> None:
        if along_ground and self.around.ground is not None:
            self._fly_pending()
            super()._visit(place, index, hold_s, along_ground=True)
            return
        last = self.pending[-1].place if self.pending else self.here
        if np.linalg.norm(place - last) < _NOWHERE_M:
            self._wait(hold_s, index)
        else:
            self.pending.append(_Stop(place, self.speed_mps, _finite(hold_s), index))

    def _wait(self, seconds: float, index: int) -> None:
        if not self.pending:
            super()._wait(seconds, index)
        else:
            last = self.pending[-1]
            self.pending[-1] = _Stop(last.place, last.speed_mps, last.hold_s + _finite(seconds), last.index)

    def _fly_pending(self) -> None:
        stops, self.pending = self.pending, []
        if not stops:
            return
        if self.up_s is None:
            self.up_s = self.t_s
        orders = NavigatorOrders(
            vector(*self.here),
            tuple(vector(*stop.place) for stop in stops),
            tuple(stop.speed_mps for stop in stops),
            tuple(stop.hold_s for stop in stops),
            self.t_s - self.up_s + self.modelled.climb_s.get(self.mission.firmware, 0.0),
        )
        why = _too_long(orders)
        try:
            segment = None if why else self.modelled.segment(self.mission.firmware, orders)
        except VerificationError as error:
            segment, why = None, error.message
        if segment is None:
            self.remarks[stops[0].index] = f"flown at planned speeds, not by the model: {why}"
            for stop in stops:
                self.speed_mps = stop.speed_mps
                super()._go(stop.place, stop.index)
                super()._wait(stop.hold_s, stop.index)
            return
        begin_s, begin = self.t_s, self.here
        for row, (t_s, number) in enumerate(zip(segment.t_s.tolist(), segment.stop.tolist(), strict=True)):
            self.t_s, self.here = begin_s + t_s, begin + segment.moved_ned_m[row]
            self._knot(stops[number].index)
            if row:
                self.bends[len(self.knots) - 1] = float(segment.bends_m[row]), segment.top_mps[row]
        self.last_place = stops[-1].place

    def _hold(self, seconds: float, index: int) -> None:
        super()._hold(seconds - self._settle_on_waypoint(index, seconds), index)

    def _land(self, item: MissionItem, index: int) -> None:
        self._fly_pending()
        self._settle_on_waypoint(index, _SETTLES_S)
        place = self._place(index)
        if np.linalg.norm(place[:2] - self.here[:2]) < _ALIKE_M:
            self.here = np.array([*place[:2], self.here[2]])
        super()._land(item, index)

    def _return(self, index: int) -> None:
        self._fly_pending()
        self._settle_on_waypoint(index, _SETTLES_S)
        super()._return(index)

    def _settle_on_waypoint(self, index: int, seconds: float) -> float:
        """Settle on the last waypoint if there is time; the time taken, s."""
        place, self.last_place = self.last_place, None
        if place is None or seconds < _SETTLES_S:
            return 0.0
        self.t_s += _SETTLES_S
        self.here = place
        self._knot(index)
        return _SETTLES_S


def _finite(seconds: float) -> float:
    """The wait, or 0 if it is not a positive number."""
    return seconds if math.isfinite(seconds) and seconds > 0.0 else 0.0


def _too_long(orders: NavigatorOrders) -> str:
    """Why the model does not fly these orders; empty if it does."""
    points = np.array([orders.start_ned_m, *orders.waypoints_ned_m])
    planned_s = float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1) / orders.speeds_mps) + sum(orders.holds_s))
    if planned_s > _LONGEST_S or orders.count > _MOST:
        return f"{orders.count} waypoints in {planned_s:.0f} s; limit {_MOST} waypoints and {_LONGEST_S:.0f} s"
    return ""


def bends_m(flown: Prediction, steps: NDArray[np.intp]) -> Array:
    """The largest distances (N - 1,) from the straight pieces between these steps (N,), at the same instant."""
    t_s, places = flown.t_s, flown.position_ned_m
    straight = np.stack([np.interp(t_s, t_s[steps], places[steps, axis]) for axis in range(3)], axis=-1)
    away_m = np.linalg.norm(places - straight, axis=1)
    step_s, mean_mps = _steps(flown)
    turns_mps = np.linalg.norm(flown.velocity_ned_mps[:-1] - mean_mps, axis=1)
    turns_mps += np.linalg.norm(flown.velocity_ned_mps[1:] - mean_mps, axis=1)
    between_m = np.maximum(away_m[:-1], away_m[1:]) + _CUBIC * step_s * turns_mps
    return np.asarray(np.maximum.reduceat(between_m, steps[:-1]))


def fastest_mps(flown: Prediction, steps: NDArray[np.intp]) -> Array:
    """The highest speeds (N - 1, 3) along each axis on the pieces between these steps (N,)."""
    _, mean_mps = _steps(flown)
    before, after = flown.velocity_ned_mps[:-1], flown.velocity_ned_mps[1:]
    # The velocity of a cubic lies between these three: its coefficients by Bernstein.
    most = np.max(np.abs([before, 3.0 * mean_mps - before - after, after]), axis=0)
    return np.asarray(np.maximum.reduceat(most, steps[:-1], axis=0))


def _steps(flown: Prediction) -> tuple[Array, Array]:
    step_s = np.diff(flown.t_s)
    return step_s, np.diff(flown.position_ned_m, axis=0) / step_s[:, None]
