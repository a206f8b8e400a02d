"""The decisions of one vehicle: its mode, arming, the commands it accepts, and when a failsafe takes over.

What differs between autopilots comes from the `Personality`. Time is an argument. The vehicle sees its own estimate
and ground contact, never the true state.

    on the ground, disarmed --arm--> armed, idle --take-off, mission or setpoint--> flying --contact--> armed, idle
    armed, idle --idle_disarm_s, or soon after landing--> disarmed
"""

import math
from collections.abc import Mapping

import numpy as np

from gcs.mavlink import MavResult
from gcs.mission.model import Command
from gcs.types import Array
from sim_bridge.autopilot.arming import Arming, OffboardTimeout, Readiness
from sim_bridge.autopilot.events import EventQueue, ModeChanged
from sim_bridge.autopilot.guidance.path_generator import PathGenerator
from sim_bridge.autopilot.guidance.stream import StampedSetpoint
from sim_bridge.autopilot.mode_actions import ModeActions
from sim_bridge.personality import Intent, Milestone, Mode, Note, Personality, Setting

_POSITION_VALID_S = 1.0  # after the estimate was last healthy
_HOVERING = frozenset({Intent.MANUAL, Intent.HOLD, Intent.GUIDED})


class EmulatedAutopilot:
    """Decides for one vehicle. Its `path` has the piece that it flies now; whoever reports `events` clears them."""

    def __init__(self, personality: Personality, path_generator: PathGenerator, yaw_ned_rad: float) -> None:
        self.personality = personality
        self.event_queue = EventQueue(personality.words)
        self.events = self.event_queue.events
        self.readiness = Readiness(personality.boot, self.event_queue)
        self.arming = Arming(personality, self.readiness, self.event_queue)
        self.mode_actions = ModeActions(personality, path_generator, yaw_ned_rad, self.arming, self.event_queue)
        self.path, self.ground = self.mode_actions.path, self.mode_actions.ground
        self.progress = self.mode_actions.progress
        self.setpoints = OffboardTimeout(personality.flight.stream_proof_s)
        self.mode = self._numbered(personality.modes.at_boot)
        self.failing = False  # a failsafe is in control
        self.channels_us: tuple[int, ...] = ()  # of a pilot's remote control; empty without one
        self.reaction: int | None = None  # which end of what its navigator may do; by the seed if None
        self._seeded_navigator = path_generator.navigator
        self._mode_after = self.mode  # the mode after disarming, where the autopilot returns to one
        self._stream_loss: Intent | None = None
        self._disarm_s = math.inf
        self._placed_s = -math.inf

    # Commands

    def arm(self, t_s: float, estimate: Array, note: Note = Note.ARMED) -> MavResult:
        """Arm, and set home to the position of the estimate (12,)."""
        if self.armed:
            return MavResult.ACCEPTED
        reasons = self._reasons(t_s, trying=True)
        if reasons:
            known = len(self.events)
            for reason in reasons:
                self.event_queue.add_text(Note.ARM_REFUSED, reason=reason)
            self.events[known:] = dict.fromkeys(self.events[known:])  # one text for several reasons is sent once
            return self.personality.replies.refused
        self.mode_actions.set_home(estimate[:3])
        self.arming.arm(t_s)
        self.mode_actions.stand(t_s, np.append(estimate[:3], estimate[8]))
        self.event_queue.add_text(note)
        if self._starts_on_ground():
            self._begin(t_s)
        return MavResult.ACCEPTED

    def disarm(self, *, force: bool = False, note: Note = Note.DISARMED) -> MavResult:
        """Stop the motors; in flight only with `force`."""
        if self.flying and not force:
            self.event_queue.add_text(Note.DISARM_REFUSED)
            return self.personality.replies.refused
        if self.armed:
            self._switch_off()
            self.event_queue.add_text(note)
            if self.personality.modes.returns_after_disarming:
                self._enter(self._mode_after)
        return MavResult.ACCEPTED

    def set_mode(self, t_s: float, number: int) -> MavResult:
        """Change the mode. On the ground every mode is accepted; in flight the change acts at once."""
        mode = self.personality.modes.numbered(number)
        if mode is None:
            self.event_queue.add_text(Note.MODE_UNKNOWN, mode=number)
            return self.personality.replies.unknown_mode
        if mode is self.mode and not self.failing and mode.intent is not Intent.MISSION:
            return MavResult.ACCEPTED
        if self.flying and not self._can_fly(t_s, mode):
            self.event_queue.add_text(Note.MODE_REFUSED, mode=mode.name)
            return self.personality.replies.refused
        self._choose(mode)
        if self.flying or (self.armed and self._starts_on_ground()):
            self._begin(t_s)
        return MavResult.ACCEPTED

    def pursue(self, t_s: float, intent: Intent) -> MavResult:
        """Change to the mode for `intent`, as commands such as NAV_LAND do."""
        mode = self.personality.modes.of(intent)
        return self.set_mode(t_s, mode.number) if mode is not None else MavResult.UNSUPPORTED

    def take_off(self, t_s: float, height_m: float) -> MavResult:
        """Climb to `height_m` above home. Where take-off is a mode, also before arming and in flight."""
        if self.personality.flight.takeoff_in_guided:
            allowed = self.mode.intent is Intent.GUIDED and self.armed and not self.flying
            if not (allowed and math.isfinite(height_m) and height_m > 0):
                return self.personality.replies.refused
            self.mode_actions.take_off(t_s, height_m)
            return MavResult.ACCEPTED
        mode = self.personality.modes.of(Intent.TAKEOFF)
        if mode is None:
            return MavResult.UNSUPPORTED
        self._choose(mode, height_m)
        if self.armed:
            self._begin(t_s)
        return MavResult.ACCEPTED

    def start_mission(self, t_s: float, estimate: Array) -> MavResult:
        """Switch to the mission mode and fly. A disarmed vehicle may accept this without any effect."""
        if self.personality.flight.mission_start_arms:
            result = self.pursue(t_s, Intent.MISSION) if self._has_mission() else self.personality.replies.refused
            return self.arm(t_s, estimate, Note.ARMED_FOR_MISSION) if result == MavResult.ACCEPTED else result
        if not self.armed:
            if self.mode.intent is not Intent.MISSION:
                return MavResult.FAILED
            self.progress.announce_current()
            return MavResult.ACCEPTED
        if not self._has_mission():
            return MavResult.FAILED
        if not self.flying and self.progress.next_command() != Command.NAV_TAKEOFF:
            self.event_queue.add_text(Note.MISSION_REFUSED)
            return MavResult.FAILED
        mission = self.personality.modes.of(Intent.MISSION)
        if mission is None:
            return MavResult.UNSUPPORTED
        self._choose(mission)
        self._begin(t_s)
        return MavResult.ACCEPTED

    def set_current(self, t_s: float, seq: int) -> MavResult:
        """Continue with item `seq`, or with the next item that moves the vehicle."""
        result = self.progress.select(seq)
        if result == MavResult.ACCEPTED and self.flying and self.mode.intent is Intent.MISSION:
            self._begin(t_s)
        return result

    def follow(self, t_s: float, setpoint: StampedSetpoint, *, to_rest: bool = False) -> None:
        """Take one setpoint of a stream, or a position to fly to (`to_rest`). Ignored outside guided modes."""
        self.setpoints.heard(t_s, setpoint.t_s)
        if self.mode.intent is Intent.GUIDED and self.armed and not self.failing:
            self.mode_actions.follow(t_s, setpoint, to_rest=to_rest)

    def set_speed(self, t_s: float, kind: float, speed_mps: float) -> MavResult:
        """DO_CHANGE_SPEED with type `kind`: 0 and 1 ground speed, 2 climb, 3 descent."""
        if kind not in (0.0, 1.0, 2.0, 3.0) or not 0.0 < speed_mps < math.inf:
            return self.personality.replies.refused
        if kind == 2.0:
            self.mode_actions.change(climb_mps=speed_mps)
        elif kind == 3.0:
            self.mode_actions.change(descend_mps=speed_mps)
        elif self.mode_actions.change_speed(speed_mps) and self.flying:
            self.mode_actions.resume(t_s, self.mode.intent)
        return MavResult.ACCEPTED

    def reposition(self, t_s: float, target: Array, *, change_mode: bool, speed_mps: float = math.nan) -> MavResult:
        """Fly to `target` (4,) and hold there, in the mode for DO_REPOSITION; a finite `speed_mps` is the ground speed.

        On the ground only the mode changes.
        """
        intent = self.personality.flight.reposition_in
        if self.mode.intent is not intent:
            result = self.pursue(t_s, intent) if change_mode else MavResult.DENIED
            if result != MavResult.ACCEPTED:
                return result
        if speed_mps > 0.0:
            self.mode_actions.change_speed(speed_mps)
        if self.ground.aloft:
            self.mode_actions.go_to(t_s, target)
        return MavResult.ACCEPTED

    def fail(self, t_s: float, intent: Intent) -> None:
        """Let a failsafe take over: in flight change to the mode for `intent`, on the ground disarm."""
        if not self.flying:
            self.disarm()
            return
        mode = self.personality.modes.of(intent)
        if mode is None or self.mode.intent is Intent.LAND or (self.failing and self.mode is mode):
            return
        self.failing = True
        self.event_queue.add_text(Note.FAILSAFE)
        self._enter(mode)
        self._begin(t_s)

    def fall(self) -> None:
        """Stop the motors for good (a fault)."""
        self._switch_off()

    def react(self, end: int | None) -> None:
        """Fly the next missions at this end of `Navigator.reactions`; None: at the one that the seed gave."""
        navigator = self._seeded_navigator
        if end == self.reaction or navigator is None:
            return
        self.reaction = end
        ends = navigator.reactions if end is not None else ()
        self.mode_actions.change(navigator=ends[end] if end is not None and ends else navigator)

    def use(self, settings: Mapping[Setting, float]) -> None:
        """Apply these settings."""
        self.arming.use(settings)
        self.setpoints.use(settings)
        self._stream_loss = self.personality.failsafes.stream.get(int(settings.get(Setting.STREAM_LOSS_ACTION, 0.0)))
        self.mode_actions.use(settings)

    # State

    @property
    def armed(self) -> bool:
        """Whether the vehicle is armed."""
        return self.arming.armed

    @property
    def flying(self) -> bool:
        """Whether the motors lift: from take-off until the landing is detected."""
        return self.ground.flying

    @property
    def path_generator(self) -> PathGenerator:
        """The path generator, with its limits, speeds and home."""
        return self.mode_actions.path_generator

    @property
    def awaits_orders(self) -> bool:
        """Whether the vehicle is armed and idle: on the ground, or hovering."""
        if not self.flying:
            return self.armed and not self.mode_actions.waits_for_motors
        return self.mode.intent in _HOVERING and self.path.at_rest

    def can_arm(self, t_s: float) -> bool:
        """Whether all arming checks pass, as SYS_STATUS reports it."""
        return self.armed or not self._reasons(t_s, trying=False)

    # One step of time

    def step(self, t_s: float, contact: bool, healthy: bool = True) -> None:
        """Advance to `t_s`; `contact` is with the ground, `healthy` is the estimate."""
        if healthy:
            self._placed_s = t_s
        if not self.readiness.ready:
            self._get_ready(t_s, healthy)
        passed = self.mode_actions.step(t_s)
        if passed.landing and self.mode.intent is Intent.RETURN:
            self.event_queue.add_text(Note.RETURN_LANDS)
        if passed.ended and self.mode.intent is Intent.TAKEOFF and self.flying:
            self.progress.manoeuvred(self.mode.intent)
            self._enter(self.personality.modes.of(Intent.HOLD))
        if self.armed:
            self._watch(t_s, contact)
        elif t_s >= self.arming.next_check_s:
            self.arming.report(t_s, self._reasons(t_s, trying=False))

    def _get_ready(self, t_s: float, healthy: bool) -> None:
        new = self.readiness.step(t_s, healthy, self.path_generator.home_amsl_m)
        if Milestone.RUNNING in new and self.personality.boot.restarts_mode:
            self._enter(self._numbered(self.personality.modes.at_boot))

    def _watch(self, t_s: float, contact: bool) -> None:
        if not self.flying:
            if t_s >= self._disarm_s:
                self.disarm(note=Note.DISARMED_LANDED)
                self.progress.start_over()
            elif not self.mode_actions.waits_for_motors and self.arming.idled(t_s):
                self.disarm(note=Note.DISARMED_IDLE)
            return
        landing = self.path.landing
        if self.mode_actions.landed(t_s, contact):
            if landing:
                self._disarm_s = t_s + self.personality.flight.disarm_after_s
        elif self._stream_loss and self.mode.intent is Intent.GUIDED and not self.setpoints.alive(t_s):
            self.fail(t_s, self._stream_loss)

    # Helpers

    def _reasons(self, t_s: float, *, trying: bool) -> list[str]:
        proven = self.setpoints.proven(t_s)
        placed = t_s - self._placed_s <= _POSITION_VALID_S
        return self.arming.reasons(
            self.mode, placed=placed, has_mission=self._has_mission(), has_stream=proven, trying=trying
        )

    def _can_fly(self, t_s: float, mode: Mode) -> bool:
        if mode.intent is Intent.MISSION:
            return self._has_mission()
        if mode.intent is Intent.GUIDED:
            return self.setpoints.proven(t_s)
        return mode.intent is not Intent.MANUAL or self.personality.flight.has_sticks

    def _has_mission(self) -> bool:
        return self.progress.next_command() is not None

    def _starts_on_ground(self) -> bool:
        """Whether this mode takes an armed vehicle off the ground without a further command."""
        always = self.personality.modes.act_on_ground
        if self.mode.intent is Intent.MISSION:
            return self._has_mission() and (always or self.arming.takes_off_in_missions)
        return always and self.mode.intent is Intent.TAKEOFF

    def _begin(self, t_s: float) -> None:
        if self.mode.intent is Intent.MISSION:
            self.event_queue.add_text(Note.MISSION_BEGINS)
        self.mode_actions.begin(t_s, self.mode.intent)

    def _choose(self, mode: Mode, takeoff_m: float = math.nan) -> None:
        """Enter a mode by command, not by failsafe; one that climbs does so to `takeoff_m` above home, if given."""
        self.failing = False
        if mode.armable:
            self._mode_after = mode
        self.mode_actions.stay(takeoff_m)
        self._enter(mode)

    def _enter(self, mode: Mode | None) -> None:
        if mode is not None and mode is not self.mode:
            self.mode = mode
            self.event_queue.add(ModeChanged())

    def _numbered(self, number: int) -> Mode:
        mode = self.personality.modes.numbered(number)
        if mode is None:
            raise ValueError(f"{self.personality.name} has no mode {number}")
        return mode

    def _switch_off(self) -> None:
        self.arming.disarm()
        self.failing = False
        self._disarm_s = math.inf
        self.mode_actions.switch_off()
