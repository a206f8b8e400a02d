"""What can befall a vehicle's body, and when: motors, sensors, battery, strength, the air around it.

Knows: kinds of breakdown as intervals of simulated time, and one schedule per vehicle. Does not know: who asks for
them (command line, scenario, MAVLink), nor links and missions, whose faults are another file's.

    airframes.faults[row].add(GnssOutage(from_s=30.0, until_s=45.0))
    airframes.faults[row].add(MotorLoss(from_s=airframes.t_s, motor=2, share=0.3))
    airframes.faults[row].clear()

`from_s` and `until_s` count simulated seconds from the construction of the fleet; what lies in the past counts from
now on. The same schedule gives the same flight, bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from gcs.physics.quadrotor import Array
from sim_bridge.dynamics.body.plant import Mask

ROTORS = 4


class Sensor(IntEnum):
    """What can get stuck; the value is the column of `Effects.stuck`."""

    GYRO = 0
    ACCELEROMETER = 1
    COMPASS = 2
    BAROMETER = 3
    GNSS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Failure:
    """Something that is wrong from `from_s` until `until_s`, in simulated time. Raises ValueError for nonsense."""

    from_s: float
    until_s: float = math.inf

    def __post_init__(self) -> None:
        if not self.from_s < self.until_s:
            raise ValueError(f"{type(self).__name__} ends at {self.until_s:g} s, before it begins at {self.from_s:g} s")


@dataclass(frozen=True, slots=True, kw_only=True)
class GnssOutage(Failure):
    """No fix at all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GnssJump(Failure):
    """Every fix lies off by so much, as with multipath."""

    offset_ned_m: tuple[float, float, float]

    def __post_init__(self) -> None:
        Failure.__post_init__(self)
        if not all(map(math.isfinite, self.offset_ned_m)):
            raise ValueError(f"GnssJump by {self.offset_ned_m} m is not a place")


@dataclass(frozen=True, slots=True, kw_only=True)
class StuckSensor(Failure):
    """A sensor repeats its last sample."""

    sensor: Sensor


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorLoss(Failure):
    """A motor (1 to 4, as Eq. 2 numbers them) gives this share of its thrust less; 1 is a motor that stands."""

    motor: int
    share: float = 1.0

    def __post_init__(self) -> None:
        Failure.__post_init__(self)
        if self.motor not in range(1, ROTORS + 1) or not 0.0 <= self.share <= 1.0:
            raise ValueError(f"MotorLoss of motor {self.motor} by {self.share:g}: motors are 1 to 4, shares 0 to 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class LowBattery(Failure):
    """At `from_s` the battery has no more than this share of its charge left; `until_s` means nothing."""

    remaining: float = 0.15

    def __post_init__(self) -> None:
        Failure.__post_init__(self)
        if not 0.0 <= self.remaining <= 1.0:
            raise ValueError(f"LowBattery with {self.remaining:g} left: a share lies between 0 and 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class Slow(Failure):
    """The vehicle flies no faster over ground than this, whatever it is asked."""

    speed_mps: float

    def __post_init__(self) -> None:
        Failure.__post_init__(self)
        if not self.speed_mps > 0.0:
            raise ValueError(f"Slow at {self.speed_mps:g} m/s would never arrive: give a speed above 0")


@dataclass(frozen=True, slots=True, kw_only=True)
class WindStep(Failure):
    """The air around the vehicle moves by so much more than the fleet's wind says."""

    wind_ned_mps: tuple[float, float, float]

    def __post_init__(self) -> None:
        Failure.__post_init__(self)
        if not all(map(math.isfinite, self.wind_ned_mps)):
            raise ValueError(f"WindStep by {self.wind_ned_mps} m/s is no wind")


@dataclass(frozen=True, slots=True, kw_only=True)
class Push(Failure):
    """Something pushes the vehicle, evenly over its mass, so that its accelerometer feels it as it feels drag."""

    push_ned_mps2: tuple[float, float, float]

    def __post_init__(self) -> None:
        Failure.__post_init__(self)
        if not all(map(math.isfinite, self.push_ned_mps2)):
            raise ValueError(f"Push by {self.push_ned_mps2} m/s² is no push")


class Schedule:
    """The breakdowns of one vehicle."""

    def __init__(self, board: Failures) -> None:
        self._board = board
        self._all: list[Failure] = []

    def add(self, breakdown: Failure) -> None:
        """Let this happen, from its time on; at once if that has come."""
        self._all.append(breakdown)
        self._board.due_s = -math.inf

    def clear(self) -> None:
        """Mend everything. A battery stays as empty as it is."""
        self._all.clear()
        self._board.due_s = -math.inf

    def active(self, t_s: float) -> list[Failure]:
        """What is wrong at `t_s`, in the order it was added."""
        return [b for b in self._all if b.from_s <= t_s < b.until_s]

    def __iter__(self) -> Iterator[Failure]:
        return iter(self._all)

    def __len__(self) -> int:
        return len(self._all)


@dataclass(slots=True)
class Effects:
    """What all that is wrong at one instant amounts to, as arrays for the physics."""

    motor_strength: Array  # (V, 4) share of the thrust that is left
    gnss_lost: Mask  # (V,)
    gnss_offset_ned_m: Array  # (V, 3)
    stuck: Mask  # (V, 5), columns as in `Sensor`
    speed_max_mps: Array  # (V,)
    wind_ned_mps: Array  # (V, 3) beyond the fleet's wind
    push_ned_mps2: Array  # (V, 3)
    drained: dict[int, float] = field(default_factory=dict)  # row -> share of the charge it has left at most
    sound: bool = True  # nothing is wrong with anybody

    @classmethod
    def none(cls, vehicles: int) -> Effects:
        """Nothing is wrong."""
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
    """The schedules of V vehicles by row, and when they next change anything (`due_s`)."""

    def __init__(self, vehicles: int) -> None:
        self._schedules = [Schedule(self) for _ in range(vehicles)]
        self._struck: dict[int, LowBattery] = {}  # by identity: each drains a battery once
        self.due_s = math.inf

    def __getitem__(self, row: int) -> Schedule:
        return self._schedules[row]

    def __len__(self) -> int:
        return len(self._schedules)

    def effects(self, t_s: float) -> Effects:
        """What is wrong at `t_s`; moves `due_s` to the next change."""
        effects = Effects.none(len(self))
        for row, schedule in enumerate(self._schedules):
            for breakdown in schedule.active(t_s):
                self._add(effects, row, breakdown)
        edges = (edge for schedule in self._schedules for b in schedule for edge in (b.from_s, b.until_s))
        self.due_s = min((edge for edge in edges if edge > t_s), default=math.inf)
        return effects

    def _add(self, effects: Effects, row: int, breakdown: Failure) -> None:
        effects.sound = False
        match breakdown:
            case GnssOutage():
                effects.gnss_lost[row] = True
            case GnssJump(offset_ned_m=offset):
                effects.gnss_offset_ned_m[row] += offset
            case StuckSensor(sensor=sensor):
                effects.stuck[row, sensor] = True
            case MotorLoss(motor=motor, share=share):
                effects.motor_strength[row, motor - 1] *= 1.0 - share
            case Slow(speed_mps=speed):
                effects.speed_max_mps[row] = min(effects.speed_max_mps[row], speed)
            case WindStep(wind_ned_mps=wind):
                effects.wind_ned_mps[row] += wind
            case Push(push_ned_mps2=push):
                effects.push_ned_mps2[row] += push
            case LowBattery(remaining=remaining) if id(breakdown) not in self._struck:
                self._struck[id(breakdown)] = breakdown
                effects.drained[row] = min(effects.drained.get(row, 1.0), remaining)
