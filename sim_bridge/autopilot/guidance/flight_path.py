"""What one vehicle flies now and next: a course worked out beforehand, or a stream of setpoints.

Knows: pieces and marks in their order, when a stream takes over and what follows when it dries up. Does not know:
modes, arming, why a course is flown.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gcs.physics.quadrotor import Array
from sim_bridge.autopilot.guidance.piece import Mark, Piece, PiecePath, hold
from sim_bridge.autopilot.guidance.stream import SetpointFollower, StampedSetpoint


@dataclass(frozen=True)
class Passed:
    """What lies behind the vehicle since the last look."""

    marks: tuple[Mark, ...] = ()
    landing: bool = False  # the descent of a landing begins
    ended: bool = False  # the course is flown to its end


NOTHING_PASSED = Passed()


class Flightpath:
    """`piece` is what is flown now, `course` where it comes from. `coast_s` is how long a last setpoint holds."""

    def __init__(self, place: Array, stop: Callable[[float, Array], PiecePath]) -> None:
        """Stand at `place` (4,); `stop` works out how to come to rest from a motion (DERIVATIVES, 4)."""
        self.piece: Piece = hold(0.0, place)
        self.course = PiecePath(())
        self.coast_s = 1.0
        self.streaming = False
        self._stop = stop
        self._pieces: list[Piece] = []  # still to come, last first
        self._marks: list[Mark] = []
        self._stream: SetpointFollower | None = None
        self._landing_s = math.inf
        self._wake_s = math.inf
        self._target: Array | None = None

    @property
    def at_rest(self) -> bool:
        """Whether nothing is left to fly."""
        return not self.streaming and math.isinf(self.piece.end_s)

    @property
    def target(self) -> Array | None:
        """The place (4,) it was sent to, if that is all there is to it."""
        return self._target

    @property
    def landing(self) -> bool:
        """Whether the descent of a landing is under way."""
        return self.course.landing_from_s < math.inf and math.isinf(self._landing_s)

    def start(self, t_s: float, course: PiecePath, target: Array | None = None) -> None:
        """Fly a course, to `target` (4,) if that is all there is to it."""
        self.course = course
        self._target = target
        self._pieces, self._marks = list(reversed(course.pieces)), list(reversed(course.marks))
        self._landing_s = course.landing_from_s
        self._stream, self.streaming = None, False
        self.piece = self._pieces.pop()
        self._sleep()

    def stand(self, t_s: float, place: Array) -> None:
        """Stay at `place` (4,)."""
        self.start(t_s, PiecePath((hold(t_s, place),)))

    def heads_for(self, target: Array, within_m: float) -> bool:
        """Whether it is on its way to a place as near to `target` (4,) as that."""
        known = self._target
        if known is None or self.streaming:
            return False
        near = float(np.linalg.norm(known[:3] - target[:3])) <= within_m
        return near and abs(math.remainder(known[3] - target[3], math.tau)) <= within_m

    def follow(self, t_s: float, setpoint: StampedSetpoint) -> None:
        """Take in a setpoint; its time may lie ahead."""
        if self._stream is None:
            self._stream = SetpointFollower()
        self._stream.add(setpoint)
        if self._stream.next_s <= t_s or (self.streaming and self.piece.end_s != self._stream.next_s):
            self._fly_stream(t_s)
        self._wake_s = min(self._wake_s, self._stream.next_s)

    def awaits_setpoint_after_s(self, t_s: float) -> float | None:
        """The newest instant it knows of, where it flies a stamped stream and has to guess how that goes on."""
        stream = self._stream
        if stream is None or not (self.streaming or stream.next_s <= t_s):
            return None
        return stream.awaits_more_after_s(t_s)

    def step(self, t_s: float) -> Passed:
        """Go on to `t_s`."""
        if t_s < self._wake_s:
            return NOTHING_PASSED
        ended = False
        streams = self._stream is not None and (self.streaming or self._stream.next_s <= t_s)
        if self.piece.end_s <= t_s and not streams:
            while self.piece.end_s <= t_s and (self._pieces or self._go_on()):
                self.piece = self._pieces.pop()
            if self.piece.end_s <= t_s:
                self.piece = hold(self.piece.end_s, self.piece.at(self.piece.end_s))
                ended = True
        marks = []
        while self._marks and self._marks[-1].t_s <= t_s:
            marks.append(self._marks.pop())
        landing = self._landing_s <= t_s
        if landing:
            self._landing_s = math.inf
        if streams:
            self._fly_stream(t_s)
        self._sleep()
        return Passed(tuple(marks), landing, ended)

    def _go_on(self) -> bool:
        """Have the next part of the course worked out; whether there are pieces in it."""
        known = self.course
        more = next(known.rest, None) if known.rest is not None else None
        if more is None:
            return False
        self.course = replace(more, rest=known.rest)
        self._pieces, self._marks = list(reversed(more.pieces)), [*reversed(more.marks), *self._marks]
        if more.landing_from_s != known.landing_from_s:
            self._landing_s = more.landing_from_s
        return bool(self._pieces)

    def _fly_stream(self, t_s: float) -> None:
        stream = self._stream
        assert stream is not None
        if not self.streaming:
            self._pieces, self._marks, self.course, self.streaming = [], [], PiecePath(()), True
            self._landing_s, self._target = math.inf, None
        stream.advance(t_s)
        piece = stream.piece(self.coast_s)
        if piece is not None and piece.end_s > t_s:
            self.piece = piece
            self._sleep()
        else:
            at = piece if piece is not None else self.piece
            self.start(t_s, self._stop(t_s, at.at(t_s)))

    def _sleep(self) -> None:
        self._wake_s = min(
            self.piece.end_s,
            self._marks[-1].t_s if self._marks else math.inf,
            self._stream.next_s if self._stream is not None else math.inf,
            self._landing_s,
        )
