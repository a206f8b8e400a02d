"""How vehicles break a flight off, and where that brings them: brake straight on, then hold, or land on the spot.

A vehicle that breaks off at s with the velocity v is after t at p(s) + h(v, t), with h = (t - a t² / 2|v|) v until it
rests at |v| / a. The matrix of h's derivatives by v is symmetric; none of its eigenvalues is above min(t, |v| / a). So
two velocities whose difference is d lead at equal times to places of which the differences are d min(t, |v| / a) apart
at most, also where a vehicle stands and the direction of v is not known.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from gcs.errors import UsageError
from gcs.mission.proving.track import FleetMotion
from gcs.plan.verification.proof.subdivision import Constraint, Rows
from gcs.plan.verification.proof.taylor import Taylor
from gcs.plan.verification.proof.verdict import LENGTH_TOLERANCE_M
from gcs.types import Array

Manoeuvre = Literal["hold", "land", "return"]
MANOEUVRES: tuple[Manoeuvre, ...] = ("hold", "land", "return")
BROKEN_OFF = Constraint(LENGTH_TOLERANCE_M, 0.01)  # a margin to a centimetre: there are two times to divide
RETURNED = Constraint(LENGTH_TOLERANCE_M, 0.01, relative=0.5)  # there are many boxes: half of a margin is enough
_TINY_MPS = 1e-12


@dataclass(frozen=True)
class BreakOff:
    """What all vehicles do when a flight is broken off, all at the same instant.

    They brake straight on to rest with `brake_mps2`. Then they hold, or land: descend on the spot at any speeds up to
    `sink_mps`; or return as the ground station returns the vehicles of a plan, which says how.

    Raises `UsageError` for a number that is not above 0.
    """

    manoeuvre: Manoeuvre
    brake_mps2: float = 1.5  # as Skein's own returns and holds
    sink_mps: float = 1.5

    def __post_init__(self) -> None:
        if self.manoeuvre not in MANOEUVRES:
            raise UsageError(f"{self.manoeuvre} is no way to break off", hint=f"give {' or '.join(MANOEUVRES)}")
        for name in ("brake_mps2", "sink_mps"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise UsageError(f"{name} is {value}", hint="give a number above 0")

    @property
    def lands(self) -> bool:
        """Whether vehicles descend when they rest."""
        return self.manoeuvre == "land"


@dataclass(frozen=True, eq=False)
class Braking:
    """Brakes of M vehicles that begin in spans of time: the middle one, and how far the others are from it."""

    place: Taylor  # (3, M) where they begin, NED
    velocity: Taylor  # (3, M) with which they begin
    brake_mps2: float

    @classmethod
    def of(cls, motion: FleetMotion, row: Rows, start_s: Array, end_s: Array, brake_mps2: float) -> Braking:
        """Brakes of vehicles (M,) that begin in spans (M,), each within one interval of the motion."""
        place, velocity = (motion.enclosed(row, start_s, end_s, derivative) for derivative in (0, 1))
        return cls(place, velocity, brake_mps2)

    @property
    def rest_s(self) -> tuple[Array, Array]:
        """Times (M,) after which none and all of the brakes of a span have ended."""
        speed = np.linalg.norm(self.velocity.middle, axis=0)
        return np.maximum(speed - self._spread_mps, 0.0) / self.brake_mps2, self._fastest_mps / self.brake_mps2

    @property
    def _spread_mps(self) -> Array:
        return np.asarray(np.linalg.norm(self.velocity.deviation(), axis=0))

    @property
    def _fastest_mps(self) -> Array:
        return np.asarray(np.linalg.norm(self.velocity.size(), axis=0))

    def run_m(self, after_s: Array) -> Array:
        """How far (3, M) the middle one has come."""
        return self.velocity.middle * run_s(np.linalg.norm(self.velocity.middle, axis=0), after_s, self.brake_mps2)

    def speed_mps(self, after_s: Array) -> Array:
        """The velocity (3, M) of the middle one."""
        speed = np.maximum(np.linalg.norm(self.velocity.middle, axis=0), _TINY_MPS)
        return np.asarray(self.velocity.middle * np.maximum(1.0 - self.brake_mps2 * after_s / speed, 0.0))

    def spread_m(self, after_s: Array) -> Array:
        """How far (M,) the runs of others are from that of the middle one, at equal times up to `after_s`."""
        return np.asarray(self._spread_mps * np.minimum(after_s, self.rest_s[1]))

    def share(self, begin: Array, end: Array) -> Taylor:
        """Places (3, M) at all shares of the way to rest from `begin` to `end` (M,)."""
        way = self.run_m(np.full(begin.shape, np.inf))
        return self._around(way * (0.5 * (begin + end)), np.abs(way) * (0.5 * (end - begin)), np.inf)

    def enclosed(self, begin_s: Array, until_s: Array) -> Taylor:
        """Places (3, M) at all times from `begin_s` to `until_s` (M,) after the breaking off."""
        middle = self.run_m(0.5 * (begin_s + until_s))
        steps = [np.abs(self.run_m(at_s) - middle) for at_s in (begin_s, until_s)]
        return self._around(middle, np.maximum(*steps), until_s)

    def _around(self, run: Array, off: Array, until_s: Array | float) -> Taylor:
        found = self.place + run
        return Taylor(found.c, found.remainder + off + self.spread_m(np.asarray(until_s)))

    def against_m(self, other: Braking, after_s: Array) -> Array:
        """How far (M,) the runs of two vehicles differ at equal times up to `after_s`."""
        apart_mps = np.linalg.norm((self.velocity - other.velocity).size(), axis=0)
        return np.asarray(apart_mps * np.minimum(after_s, np.maximum(self.rest_s[1], other.rest_s[1])))


def run_s(speed_mps: Array, after_s: Array, brake_mps2: float) -> Array:
    """The time (...) in which a vehicle would come as far at its first speed as it comes braking in `after_s`."""
    braked_s = np.minimum(after_s, speed_mps / brake_mps2)
    return np.asarray(braked_s - brake_mps2 * braked_s**2 / (2.0 * np.maximum(speed_mps, _TINY_MPS)))
