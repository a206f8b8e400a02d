"""One vehicle's decisions: which mode, whether armed, who may ask for what, when a failsafe has the say.

Knows: the rules of the autopilot's `Personality`. Does not know: sockets, messages, clocks (time is an argument),
forces. It sees its own estimate and ground contact, nothing of the truth.

    on the ground, disarmed --arm--> armed, idle --take-off, mission or setpoint--> flying --contact--> armed, idle
    armed, idle --idle_disarm_s, or soon after landing--> disarmed
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from gcs.mavlink import LandedState, MavResult
from gcs.mission.model import Command, MissionItem
from gcs.physics.quadrotor import Array
from sim_bridge.autopilot.arming import Arming
from sim_bridge.autopilot.events import Event, ModeChanged, Voice
from sim_bridge.autopilot.guidance.path_generator import PathGenerator
from sim_bridge.autopilot.guidance.piece import Piece
from sim_bridge.autopilot.guidance.stream import StampedSetpoint
from sim_bridge.autopilot.mode_actions import ModeActions
from sim_bridge.autopilot.offboard_timeout import OffboardTimeout
from sim_bridge.autopilot.readiness import Readiness
from sim_bridge.personality import Intent, Milestone, Mode, Note, Personality, Setting

_PLACED_FOR_S = 1.0  # since the estimate was healthy last
_HOVERING = frozenset({Intent.MANUAL, Intent.HOLD, Intent.GUIDED})


class EmulatedAutopilot:
    """Decides for one vehicle. `piece` is what it flies now, `events` what the outside has yet to be told."""

    def __init__(self, personality: Personality, guide: PathGenerator, yaw_ned_rad: float) -> None:
        self.personality = personality
        self.voice = Voice(personality.words)
        self.readiness = Readiness(personality.boot, self.voice)
        self.arming = Arming(personality, self.readiness, self.voice)
        self.helm = ModeActions(personality, guide, yaw_ned_rad, self.arming, self.voice)
        self.setpoints = OffboardTimeout(personality.streaming.proof_s)
        self.mode = self._numbered(personality.modes.at_boot)
        self.failing = False  # a failsafe has the say
        self._mode_after = self.mode  # disarming, where that is a habit
        self._stream_loss: Intent | None = None
        self._disarm_s = math.inf
        self._placed_s = -math.inf

    # What it is asked

    def arm(self, t_s: float, estimate: Array, note: Note = Note.ARMED) -> MavResult:
        """Arm where the estimate (12,) says it stands, and make that home."""
        if self.armed:
            return MavResult.ACCEPTED
        reasons = self._reasons(t_s, trying=True)
        if reasons:
            known = len(self.events)
            for reason in reasons:
                self.voice.say(Note.ARM_REFUSED, reason=reason)
            self.events[known:] = dict.fromkeys(self.events[known:])  # one sentence for all is said once
            return self.personality.replies.refused
        self.helm.set_home(estimate[:3])
        self.arming.arm(t_s)
        self.helm.stand(t_s, np.append(estimate[:3], estimate[8]))
        self.voice.say(note)
        if self._starts_on_ground():
            self._begin(t_s)
        return MavResult.ACCEPTED

    def disarm(self, *, force: bool = False, note: Note = Note.DISARMED) -> MavResult:
        """Switch the motors off; in the air only by force."""
        if self.flying and not force:
            self.voice.say(Note.DISARM_REFUSED)
            return self.personality.replies.refused
        if self.armed:
            self._switch_off()
            self.voice.say(note)
            if self.personality.modes.returns_after_disarming:
                self._enter(self._mode_after)
        return MavResult.ACCEPTED

    def set_mode(self, t_s: float, number: int) -> MavResult:
        """Change the mode; on the ground any mode is taken, in the air it acts at once."""
        mode = self.personality.modes.numbered(number)
        if mode is None:
            self.voice.say(Note.MODE_UNKNOWN, mode=number)
            return self.personality.replies.unknown_mode
        if mode is self.mode and not self.failing and mode.intent is not Intent.MISSION:
            return MavResult.ACCEPTED
        if self.flying and not self._can_fly(t_s, mode):
            self.voice.say(Note.MODE_REFUSED, mode=mode.name)
            return self.personality.replies.refused
        self._choose(mode)
        if self.flying or (self.armed and self._starts_on_ground()):
            self._begin(t_s)
        return MavResult.ACCEPTED

    def pursue(self, t_s: float, intent: Intent) -> MavResult:
        """Change to the mode for `intent`, as commands like NAV_LAND do."""
        mode = self.personality.modes.of(intent)
        return self.set_mode(t_s, mode.number) if mode is not None else MavResult.UNSUPPORTED

    def take_off(self, t_s: float, height_m: float) -> MavResult:
        """Climb to `height_m` above home; where that is a mode of its own, also before arming, and in the air."""
        if self.personality.flight.takeoff_in_guided:
            allowed = self.mode.intent is Intent.GUIDED and self.armed and not self.flying
            if not (allowed and math.isfinite(height_m) and height_m > 0):
                return self.personality.replies.refused
            self.helm.take_off(t_s, height_m)
            return MavResult.ACCEPTED
        mode = self.personality.modes.of(Intent.TAKEOFF)
        if mode is None:
            return MavResult.UNSUPPORTED
        self._choose(mode)
        self.helm.takeoff_m = height_m
        if self.armed:
            self._begin(t_s)
        return MavResult.ACCEPTED

    def start_mission(self, t_s: float, estimate: Array) -> MavResult:
        """Switch to the mission mode and fly; unarmed it may be accepted without anything happening."""
        if self.personality.flight.mission_start_arms:
            result = self.pursue(t_s, Intent.MISSION) if self._has_mission() else self.personality.replies.refused
            return self.arm(t_s, estimate, Note.ARMED_FOR_MISSION) if result == MavResult.ACCEPTED else result
        if not self.armed:
            if self.mode.intent is not Intent.MISSION:
                return MavResult.FAILED
            self.helm.progress.tell_current()
            return MavResult.ACCEPTED
        if not self._has_mission():
            return MavResult.FAILED
        if not self.flying and self.helm.progress.next_command() != Command.NAV_TAKEOFF:
            self.voice.say(Note.MISSION_REFUSED)
            return MavResult.FAILED
        mission = self.personality.modes.of(Intent.MISSION)
        if mission is None:
            return MavResult.UNSUPPORTED
        self._choose(mission)
        self._begin(t_s)
        return MavResult.ACCEPTED

    def set_mission(self, items: Sequence[MissionItem]) -> None:
        """Hold this mission from now on. A mission under way is flown to its end as it was."""
        self.helm.progress.hold(items)

    def set_current(self, t_s: float, seq: int) -> MavResult:
        """Continue with item `seq`, or with the next one that moves the vehicle."""
        result = self.helm.progress.select(seq)
        if result == MavResult.ACCEPTED and self.flying and self.mode.intent is Intent.MISSION:
            self._begin(t_s)
        return result

    def follow(self, t_s: float, setpoint: StampedSetpoint, *, to_rest: bool = False) -> None:
        """Take a setpoint of a stream, or one `to_rest`: a place to fly to. Ignored outside guided modes."""
        self.setpoints.heard(t_s, setpoint.t_s)
        if self.mode.intent is Intent.GUIDED and self.armed and not self.failing:
            self.helm.follow(t_s, setpoint, to_rest=to_rest)

    def set_speed(self, t_s: float, kind: float, speed_mps: float) -> MavResult:
        """DO_CHANGE_SPEED: 0, 1 over ground, 2 up, 3 down."""
        if kind not in (0.0, 1.0, 2.0, 3.0) or not 0.0 < speed_mps < math.inf:
            return self.personality.replies.refused
        if kind == 2.0:
            self.helm.change_climb(speed_mps)
        elif kind == 3.0:
            self.helm.change_descent(speed_mps)
        elif self.helm.change_speed(speed_mps) and self.flying:
            self.helm.resume(t_s, self.mode.intent)
        return MavResult.ACCEPTED

    def set_home(self, place_ned_m: Array) -> None:
        """Home is at `place_ned_m` (3,) from now on."""
        self.helm.set_home(place_ned_m)

    def reposition(self, t_s: float, target: Array, *, change_mode: bool, speed_mps: float = math.nan) -> MavResult:
        """Fly to `target` (4,) and stand there, in the mode for that, so fast if that is a number; in the air only."""
        intent = self.personality.flight.reposition_in
        if self.mode.intent is not intent:
            result = self.pursue(t_s, intent) if change_mode else MavResult.DENIED
            if result != MavResult.ACCEPTED:
                return result
        if speed_mps > 0.0:
            self.helm.change_speed(speed_mps)
        if self.helm.ground.aloft:
            self.helm.go_to(t_s, target)
        return MavResult.ACCEPTED

    def fail(self, t_s: float, intent: Intent) -> None:
        """A failsafe takes over: it acts in the air, and ends what was armed on the ground."""
        if not self.flying:
            self.disarm()
            return
        mode = self.personality.modes.of(intent)
        if mode is None or self.mode.intent is Intent.LAND or (self.failing and self.mode is mode):
            return
        self.failing = True
        self.voice.say(Note.FAILSAFE)
        self._enter(mode)
        self._begin(t_s)

    def fall(self) -> None:
        """Motors stop for good (a fault)."""
        self._switch_off()

    def use(self, settings: Mapping[Setting, float]) -> None:
        """Go by these settings from now on."""
        self.arming.options = int(settings.get(Setting.AUTO_OPTIONS, 0.0))
        self.setpoints.timeout_s = settings[Setting.STREAM_TIMEOUT_S]
        self._stream_loss = self.personality.guards.stream.get(int(settings.get(Setting.STREAM_LOSS_ACTION, 0.0)))
        self.helm.use(settings)

    # What it tells

    @property
    def events(self) -> list[Event]:
        """What has yet to be told; whoever tells it clears the list."""
        return self.voice.events

    @property
    def piece(self) -> Piece:
        """What it flies now."""
        return self.helm.path.piece

    @property
    def armed(self) -> bool:
        """Whether its motors may turn."""
        return self.arming.armed

    @property
    def flying(self) -> bool:
        """Whether motors lift: from take-off until it has landed."""
        return self.helm.ground.flying

    @property
    def ready(self) -> bool:
        """Whether its position can be flown on."""
        return self.readiness.ready

    @property
    def mission(self) -> tuple[MissionItem, ...]:
        """The items it holds."""
        return self.helm.progress.items

    @property
    def current_seq(self) -> int:
        """The current item."""
        return self.helm.progress.seq

    @property
    def guide(self) -> PathGenerator:
        """What it works out courses with: abilities, speeds, home."""
        return self.helm.guide

    @property
    def landed_state(self) -> LandedState:
        """MAV_LANDED_STATE."""
        return self.helm.landed_state

    @property
    def awaits_orders(self) -> bool:
        """Whether it is armed and has nothing to do: on the ground, or hovering."""
        if not self.flying:
            return self.armed and not self.helm.waits_for_motors
        return self.mode.intent in _HOVERING and self.helm.path.at_rest

    def awaits_setpoint_after_s(self, t_s: float) -> float | None:
        """The newest instant it knows of, where it flies a stamped stream and has to guess how that goes on."""
        return self.helm.path.awaits_setpoint_after_s(t_s)

    def can_arm(self, t_s: float) -> bool:
        """Whether nothing is in the way of being armed; what SYS_STATUS says of that."""
        return self.armed or not self._reasons(t_s, trying=False)

    # What time brings

    def step(self, t_s: float, contact: bool, healthy: bool = True) -> None:
        """Bring everything up to `t_s`; `contact` is with the ground, `healthy` the estimate."""
        if healthy:
            self._placed_s = t_s
        if not self.ready:
            self._get_ready(t_s, healthy)
        passed = self.helm.step(t_s)
        if passed.landing and self.mode.intent is Intent.RETURN:
            self.voice.say(Note.RETURN_LANDS)
        if passed.ended and self.mode.intent is Intent.TAKEOFF and self.flying:
            self.helm.progress.manoeuvred(self.mode.intent)
            self._enter(self.personality.modes.of(Intent.HOLD))
        if self.armed:
            self._watch(t_s, contact)
        elif t_s >= self.arming.look_s:
            self.arming.report(t_s, self._reasons(t_s, trying=False))

    def _get_ready(self, t_s: float, healthy: bool) -> None:
        guide = self.helm.guide
        new = self.readiness.step(t_s, healthy, guide.origin.alt_amsl_m - float(guide.home_ned_m[2]))
        if Milestone.RUNNING in new and self.personality.boot.restarts_mode:
            self._enter(self._numbered(self.personality.modes.at_boot))

    def _watch(self, t_s: float, contact: bool) -> None:
        if not self.flying:
            if t_s >= self._disarm_s:
                self.disarm(note=Note.DISARMED_LANDED)
                self.helm.progress.start_over()
            elif not self.helm.waits_for_motors and self.arming.idled(t_s):
                self.disarm(note=Note.DISARMED_IDLE)
            return
        landing = self.helm.path.landing
        if self.helm.landed(t_s, contact):
            if landing:
                self._disarm_s = t_s + self.personality.flight.disarm_after_s
        elif self._stream_loss and self.mode.intent is Intent.GUIDED and not self.setpoints.alive(t_s):
            self.fail(t_s, self._stream_loss)

    # Small steps

    def _reasons(self, t_s: float, *, trying: bool) -> list[str]:
        proven = self.setpoints.proven(t_s)
        placed = t_s - self._placed_s <= _PLACED_FOR_S
        return self.arming.reasons(
            self.mode, placed=placed, has_mission=self._has_mission(), has_stream=proven, trying=trying
        )

    def _can_fly(self, t_s: float, mode: Mode) -> bool:
        if mode.intent is Intent.MISSION:
            return self._has_mission()
        if mode.intent is Intent.GUIDED:
            return self.setpoints.proven(t_s)
        return mode.intent is not Intent.MANUAL or self.personality.arming.has_sticks

    def _has_mission(self) -> bool:
        return self.helm.progress.next_command() is not None

    def _starts_on_ground(self) -> bool:
        """Whether the mode takes an armed vehicle off the ground by itself."""
        always = self.personality.modes.act_on_ground
        if self.mode.intent is Intent.MISSION:
            return self._has_mission() and (always or self.arming.takes_off_in_missions)
        return always and self.mode.intent is Intent.TAKEOFF

    def _begin(self, t_s: float) -> None:
        if self.mode.intent is Intent.MISSION:
            self.voice.say(Note.MISSION_BEGINS)
        self.helm.begin(t_s, self.mode.intent)

    def _choose(self, mode: Mode) -> None:
        """Somebody, and no failsafe, wants this mode."""
        self.failing = False
        if mode.armable:
            self._mode_after = mode
        self.helm.stay()
        self.helm.takeoff_m = math.nan
        self._enter(mode)

    def _enter(self, mode: Mode | None) -> None:
        if mode is not None and mode is not self.mode:
            self.mode = mode
            self.voice.tell(ModeChanged())

    def _numbered(self, number: int) -> Mode:
        mode = self.personality.modes.numbered(number)
        if mode is None:
            raise ValueError(f"{self.personality.name} has no mode {number}")
        return mode

    def _switch_off(self) -> None:
        self.arming.armed = self.failing = False
        self._disarm_s = math.inf
        self.helm.switch_off()
