"""Failures of a vehicle's body over simulated time: motors, sensors, battery, speed, wind and pushes.

    airframes.faults[row].add(Failure(from_s=30.0, until_s=45.0, gnss_lost=True))
    airframes.faults[row].add(Failure(from_s=airframes.t_s, motor=2, share=0.3))
    airframes.faults[row].clear()

`from_s` and `until_s` count simulated seconds from the construction of the fleet. A `from_s` in the past acts from
now on. The same schedule gives the same flight, bit for bit. `sim_bridge.faults` has the faults of links and missions.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from gcs.types import Array
from sim_bridge.dynamics.plant import Mask

ROTORS = 4


class Sensor(IntEnum):
    """The sensors that can get stuck; the value is the column of `Effects.stuck`."""

    GYRO = 0
    ACCELEROMETER = 1
    COMPASS = 2
    BAROMETER = 3
    GNSS = 4


_NONE = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Failure:
    """What fails from `from_s` until `until_s`, in simulated time. `fault_spec.make_fault` checks the values."""

    from_s: float
    until_s: float = math.inf
    gnss_lost: bool = False  # there is no fix
    offset_ned_m: tuple[float, float, float] = _NONE  # of every fix, as with multipath
    sensor: Sensor | None = None  # repeats its last sample
    motor: int = 0  # 1 to 4, numbered as in Eq. 2: loses this `share` of its thrust; at 1 it stands still
    share: float = 1.0
    remaining: float = 1.0  # at `from_s` the battery has at most this share of its charge left, whatever `until_s` is
    speed_mps: float = math.inf  # the ground speed is limited to this, whatever is commanded
    wind_ned_mps: tuple[float, float, float] = _NONE  # added to that of the fleet
    push_ned_mps2: tuple[float, float, float] = _NONE  # evenly over its mass: the accelerometer senses it like drag


class Schedule:
    """The failures of one vehicle."""

    def __init__(self, board: Failures) -> None:
        self._board = board
        self._all: list[Failure] = []

    def add(self, failure: Failure) -> None:
        """Add a failure; it acts from its time on, at once if that has passed."""
        self._all.append(failure)
        self._board.due_s = -math.inf

    def clear(self) -> None:
        """Remove all failures. A drained battery stays drained."""
        self._all.clear()
        self._board.due_s = -math.inf

    def active(self, t_s: float) -> list[Failure]:
        """Return the failures active at `t_s`, in the order they were added."""
        return [b for b in self._all if b.from_s <= t_s < b.until_s]

    def __iter__(self) -> Iterator[Failure]:
        return iter(self._all)

    def __len__(self) -> int:
        return len(self._all)


@dataclass(slots=True)
class Effects:
    """The combined effect of all failures at one time, as arrays for the physics."""

    motor_strength: Array  # (V, 4) remaining share of the thrust
    gnss_lost: Mask  # (V,)
    gnss_offset_ned_m: Array  # (V, 3)
    stuck: Mask  # (V, 5), columns as in `Sensor`
    speed_max_mps: Array  # (V,)
    wind_ned_mps: Array  # (V, 3) added to the fleet's wind
    push_ned_mps2: Array  # (V, 3)
    drained: dict[int, float] = field(default_factory=dict)  # row -> maximum remaining share of the charge
    sound: bool = True  # no vehicle has a failure

    @classmethod
    def none(cls, vehicles: int) -> Effects:
        """Return the effects of no failure."""
        return cls(
            motor_strength=np.ones((vehicles, ROTORS)),
            gnss_lost=np.zeros(vehicles, dtype=bool),
            gnss_offset_ned_m=np.zeros((vehicles, 3)),
            stuck=np.zeros((vehicles, len(Sensor)), dtype=bool),
            speed_max_mps=np.full(vehicles, math.inf),
            wind_ned_mps=np.zeros((vehicles, 3)),
            push_ned_mps2=np.zeros((vehicles, 3)),
        )


class Failures:
    """The schedules of V vehicles by row, and the time of the next change (`due_s`)."""

    def __init__(self, vehicles: int) -> None:
        self._schedules = [Schedule(self) for _ in range(vehicles)]
        self._struck: dict[int, Failure] = {}  # by id(): each drains a battery once
        self.due_s = math.inf

    def __getitem__(self, row: int) -> Schedule:
        return self._schedules[row]

    def __len__(self) -> int:
        return len(self._schedules)

    def effects(self, t_s: float) -> Effects:
        """Return the effects at `t_s`, and set `due_s` to the next change."""
        effects = Effects.none(len(self))
        for row, schedule in enumerate(self._schedules):
            for failure in schedule.active(t_s):
                effects.sound = False
                effects.gnss_lost[row] |= failure.gnss_lost
                effects.gnss_offset_ned_m[row] += failure.offset_ned_m
                if failure.sensor is not None:
                    effects.stuck[row, failure.sensor] = True
                if failure.motor:
                    effects.motor_strength[row, failure.motor - 1] *= 1.0 - failure.share
                effects.speed_max_mps[row] = min(effects.speed_max_mps[row], failure.speed_mps)
                effects.wind_ned_mps[row] += failure.wind_ned_mps
                effects.push_ned_mps2[row] += failure.push_ned_mps2
                if failure.remaining < 1.0 and id(failure) not in self._struck:
                    self._struck[id(failure)] = failure
                    effects.drained[row] = min(effects.drained.get(row, 1.0), failure.remaining)
        edges = (edge for schedule in self._schedules for b in schedule for edge in (b.from_s, b.until_s))
        self.due_s = min((edge for edge in edges if edge > t_s), default=math.inf)
        return effects
