"""Whether motors may turn: why not, since when they do, and how long nothing has happened.

Knows: the rules of arming in its personality. Does not know: commands, motion, how ready the vehicle is (told).
"""

from __future__ import annotations

import math

from sim_bridge.autopilot.events import Voice
from sim_bridge.autopilot.readiness import Readiness
from sim_bridge.personality import Intent, Milestone, Mode, Note, Personality

_LOOK_S = 1.0  # between two looks at what keeps the vehicle from being armed
_REPORT_S = 30.0  # between two reports of the same
_NEWS_S = 4.0  # before news are reported out of turn
_IN_MISSION, _WITHOUT_ADO = 1, 2  # bits of AUTO_OPTIONS


class Arming:
    """`armed`, and since when; `options` are the bits of the setting AUTO_OPTIONS."""

    def __init__(self, personality: Personality, readiness: Readiness, voice: Voice) -> None:
        self._habits = personality.arming
        self._readiness = readiness
        self._voice = voice
        self.armed = False
        self.options = 0
        self._armed_s = -math.inf
        self._idle_since_s = math.inf
        self._look_s = self._reported_s = -math.inf
        self._passed = False

    def arm(self, t_s: float) -> None:
        """Motors turn from now on."""
        self.armed, self._armed_s, self._idle_since_s = True, t_s, t_s

    def rest(self, t_s: float) -> None:
        """The vehicle stands from now on, with nothing to do."""
        self._idle_since_s = t_s

    @property
    def lifts_from_s(self) -> float:
        """When the motors turn fast enough to lift."""
        return self._armed_s + self._habits.spool_up_s

    def idled(self, t_s: float) -> bool:
        """Whether it has stood for so long that it disarms."""
        return t_s - self._idle_since_s >= self._habits.idle_disarm_s

    @property
    def takes_off_in_missions(self) -> bool:
        """Whether a mission mode is enough to take off."""
        return bool(self.options & _WITHOUT_ADO)

    def reasons(self, mode: Mode, *, placed: bool, has_mission: bool, has_stream: bool, trying: bool) -> list[str]:
        """Why the vehicle cannot be armed in this mode; or, unless `trying`, why its checks fail.

        It is `placed` while its filter knows where it is.
        """
        reasons = list(self._readiness.faults)
        if not reasons and mode.needs_position and not (self._readiness.ready and placed):
            reasons.append("Need Position Estimate")
        if not reasons and not self._readiness.reached(Milestone.CHECKED):
            reasons.append("Need Position Estimate")
        if mode.intent is Intent.MISSION and not has_mission:
            reasons.append("Mode requires mission")
        elif (trying or self._habits.status_tells) and not self._allowed(mode, has_stream=has_stream):
            reasons.append(f"{mode.name} mode not armable")
        return reasons

    def _allowed(self, mode: Mode, *, has_stream: bool) -> bool:
        if mode.intent is Intent.GUIDED:
            return has_stream
        if mode.intent is Intent.MANUAL:
            return self._habits.has_sticks
        return mode.armable or (mode.intent is Intent.MISSION and bool(self.options & _IN_MISSION))

    def report(self, t_s: float, reasons: list[str]) -> None:
        """Say now and then why the vehicle could not be armed."""
        if self._look_s == -math.inf:
            self._reported_s = t_s
        self._look_s = t_s + _LOOK_S
        passed, before, self._passed = not reasons, self._passed, not reasons
        since_s = t_s - self._reported_s
        if not passed and (since_s >= _REPORT_S or (before and since_s >= _NEWS_S)):
            self._reported_s = t_s
            for reason in reasons:
                self._voice.say(Note.CHECKS_FAIL, reason=reason)

    @property
    def look_s(self) -> float:
        """When `report` has something to do next."""
        return self._look_s
