"""Arming rules: why arming is refused, since when the motors turn, and when an idle vehicle disarms."""

from __future__ import annotations

import math

from sim_bridge.autopilot.events import EventQueue
from sim_bridge.autopilot.readiness import Readiness
from sim_bridge.personality import Intent, Milestone, Mode, Note, Personality

_CHECK_PERIOD_S = 1.0  # between two runs of the arming checks
_REPORT_PERIOD_S = 30.0  # between two reports of the same failed checks
_CHANGE_REPORT_S = 4.0  # minimum time since the last report before a newly failed check is reported
_ARM_IN_AUTO, _TAKE_OFF_AT_ONCE = 1, 2  # bits of AUTO_OPTIONS


class Arming:
    """`armed` and since when. `options` holds the bits of the setting AUTO_OPTIONS."""

    def __init__(self, personality: Personality, readiness: Readiness, event_queue: EventQueue) -> None:
        self._traits = personality.arming
        self._readiness = readiness
        self._event_queue = event_queue
        self.armed = False
        self.options = 0
        self._armed_s = -math.inf
        self._idle_since_s = math.inf
        self._next_check_s = self._reported_s = -math.inf
        self._passed = False

    def arm(self, t_s: float) -> None:
        """Arm at `t_s`: the motors turn from now on."""
        self.armed, self._armed_s, self._idle_since_s = True, t_s, t_s

    def start_idle(self, t_s: float) -> None:
        """Start the idle timer: the vehicle stands on the ground from `t_s` on."""
        self._idle_since_s = t_s

    @property
    def lifts_from_s(self) -> float:
        """The time at which the motors turn fast enough to lift the vehicle."""
        return self._armed_s + self._traits.spool_up_s

    def idled(self, t_s: float) -> bool:
        """Whether the vehicle has been idle long enough to disarm."""
        return t_s - self._idle_since_s >= self._traits.idle_disarm_s

    @property
    def takes_off_in_missions(self) -> bool:
        """Whether the mission mode alone is enough to take off."""
        return bool(self.options & _TAKE_OFF_AT_ONCE)

    def reasons(self, mode: Mode, *, placed: bool, has_mission: bool, has_stream: bool, trying: bool) -> list[str]:
        """Return why arming is refused in this mode, or, unless `trying`, which arming checks fail.

        `placed`: the filter knows the position.
        """
        reasons = list(self._readiness.faults)
        if not reasons and mode.needs_position and not (self._readiness.ready and placed):
            reasons.append("Need Position Estimate")
        if not reasons and not self._readiness.reached(Milestone.CHECKED):
            reasons.append("Need Position Estimate")
        if mode.intent is Intent.MISSION and not has_mission:
            reasons.append("Mode requires mission")
        elif (trying or self._traits.status_shows_armable) and not self._allowed(mode, has_stream=has_stream):
            reasons.append(f"{mode.name} mode not armable")
        return reasons

    def _allowed(self, mode: Mode, *, has_stream: bool) -> bool:
        if mode.intent is Intent.GUIDED:
            return has_stream
        if mode.intent is Intent.MANUAL:
            return self._traits.has_sticks
        return mode.armable or (mode.intent is Intent.MISSION and bool(self.options & _ARM_IN_AUTO))

    def report(self, t_s: float, reasons: list[str]) -> None:
        """Report failed arming checks as STATUSTEXT, at most once every _REPORT_PERIOD_S."""
        if self._next_check_s == -math.inf:
            self._reported_s = t_s
        self._next_check_s = t_s + _CHECK_PERIOD_S
        passed, before, self._passed = not reasons, self._passed, not reasons
        since_s = t_s - self._reported_s
        if not passed and (since_s >= _REPORT_PERIOD_S or (before and since_s >= _CHANGE_REPORT_S)):
            self._reported_s = t_s
            for reason in reasons:
                self._event_queue.add_text(Note.CHECKS_FAIL, reason=reason)

    @property
    def next_check_s(self) -> float:
        """The time of the next `report` that has work to do."""
        return self._next_check_s
