"""The same missions as autopilots really fly them: corners cut or braked for, speeds reached late or not at all.

Knows: which stretches of a mission a navigator flies in one go. Does not know: navigators (`navigator`), what other
commands do (`flown`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from gcs.errors import VerificationError
from gcs.mission.firmware import Firmware
from gcs.mission.flown import Flight, Flying, Surroundings
from gcs.mission.missionfile import LoadedMission
from gcs.mission.navigator.fitted import by_name
from gcs.mission.navigator.orders import Orders, vector
from gcs.mission.navigator.predict import predict
from gcs.quadrotor import Array

_STEP_S = 0.2  # between knots: an autopilot's accelerations bend a line by a centimetre in that time
_NOWHERE_M = 1e-3
_LONGEST_S, _MOST = 3600.0, 1000  # of what is flown in one go: the model takes steps of some hundredths of a second


def fly_modelled(mission: LoadedMission, around: Surroundings) -> Flight:
    """The mission as the model of its autopilot flies it, from the start at time 0."""
    return _Modelled(mission, around).run()


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

    waiting: list[_Stop] = field(default_factory=list)

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
        orders = Orders(
            vector(*self.here),
            tuple(vector(*stop.place) for stop in stops),
            tuple(stop.speed_mps for stop in stops),
            tuple(stop.hold_s for stop in stops),
            self.t_s - self.up_s,
        )
        name = "ardupilot" if self.mission.firmware is Firmware.ARDUPILOT else "px4"
        why = _too_long(orders)
        try:
            flown = None if why else predict(by_name(name), orders)
        except VerificationError as error:
            flown, why = None, error.message
        if flown is None:
            self.remarks[stops[0].index] = f"flown at planned speeds: {why}"
            for stop in stops:
                self.speed_mps = stop.speed_mps
                super()._go(stop.place, stop.index)
                super()._wait(stop.hold_s, stop.index)
            return
        begin_s = self.t_s
        kept = np.append(np.flatnonzero(np.diff(np.floor(flown.t_s / _STEP_S)) > 0) + 1, len(flown.t_s) - 1)
        numbers = np.minimum(np.searchsorted(flown.completed_s, flown.t_s[kept]), len(stops) - 1)
        for row, number in zip(kept.tolist(), numbers.tolist(), strict=True):
            self.t_s, self.here = begin_s + float(flown.t_s[row]), flown.position_ned_m[row]
            self._knot(stops[number].index)


def _finite(seconds: float) -> float:
    """A wait that ends; none where the file names no number."""
    return seconds if math.isfinite(seconds) and seconds > 0.0 else 0.0


def _too_long(orders: Orders) -> str:
    """Why the model is not asked; empty if it is."""
    points = np.array([orders.start_ned_m, *orders.waypoints_ned_m])
    asked_s = float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1) / orders.speeds_mps) + sum(orders.holds_s))
    if asked_s > _LONGEST_S or orders.count > _MOST:
        return f"{orders.count} waypoints in {asked_s:.0f} s are too many for the model of the autopilot"
    return ""
