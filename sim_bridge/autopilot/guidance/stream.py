"""Follows a stream of setpoints that carry their time.

Setpoints stamped ahead of time wait for their time, so a stream sent early is flown the same at any speed-up. From
one setpoint to the next the vehicle flies the parabola of acceleration through the last, the present and the next
one. Position, velocity and acceleration are reset at every setpoint; jerk and snap come from accelerations alone.
Positions cannot provide them: float32 at 1.5 km rounds to 0.1 mm, which is 10^4 m/s^4 at 25 Hz.
"""

import math
from bisect import insort
from dataclasses import dataclass, field

import numpy as np

from gcs.types import Array
from sim_bridge.autopilot.guidance.piece import TERMS, Piece

# Setpoints further apart than this are not interpolated.
LONGEST_GAP_S = 1.0
# A stream of which no setpoint came early for so long is sent just in time, and is extrapolated for so long. A vehicle
# that stopped at every setpoint would be as slow as the ground station takes it to be, and it would take it to be ever
# slower. At a jerk of 5 m/s3 the extrapolation is off by 7 mm.
_EARLY_S, _REMEMBERED_S = 0.1, 2.0
JUST_IN_TIME_S = 0.2
_KEPT_AHEAD = 256


@dataclass(frozen=True, slots=True, order=True)
class StampedSetpoint:
    """One setpoint in simulated time and the common local NED frame; columns north, east, down, yaw.

    `flat` (3, 4): position and yaw; velocity and yaw rate; acceleration and zero. `arrived_s` is when it came, by
    default long before its time.
    """

    t_s: float
    flat: Array = field(compare=False)
    stamped: bool = field(compare=False, default=True)
    arrived_s: float = field(compare=False, default=-math.inf)


class StreamTiming:
    """Whether a stream is sent ahead of its times, or just in time. All times are the vehicle's."""

    def __init__(self) -> None:
        self._early_s = -math.inf  # the newest stamp that came early

    def arrived(self, stamp_s: float, t_s: float) -> None:
        """A setpoint for `stamp_s` came at `t_s`."""
        if stamp_s - t_s >= _EARLY_S:
            self._early_s = max(self._early_s, stamp_s)

    def spare_s(self, stamp_s: float) -> float:
        """Return for how long the stream is extrapolated beyond its newest setpoint."""
        return 0.0 if stamp_s - self._early_s <= _REMEMBERED_S else JUST_IN_TIME_S


class SetpointFollower:
    """Turns setpoints into pieces, one by one."""

    def __init__(self) -> None:
        self._ahead: list[StampedSetpoint] = []  # sorted, all later than the current one
        self._last: StampedSetpoint | None = None
        self._current: StampedSetpoint | None = None
        self._timing = StreamTiming()

    @property
    def next_s(self) -> float:
        """The time at which the next waiting setpoint takes effect; inf if none waits."""
        return self._ahead[0].t_s if self._ahead else math.inf

    @property
    def newest(self) -> StampedSetpoint | None:
        """The latest known setpoint, in effect or waiting."""
        return self._ahead[-1] if self._ahead else self._current

    def awaits_more_after_s(self, t_s: float) -> float | None:
        """The newest time of a stamped stream whose next setpoint is needed to fly on from `t_s`; else None.

        The setpoint that takes effect at `t_s` is not enough: its piece depends on the next one. A stream that is sent
        just in time is extrapolated for `JUST_IN_TIME_S`.
        """
        newest = self.newest
        if newest is None or not newest.stamped:
            return None
        return newest.t_s if newest.t_s + self._timing.spare_s(newest.t_s) <= t_s else None

    def add(self, setpoint: StampedSetpoint) -> None:
        """Add a setpoint. One for a known time replaces it; one older than the one in effect is dropped."""
        self._timing.arrived(setpoint.t_s, setpoint.arrived_s)
        if self._current is not None and setpoint.t_s <= self._current.t_s:
            if setpoint.t_s == self._current.t_s:
                self._current = setpoint
            return
        self._ahead = [s for s in self._ahead if s.t_s != setpoint.t_s]
        insort(self._ahead, setpoint)
        del self._ahead[_KEPT_AHEAD:]

    def advance(self, t_s: float) -> None:
        """Put the setpoints whose time has come into effect."""
        while self._ahead and self._ahead[0].t_s <= t_s:
            self._last, self._current = self._current, self._ahead.pop(0)

    def piece(self, timeout_s: float) -> Piece | None:
        """The piece from the setpoint in effect to the next; without a next one, extrapolated at constant acceleration.

        The extrapolation ends after `timeout_s`.
        """
        now = self._current
        if now is None:
            return None
        following = self._ahead[0] if self._ahead else None
        if following is not None and following.t_s - now.t_s > LONGEST_GAP_S:
            following = None
        c = np.zeros((TERMS, 4))
        c[:3] = now.flat
        c[2] *= 0.5
        if following is None:
            return Piece(now.t_s, now.t_s + timeout_s, c)
        ahead_s = following.t_s - now.t_s
        rise = (following.flat[2] - now.flat[2]) / ahead_s
        c[3], bend = rise, 0.0
        if self._last is not None and 0.0 < (behind_s := now.t_s - self._last.t_s) <= LONGEST_GAP_S:
            before = (now.flat[2] - self._last.flat[2]) / behind_s
            bend = (rise - before) / (ahead_s + behind_s)
            c[3] = rise - bend * ahead_s
        c[4] = bend / 12.0
        c[3] /= 6.0
        turn = math.remainder(following.flat[0, 3] - now.flat[0, 3], math.tau)
        c[1:, 3] = 0.0
        c[1, 3] = turn / ahead_s
        return Piece(now.t_s, following.t_s, c)
