"""One vehicle's decisions: modes, arming, take-off, landing, what to fly next.

Knows: the rules of the autopilot's `Personality`. Does not know: sockets, messages, clocks (time is an argument),
forces. It sees its own estimate and ground contact, nothing of the truth.

    on the ground, disarmed --arm--> armed, idle --take-off or mission--> flying --contact--> armed, idle
    armed, idle --idle_disarm_s, or at once after landing--> disarmed
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs.link.dialect import LandedState, MavResult, Severity
from gcs.mission.model import Command, MissionItem
from gcs.quadrotor import Array
from sim_bridge.course import Course, Guide, Mark, is_navigation
from sim_bridge.guidance.piece import Piece, hold
from sim_bridge.guidance.stream import Setpoint, SetpointFollower
from sim_bridge.personality import Intent, Mode, Personality

_HOVERING = frozenset({Intent.MANUAL, Intent.HOLD, Intent.GUIDED})
_LIFT_OFF_PATIENCE_S = 3.0  # after a take-off that never left the ground
_ITEM_NAMES = {16: "WP", 20: "RTL", 21: "Land", 22: "Takeoff", 93: "Delay"}


@dataclass(frozen=True)
class Said:
    """Something for STATUSTEXT."""

    severity: Severity
    text: str


@dataclass(frozen=True)
class Reached:
    """Something for MISSION_ITEM_REACHED."""

    seq: int


@dataclass(frozen=True)
class Armed:
    """The vehicle armed, and took the place for its home."""


@dataclass(frozen=True)
class ModeChanged:
    """HEARTBEAT has news."""


Event = Said | Reached | Armed | ModeChanged


class Autopilot:
    """Decides for one vehicle. `piece` is what it flies now, `events` what the outside has yet to be told."""

    def __init__(self, personality: Personality, guide: Guide, yaw_ned_rad: float) -> None:
        self._personality = personality
        self.guide = guide
        self.mode = self._mode_numbered(personality.modes.at_boot)
        self.armed = False
        self.flying = False  # motors lift: from take-off to contact with the ground
        self.ready = False
        self.mission: tuple[MissionItem, ...] = ()
        self.current_seq = 0
        self.mission_running = False
        self.guided_timeout_s = 3.0
        self.events: list[Event] = []
        self.piece: Piece = hold(0.0, np.append(guide.home_ned_m, yaw_ned_rad))
        self._course = Course(())
        self._pieces: list[Piece] = []  # of the course, still to come, last first
        self._marks: list[Mark] = []
        self._stream: SetpointFollower | None = None
        self._streaming = False
        self._wake_s = math.inf
        self._left_ground = False
        self._contact_s: float | None = None
        self._idle_since_s = 0.0
        self._state_in_air = LandedState.IN_AIR

    # What it is asked

    def arm(self, t_s: float, estimate: Array) -> MavResult:
        """Arm where the estimate (12,) says it stands, and make that home."""
        if self.armed:
            return MavResult.ACCEPTED
        reason = self._reason_not_to_arm()
        if reason:
            self._say(Severity.CRITICAL, f"Arm: {reason}")
            return MavResult.FAILED
        self.guide = replace(self.guide, home_ned_m=estimate[:3].copy())
        self.armed = True
        self._stand(t_s, np.append(estimate[:3], estimate[8]))
        self._say(Severity.INFO, "Arming motors")
        self.events += [Armed(), ModeChanged()]
        return MavResult.ACCEPTED

    def disarm(self, *, force: bool = False) -> MavResult:
        """Switch the motors off; in the air only by force."""
        if self.flying and not force:
            return MavResult.FAILED
        if self.armed:
            self.armed = self.flying = self.mission_running = False
            self._say(Severity.INFO, "Disarming motors")
            self.events.append(ModeChanged())
        return MavResult.ACCEPTED

    def set_mode(self, t_s: float, mode: int) -> MavResult:
        """Change the mode; on the ground any mode is taken, in the air it acts at once."""
        known = self._personality.modes.numbered(mode)
        if known is None:
            return MavResult.FAILED
        if known is self.mode and known.intent is not Intent.MISSION:
            return MavResult.ACCEPTED
        if known.intent is Intent.MISSION and self.flying and not self._has_mission():
            self._say(Severity.WARNING, f"Mode change to {known.name} failed: requires mission")
            return MavResult.FAILED
        self._enter(known)
        if self.flying:
            self._act(t_s)
        return MavResult.ACCEPTED

    def pursue(self, t_s: float, intent: Intent) -> MavResult:
        """Change to the mode for `intent`, as commands like NAV_LAND do."""
        mode = self._personality.modes.of(intent)
        return self.set_mode(t_s, mode.number) if mode is not None else MavResult.UNSUPPORTED

    def take_off(self, t_s: float, height_m: float) -> MavResult:
        """Climb to `height_m` above home; only armed, in GUIDED, from the ground."""
        allowed = self.mode.intent is Intent.GUIDED and self.armed and not self.flying
        if not (allowed and math.isfinite(height_m) and height_m > 0):
            return MavResult.FAILED
        self._lift(t_s, self.guide.take_off(t_s, self.piece.at(t_s), height_m))
        return MavResult.ACCEPTED

    def start_mission(self, t_s: float) -> MavResult:
        """Switch to AUTO and fly; unarmed in AUTO it is accepted and nothing happens, as on the original."""
        if not self.armed:
            return MavResult.ACCEPTED if self.mode.intent is Intent.MISSION else MavResult.FAILED
        if not self._has_mission():
            return MavResult.FAILED
        if not self.flying and self._first_navigation() != Command.NAV_TAKEOFF:
            self._say(Severity.CRITICAL, "Auto: Missing Takeoff Cmd")
            return MavResult.FAILED
        self._enter(self._mode_for(Intent.MISSION))
        self._act(t_s)
        return MavResult.ACCEPTED

    def set_mission(self, items: Sequence[MissionItem]) -> None:
        """Hold this mission from now on; item 0 is home. A mission under way is flown to its end as it was."""
        self.mission = tuple(items)
        if not self.mission_running:
            self.current_seq = 0

    def set_current(self, t_s: float, seq: int) -> MavResult:
        """Continue with item `seq`, or with the next one that moves the vehicle."""
        if not 0 <= seq < len(self.mission):
            return MavResult.DENIED
        while seq + 1 < len(self.mission) and not is_navigation(self.mission[seq].command):
            seq += 1
        self.current_seq = seq
        if self.flying and self.mode.intent is Intent.MISSION:
            self._act(t_s)
        return MavResult.ACCEPTED

    def follow(self, t_s: float, setpoint: Setpoint) -> None:
        """Take a setpoint of a stream; ignored on the ground and outside GUIDED."""
        if not self._guided_in_flight():
            return
        if self._stream is None:
            self._stream = SetpointFollower()
        self._stream.add(setpoint)
        if self._stream.next_s <= t_s or (self._streaming and self.piece.end_s != self._stream.next_s):
            self._fly_stream(t_s)
        self._wake_s = min(self._wake_s, self._stream.next_s)

    def go_to(self, t_s: float, target: Array) -> None:
        """Fly to `target` (4,) and stand there: what a setpoint without velocity asks for."""
        if self._guided_in_flight():
            self._start(t_s, self.guide.go_to(t_s, self.piece.at(t_s), target))

    def fall(self) -> None:
        """Motors stop for good (a fault)."""
        self.armed = self.flying = self.ready = self.mission_running = False

    # What it tells

    @property
    def landed_state(self) -> LandedState:
        """MAV_LANDED_STATE."""
        if not self.flying:
            return LandedState.ON_GROUND
        if not self._left_ground:
            return LandedState.TAKEOFF
        return self._state_in_air

    @property
    def awaits_orders(self) -> bool:
        """Whether it is armed and has nothing to do: on the ground, or hovering."""
        if not self.flying:
            return self.armed
        return self.mode.intent in _HOVERING and not self._streaming and math.isinf(self.piece.end_s)

    def awaits_setpoint(self, t_s: float) -> bool:
        """Whether it flies a stamped stream and has to guess how it goes on from `t_s`."""
        return self._streaming and self._stream is not None and self._stream.awaits_more(t_s)

    # What time brings

    def step(self, t_s: float, landed: bool) -> None:
        """Bring everything up to `t_s`; `landed` is contact with the ground."""
        if t_s >= self._wake_s:
            self._wake(t_s)
        if self.armed:
            self._watch_ground(t_s, landed)

    def _wake(self, t_s: float) -> None:
        while self._marks and self._marks[-1].t_s <= t_s:
            mark = self._marks.pop()
            if mark.reached is not None:
                self.events.append(Reached(mark.reached))
            if mark.current is not None:
                self.current_seq = mark.current
                name = _ITEM_NAMES.get(self.mission[mark.current].command, "")
                self._say(Severity.INFO, f"Mission: {mark.current} {name}")
        if self._stream is not None and (self._streaming or self._stream.next_s <= t_s):
            self._fly_stream(t_s)
        elif self.piece.end_s <= t_s:
            while self._pieces and self.piece.end_s <= t_s:
                self.piece = self._pieces.pop()
            if self.piece.end_s <= t_s:
                self.piece = hold(self.piece.end_s, self.piece.at(self.piece.end_s))
        self._state_in_air = self._airborne_state(t_s)
        self._sleep()

    def _fly_stream(self, t_s: float) -> None:
        stream = self._stream
        assert stream is not None
        if not self._streaming:
            self._pieces, self._marks, self._course, self._streaming = [], [], Course(()), True
        stream.advance(t_s)
        piece = stream.piece(self.guided_timeout_s)
        if piece is not None and piece.end_s > t_s:
            self.piece = piece
            self._sleep()
        else:
            at = piece if piece is not None else self.piece
            self._start(t_s, self.guide.stop(t_s, at.at(t_s)))

    def _watch_ground(self, t_s: float, landed: bool) -> None:
        if not self.flying:
            if t_s - self._idle_since_s >= self._personality.arming.idle_disarm_s:
                self.disarm()
        elif not landed:
            self._contact_s, self._left_ground = None, True
        elif t_s <= self._course.climbing_until_s + _LIFT_OFF_PATIENCE_S:
            self._left_ground = False  # a hop at the start of a climb is no landing
        elif self._contact_s is None:
            self._contact_s = t_s
        elif t_s - self._contact_s >= self._personality.flight.landed_after_s:
            self._touched_down(t_s)

    def _touched_down(self, t_s: float) -> None:
        landing = t_s >= self._course.landing_from_s
        if self.mission_running:
            self.current_seq = next(
                (seq for seq, item in enumerate(self.mission) if seq and is_navigation(item.command)), 0
            )
        self.mission_running = False
        self._stand(t_s, self.piece.at(t_s)[0])
        if landing:
            self.disarm()

    # Small steps

    def _reason_not_to_arm(self) -> str:
        if not self.ready:
            return "Need Position Estimate"
        if not self.mode.armable:
            return f"{self.mode.name} mode not armable"
        return ""

    def _guided_in_flight(self) -> bool:
        return self.mode.intent is Intent.GUIDED and self.flying and self._left_ground

    def _has_mission(self) -> bool:
        return self._first_navigation() is not None

    def _first_navigation(self) -> int | None:
        commands = (item.command for item in self.mission[max(self.current_seq, 1) :])
        return next((command for command in commands if is_navigation(command)), None)

    def _mode_numbered(self, number: int) -> Mode:
        mode = self._personality.modes.numbered(number)
        if mode is None:
            raise ValueError(f"{self._personality.name} has no mode {number}")
        return mode

    def _mode_for(self, intent: Intent) -> Mode:
        mode = self._personality.modes.of(intent)
        if mode is None:
            raise ValueError(f"{self._personality.name} has no mode for {intent.name}")
        return mode

    def _enter(self, mode: Mode) -> None:
        if mode is not self.mode:
            self.mode = mode
            self.events.append(ModeChanged())

    def _act(self, t_s: float) -> None:
        """Begin, in the air or about to be, what the mode is for."""
        flat, intent = self.piece.at(t_s), self.mode.intent
        self.mission_running = intent is Intent.MISSION
        if self.mission_running:
            landed = not self.flying
            course = self.guide.fly_mission(t_s, flat, self.mission, self.current_seq, landed)
            self._lift(t_s, course) if landed else self._start(t_s, course)
        elif intent is Intent.RETURN:
            self._start(t_s, self.guide.return_home(t_s, flat))
        elif intent is Intent.LAND:
            self._start(t_s, self.guide.land(t_s, flat))
        elif intent in _HOVERING:
            self._start(t_s, self.guide.stop(t_s, flat))

    def _lift(self, t_s: float, course: Course) -> None:
        self.flying, self._left_ground, self._contact_s = True, False, None
        self._start(t_s, course)

    def _start(self, t_s: float, course: Course) -> None:
        self._course = course
        self._pieces = list(reversed(course.pieces))
        self._marks = list(reversed(course.marks))
        self._stream, self._streaming = None, False
        self.piece = self._pieces.pop()
        self._wake(t_s)

    def _stand(self, t_s: float, place: Array) -> None:
        """Idle on the ground at `place` (4,)."""
        self.flying, self._left_ground, self._contact_s = False, False, None
        self._idle_since_s = t_s
        self._start(t_s, Course((hold(t_s, place),)))

    def _airborne_state(self, t_s: float) -> LandedState:
        if t_s >= self._course.landing_from_s:
            return LandedState.LANDING
        return LandedState.TAKEOFF if t_s < self._course.climbing_until_s else LandedState.IN_AIR

    def _sleep(self) -> None:
        self._wake_s = min(
            self.piece.end_s,
            self._marks[-1].t_s if self._marks else math.inf,
            self._stream.next_s if self._stream is not None else math.inf,
        )

    def _say(self, severity: Severity, text: str) -> None:
        self.events.append(Said(severity, text))
