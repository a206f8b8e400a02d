"""The reference trajectory that one vehicle flies: a planned path, or a stream of setpoints."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gcs.types import Array
from sim_bridge.autopilot.guidance.piece import Mark, Piece, PiecePath, hold
from sim_bridge.autopilot.guidance.stream import SetpointFollower, StampedSetpoint


@dataclass(frozen=True)
class Passed:
    """What happened since the last step."""

    marks: tuple[Mark, ...] = ()
    landing: bool = False  # the descent of a landing begins
    ended: bool = False  # the path has been flown to its end


NOTHING_PASSED = Passed()


class Flightpath:
    """`piece` is flown now, `planned` is the path it belongs to.

    The last setpoint of a stream is extrapolated for a second, unless `extrapolate` says otherwise.
    """

    def __init__(self, place: Array, stop: Callable[[float, Array], PiecePath]) -> None:
        """Stand at `place` (4,). `stop` returns the path that brakes from a motion (DERIVATIVES, 4) to rest."""
        self.piece: Piece = hold(0.0, place)
        self.planned = PiecePath(())
        self._extrapolate_s = 1.0
        self.streaming = False
        self._stop = stop
        self._pieces: list[Piece] = []  # still to come, last first
        self._marks: list[Mark] = []
        self._stream: SetpointFollower | None = None
        self._landing_s = math.inf
        self._wake_s = math.inf
        self._target: Array | None = None

    def extrapolate(self, seconds: float) -> None:
        """Extrapolate the last setpoint of a stream for so long."""
        self._extrapolate_s = seconds

    @property
    def at_rest(self) -> bool:
        """Whether nothing is left to fly."""
        return not self.streaming and math.isinf(self.piece.end_s)

    @property
    def target(self) -> Array | None:
        """The position and yaw (4,) the vehicle was sent to, if the path is a flight to a position; else None."""
        return self._target

    @property
    def landing(self) -> bool:
        """Whether the descent of a landing is under way."""
        return self.planned.landing_from_s < math.inf and math.isinf(self._landing_s)

    def start(self, t_s: float, path: PiecePath, target: Array | None = None) -> None:
        """Fly a path; `target` (4,) is given if the path is a flight to a position."""
        self.planned = path
        self._target = target
        self._pieces, self._marks = list(reversed(path.pieces)), list(reversed(path.marks))
        self._landing_s = path.landing_from_s
        self._stream, self.streaming = None, False
        self.piece = self._pieces.pop()
        self._schedule_wake_up()

    def stand(self, t_s: float, place: Array) -> None:
        """Stay at `place` (4,)."""
        self.start(t_s, PiecePath((hold(t_s, place),)))

    def heads_for(self, target: Array, within_m: float) -> bool:
        """Whether the vehicle already flies to within `within_m` of `target` (4,), and within as many rad of yaw."""
        known = self._target
        if known is None or self.streaming:
            return False
        near = float(np.linalg.norm(known[:3] - target[:3])) <= within_m
        return near and abs(math.remainder(known[3] - target[3], math.tau)) <= within_m

    def follow(self, t_s: float, setpoint: StampedSetpoint) -> None:
        """Take a setpoint, whose time may lie ahead."""
        if self._stream is None:
            self._stream = SetpointFollower()
        self._stream.add(setpoint)
        if self._stream.next_s <= t_s or (self.streaming and self.piece.end_s != self._stream.next_s):
            self._fly_stream(t_s)
        self._wake_s = min(self._wake_s, self._stream.next_s)

    def awaits_setpoint_after_s(self, t_s: float) -> float | None:
        """The newest known time of a stamped stream, if the vehicle must extrapolate it from `t_s` on; else None."""
        stream = self._stream
        if stream is None or not (self.streaming or stream.next_s <= t_s):
            return None
        return stream.awaits_more_after_s(t_s)

    def step(self, t_s: float) -> Passed:
        """Advance to `t_s`; return what was passed."""
        if t_s < self._wake_s:
            return NOTHING_PASSED
        ended = False
        streams = self._stream is not None and (self.streaming or self._stream.next_s <= t_s)
        if self.piece.end_s <= t_s and not streams:
            while self.piece.end_s <= t_s and (self._pieces or self._next_section()):
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
        self._schedule_wake_up()
        return Passed(tuple(marks), landing, ended)

    def _next_section(self) -> bool:
        """Generate the next section of the path; return whether it has pieces."""
        known = self.planned
        more = next(known.continuation, None) if known.continuation is not None else None
        if more is None:
            return False
        self.planned = replace(more, continuation=known.continuation)
        self._pieces, self._marks = list(reversed(more.pieces)), [*reversed(more.marks), *self._marks]
        if more.landing_from_s != known.landing_from_s:
            self._landing_s = more.landing_from_s
        return bool(self._pieces)

    def _fly_stream(self, t_s: float) -> None:
        stream = self._stream
        assert stream is not None
        if not self.streaming:
            self._pieces, self._marks, self.planned, self.streaming = [], [], PiecePath(()), True
            self._landing_s, self._target = math.inf, None
        stream.advance(t_s)
        piece = stream.piece(self._extrapolate_s)
        if piece is not None and piece.end_s > t_s:
            self.piece = piece
            self._schedule_wake_up()
        else:
            at = piece if piece is not None else self.piece
            self.start(t_s, self._stop(t_s, at.at(t_s)))

    def _schedule_wake_up(self) -> None:
        self._wake_s = min(
            self.piece.end_s,
            self._marks[-1].t_s if self._marks else math.inf,
            self._stream.next_s if self._stream is not None else math.inf,
            self._landing_s,
        )
