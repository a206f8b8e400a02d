"""Start-up and arming: the reasons against arming, the spin-up of the motors, and idle disarming."""

import math
from collections.abc import Mapping

from gcs.mavlink import Severity
from sim_bridge.autopilot.events import EventQueue, Placed, Said
from sim_bridge.personality import Boot, Intent, Milestone, Mode, Note, Personality, Setting

_NOTHING: frozenset[Milestone] = frozenset()
_CHECK_PERIOD_S = 1.0  # between two runs of the arming checks
_REPORT_PERIOD_S = 30.0  # between two reports of the same failed checks
_CHANGE_REPORT_S = 4.0  # minimum time since the last report before a newly failed check is reported
_UNHEALTHY = "Accels inconsistent"
_ARM_IN_AUTO, _TAKE_OFF_AT_ONCE = 1, 2  # bits of AUTO_OPTIONS


class Readiness:
    """The start-up of a vehicle, from power-on to ready for flight, stage by stage.

    The last stage also waits until the filter is healthy; all others follow the clock. `faults` are the reasons why
    arming is refused at this stage.
    """

    def __init__(self, boot: Boot, event_queue: EventQueue) -> None:
        self._event_queue = event_queue
        self._pace = boot.pace
        self._ahead = list(reversed(boot.stages))
        self._reached: set[Milestone] = set()
        self._on_s = math.nan  # time of power-on
        self.faults: tuple[str, ...] = ()

    def reached(self, milestone: Milestone) -> bool:
        """Whether this milestone has been reached."""
        return milestone in self._reached

    @property
    def ready(self) -> bool:
        """Whether the position estimate is good enough to fly on."""
        return Milestone.READY in self._reached

    def step(self, t_s: float, healthy: bool, ground_alt_m: float) -> frozenset[Milestone]:
        """Advance to `t_s`; return the milestones reached in this step."""
        if not self._ahead:
            return _NOTHING
        if math.isnan(self._on_s):
            self._on_s = t_s
        new: frozenset[Milestone] = _NOTHING
        while self._ahead and t_s - self._on_s >= self._pace * self._ahead[-1].after_s:
            if Milestone.READY in self._ahead[-1].milestones and not healthy:
                break
            stage = self._ahead.pop()
            new |= stage.milestones
            self._reached |= stage.milestones
            self.faults = self.faults if stage.faults is None else stage.faults
            if Milestone.PLACED in stage.milestones:
                self._event_queue.add(Placed())
            self._event_queue.add(*(Said(Severity.INFO, text.format(alt_m=ground_alt_m)) for text in stage.texts))
        return new


class Arming:
    """`armed` and since when. `options` holds the bits of the setting AUTO_OPTIONS."""

    def __init__(self, personality: Personality, readiness: Readiness, event_queue: EventQueue) -> None:
        self._traits = personality.flight
        self._readiness = readiness
        self._event_queue = event_queue
        self.armed = False
        self.options = 0
        self.refuses = self.fails_checks = False  # faults
        self._armed_s = -math.inf
        self._idle_since_s = math.inf
        self._next_check_s = self._reported_s = -math.inf
        self._passed = False

    def arm(self, t_s: float) -> None:
        """Arm at `t_s`: the motors turn from now on."""
        self.armed, self._armed_s, self._idle_since_s = True, t_s, t_s

    def disarm(self) -> None:
        """Stop the motors."""
        self.armed = False

    def use(self, settings: Mapping[Setting, float]) -> None:
        """Apply these settings."""
        self.options = int(settings.get(Setting.AUTO_OPTIONS, 0.0))

    def suffer(self, *, refuses: bool, fails_checks: bool) -> None:
        """Have these faults from now on, or not any more."""
        self.refuses, self.fails_checks = refuses, fails_checks

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
        if self.fails_checks or (trying and self.refuses):
            reasons.append(_UNHEALTHY)
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
                note = Note.SENSOR_FAILS if reason == _UNHEALTHY else Note.CHECKS_FAIL
                self._event_queue.add_text(note, reason=reason)

    @property
    def next_check_s(self) -> float:
        """The time of the next `report` that has work to do."""
        return self._next_check_s


class OffboardTimeout:
    """A stream counts as alive until `timeout_s` without a setpoint, and as proven after `proof_s` without a gap."""

    def __init__(self, proof_s: float) -> None:
        self._proof_s = proof_s
        self._since_s = math.inf
        self._last_s = -math.inf
        self.timeout_s = 1.0
        self.ever = False

    def use(self, settings: Mapping[Setting, float]) -> None:
        """Apply these settings."""
        self.timeout_s = settings[Setting.STREAM_TIMEOUT_S]

    def heard(self, t_s: float, counts_at_s: float) -> None:
        """Record a setpoint that arrived at `t_s` and takes effect at `counts_at_s`, then or later."""
        if not self.alive(t_s):
            self._since_s = t_s
        self._last_s = max(t_s, counts_at_s, self._last_s)
        self.ever = True

    def alive(self, t_s: float) -> bool:
        """Whether the last setpoint is no older than the timeout."""
        return t_s - self._last_s <= self.timeout_s

    def proven(self, t_s: float) -> bool:
        """Whether the stream has run long enough to enter or arm in a guided mode."""
        return not self._proof_s or (self.alive(t_s) and t_s - self._since_s >= self._proof_s)
