"""Actions at mode changes: take-off, mission, return, landing, hold, setpoints."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from gcs.mavlink import LandedState
from gcs.mission.model import Command, Frame, MissionItem
from gcs.types import Array
from sim_bridge.autopilot.arming import Arming
from sim_bridge.autopilot.events import EventQueue, Placed
from sim_bridge.autopilot.guidance.flight_path import Flightpath, Passed
from sim_bridge.autopilot.guidance.mission_guidance import fly_mission
from sim_bridge.autopilot.guidance.motion_primitives import braking_m
from sim_bridge.autopilot.guidance.path_generator import PathGenerator
from sim_bridge.autopilot.guidance.piece import Piece, PiecePath
from sim_bridge.autopilot.guidance.stream import StampedSetpoint
from sim_bridge.autopilot.mission_progress import MissionProgress
from sim_bridge.personality import Intent, Note, Personality, Setting

_FAR_M = 2.0  # a first setpoint further away than this is flown to as a position, not followed as a stream
_SAME_M = 0.01
_LIFTS_M = 0.2  # a setpoint this far above the ground, or a climb of 0.2 m/s, means take-off
_LIFT_S = 2.0
_LEAST_RETURN_M = 4.0  # minimum return height above home, at any distance
_LIFT_OFF_TIMEOUT_S = 3.0  # for a take-off that never left the ground


class ModeActions:
    """The `path_generator`, the `path` that is flown, the land detector `ground`, and the mission `progress`."""

    def __init__(
        self,
        personality: Personality,
        path_generator: PathGenerator,
        yaw_ned_rad: float,
        arming: Arming,
        event_queue: EventQueue,
    ) -> None:
        self.path_generator = path_generator
        self.path = Flightpath(np.append(path_generator.home_ned_m, yaw_ned_rad), self._end_stream)
        self.ground = LandDetector(personality.flight.landed_after_s)
        self.progress = MissionProgress(personality.reports, personality.missions.home_is_item_0, event_queue)
        self._takeoff_m = math.nan  # above home, as last commanded
        self._traits = personality.flight
        self._arming = arming
        self._event_queue = event_queue
        self._least_takeoff_m = 0.0
        self._intent = Intent.HOLD
        self._settings: Mapping[Setting, float] = {}
        self._lift_off: Callable[[float], PiecePath] | None = None  # the path to start when the motors have spun up

    @property
    def waits_for_motors(self) -> bool:
        """Whether a take-off waits until the motors have spun up."""
        return self._lift_off is not None

    def use(self, settings: Mapping[Setting, float]) -> None:
        """Apply these settings."""
        self._settings = settings
        timeout_s, coasts_s = settings[Setting.STREAM_TIMEOUT_S], self._traits.stream_extrapolates_s
        self.path.extrapolate(timeout_s if coasts_s is None else coasts_s)
        self._least_takeoff_m = settings.get(Setting.TAKEOFF_HEIGHT_M, 0.0)
        self.change(
            speed_mps=min(settings[Setting.CRUISE_MPS], self.path_generator.limits.horizontal_mps),
            descend_mps=settings[Setting.DESCEND_MPS],
            land_mps=settings[Setting.LAND_MPS],
            rtl_height_m=settings[Setting.RETURN_HEIGHT_M],
            arrive_m=settings.get(Setting.ARRIVE_M, 0.0),
            climb_mps=settings[Setting.CLIMB_MPS],
            takeoff_mps=self._traits.takeoff_share * settings.get(Setting.TAKEOFF_MPS, settings[Setting.CLIMB_MPS]),
            liftoff_pause_s=self._traits.liftoff_pause_s,
            slow_m=self._slow_down(settings),
            crawl_below_m=self._traits.crawl_below_m,
            crawl_mps=settings.get(Setting.CRAWL_MPS, 0.0),
            return_wait_s=max(settings.get(Setting.RETURN_WAIT_S, 0.0), 0.0),
        )

    def _slow_down(self, settings: Mapping[Setting, float]) -> tuple[float, float]:
        """Return the heights above home between which a descent slows down."""
        low_m, brakes_mps2 = settings[Setting.LAND_LOW_M], self._traits.brakes_mps2
        if brakes_mps2 is None:
            return settings[Setting.LAND_HIGH_M], low_m
        high_m = low_m + braking_m(settings[Setting.DESCEND_MPS], brakes_mps2)
        return high_m, low_m + braking_m(settings[Setting.LAND_MPS], brakes_mps2)

    def change(self, **values: Any) -> None:
        """Set fields of the path generator; the paths under way keep theirs."""
        self.path_generator = replace(self.path_generator, **values)

    def change_speed(self, speed_mps: float) -> bool:
        """Set the ground speed; return whether it changed."""
        before = self.path_generator.speed_mps
        self.change(speed_mps=min(speed_mps, self.path_generator.limits.horizontal_mps))
        return self.path_generator.speed_mps != before

    def resume(self, t_s: float, intent: Intent) -> None:
        """Re-plan what is under way, with the present speeds."""
        if intent is Intent.MISSION and self.progress.running and not self.path.landing:
            self._fly_mission(t_s, anew=False)
        elif self.path.target is not None and not self.path.at_rest:
            self.go_to(t_s, self.path.target)

    def set_home(self, place_ned_m: Array) -> None:
        """Set home to `place_ned_m` (3,)."""
        self.change(home_ned_m=place_ned_m.copy())
        self._event_queue.add(Placed())

    def begin(self, t_s: float, intent: Intent) -> None:
        """Start the path of a mode for `intent`, in flight or at take-off."""
        flat = self.path.piece.at(t_s)
        if intent is not self._intent:  # speeds set by command end with the mode
            self.use(self._settings)
        self._intent = intent
        self.progress.stop()
        self._lift_off = None
        if intent is Intent.MISSION:
            self._fly_mission(t_s)
        elif intent is Intent.TAKEOFF:
            self._climb(t_s)
        elif intent is Intent.RETURN:
            self._return(t_s, flat)
        elif intent is Intent.LAND or (intent is Intent.MANUAL and self._traits.sinks_without_sticks):
            self.path.start(t_s, self.path_generator.land(t_s, flat))
        else:
            self.path.start(t_s, self.path_generator.stop(t_s, flat))

    def take_off(self, t_s: float, height_m: float) -> None:
        """Climb straight up to `height_m` above home, as soon as the motors have spun up."""
        self._lift(t_s, lambda t_s: self.path_generator.take_off(t_s, self.path.piece.at(t_s), height_m))

    def go_to(self, t_s: float, target: Array) -> None:
        """Fly to `target` (4,) and hold there; yaw turns the shorter way."""
        flat, target = self.path.piece.at(t_s), target.copy()
        target[3] = flat[0, 3] + math.remainder(target[3] - flat[0, 3], math.tau)
        self.path.start(t_s, self.path_generator.go_to(t_s, flat, target), target)

    def follow(self, t_s: float, setpoint: StampedSetpoint, *, to_rest: bool) -> None:
        """Follow a setpoint of a stream, or fly to one.

        On the ground a setpoint starts a take-off where the autopilot allows that.
        """
        if not self.ground.aloft and not self._lifts(t_s, setpoint):
            return
        target = setpoint.flat[0]
        far = not self.path.streaming and np.linalg.norm(target - self.path.piece.at(t_s)[0]) > _FAR_M
        if not (to_rest or far):
            self.path.follow(t_s, setpoint)
        elif not self.path.heads_for(target, _SAME_M if to_rest else _FAR_M):
            self.go_to(t_s, target)

    def stand(self, t_s: float, place: Array) -> None:
        """Stand idle on the ground at `place` (4,)."""
        self.ground.settle()
        self._arming.start_idle(t_s)
        self.path.stand(t_s, place)

    def stay(self, takeoff_m: float) -> None:
        """Cancel a take-off that waits for the motors. A later one may climb to `takeoff_m` above home, if given."""
        self._lift_off, self._takeoff_m = None, takeoff_m

    def switch_off(self) -> None:
        """Stop the motors, wherever the vehicle is."""
        self.progress.stop()
        self._lift_off = None
        self.ground.settle()

    def step(self, t_s: float) -> Passed:
        """Advance to `t_s`; return what was passed."""
        passed = self.path.step(t_s)
        for mark in passed.marks:
            self.progress.pass_mark(mark)
        if passed.landing:
            self.progress.descends()
        self.progress.step(t_s)
        if self._lift_off is not None and t_s >= self._arming.lifts_from_s:
            self._lift(t_s, self._lift_off)
        return passed

    def landed(self, t_s: float, contact: bool) -> bool:
        """Return whether the vehicle landed in this step."""
        left, landed = self.ground.step(t_s, contact, self.path.planned.climbing_until_s)
        if left:
            self._event_queue.add_text(Note.LIFTED_OFF)
        if landed:
            self.progress.land(self._intent)
            self._event_queue.add_text(Note.LANDED)
            self.stand(t_s, self.path.piece.at(t_s)[0])
        return landed

    @property
    def landed_state(self) -> LandedState:
        """MAV_LANDED_STATE."""
        if not self.ground.aloft:
            return LandedState.ON_GROUND
        if self.path.landing and self._intent is not Intent.MANUAL:
            return LandedState.LANDING
        climbing = self.path.piece.start_s < self.path.planned.climbing_until_s
        return LandedState.TAKEOFF if climbing else LandedState.IN_AIR

    def _end_stream(self, t_s: float, flat: Array) -> PiecePath:
        if self._traits.stream_comes_back:
            return self.path_generator.go_to(t_s, flat, flat[0])
        return self.path_generator.stop(t_s, flat)

    def _fly_mission(self, t_s: float, *, anew: bool = True) -> None:
        self.progress.begin(anew=anew)
        if not self.ground.flying:
            self.progress.announce_current()
        items, first = self.progress.padded
        if self.ground.flying:
            self.path.start(
                t_s, fly_mission(self.path_generator, t_s, self.path.piece.at(t_s), items, first, landed=False)
            )
            return
        climb_m = self._climb_before(items[first])
        self._event_queue.add_text(Note.MISSION_CLIMBS, height_m=climb_m or items[first].alt_m)

        def make_path(t_s: float) -> PiecePath:
            if not climb_m:
                return fly_mission(self.path_generator, t_s, self.path.piece.at(t_s), items, first, landed=True)
            climb = self.path_generator.take_off(t_s, self.path.piece.at(t_s), climb_m)
            top = climb.pieces[-1]
            rest = fly_mission(self.path_generator, top.end_s, top.at(top.end_s), items, first, landed=False)
            return replace(rest, pieces=climb.pieces + rest.pieces, climbing_until_s=top.end_s)

        self._lift(t_s, make_path)

    def _climb_before(self, item: MissionItem) -> float:
        """The climb before a mission that does not begin with a take-off, in m above home; 0 where it does."""
        if item.command == Command.NAV_TAKEOFF:
            return 0.0
        home_m = self.path_generator.home_amsl_m if item.frame == Frame.GLOBAL else 0.0
        return max(self._least_takeoff_m, item.alt_m - home_m)

    def _climb(self, t_s: float) -> None:
        height_m = max(self._takeoff_m, self._least_takeoff_m)
        if not math.isfinite(height_m):
            height_m = self._least_takeoff_m
        if not self.ground.flying:
            self.take_off(t_s, height_m)
            return
        target = self.path.piece.at(t_s)[0].copy()
        target[2] = self.path_generator.home_ned_m[2] - height_m
        self.go_to(t_s, target)

    def _return(self, t_s: float, flat: Array) -> None:
        path_generator, up_m = self.path_generator, self.path_generator.home_ned_m[2] - flat[0, 2]
        if self._traits.return_cone:
            cone_m = max(math.dist(flat[0, :2], path_generator.return_point(flat)), _LEAST_RETURN_M)
            path_generator = replace(path_generator, rtl_height_m=min(path_generator.rtl_height_m, cone_m))
        height_m = max(path_generator.rtl_height_m, up_m)
        alt_m = path_generator.origin.alt_amsl_m - path_generator.home_ned_m[2] + height_m
        self._event_queue.add_text(Note.RETURN_BEGINS, alt_m=alt_m, height_m=height_m)
        self.path.start(t_s, path_generator.return_home(t_s, flat))

    def _lift(self, t_s: float, make_path: Callable[[float], PiecePath]) -> None:
        if t_s < self._arming.lifts_from_s:
            self._lift_off = make_path
            return
        self._lift_off = None
        self.ground.lift()
        self.path.start(t_s, make_path(t_s))

    def _lifts(self, t_s: float, setpoint: StampedSetpoint) -> bool:
        if self.ground.flying:
            return self._traits.stream_lifts
        here = self.path.piece
        wanted = here.at(t_s)[0, 2] - setpoint.flat[0, 2] > _LIFTS_M or setpoint.flat[1, 2] < -_LIFTS_M
        if not (self._traits.stream_lifts and wanted and t_s >= self._arming.lifts_from_s):
            return False
        self.ground.lift()
        self.path.start(t_s, PiecePath((Piece(t_s, math.inf, here.coefficients),), climbing_until_s=t_s + _LIFT_S))
        return True


class LandDetector:
    """Detects take-off and landing by ground contact alone.

    standing --lift--> lifting --no contact--> in the air --contact for landed_after_s--> standing
    lifting --contact for _LIFT_OFF_TIMEOUT_S after the climb--> standing

    `flying` from the take-off command until the landing; `aloft` once the vehicle has left the ground.
    """

    def __init__(self, landed_after_s: float) -> None:
        self._landed_after_s = landed_after_s
        self._contact_s: float | None = None
        self.flying = False
        self.aloft = False

    def lift(self) -> None:
        """Start a take-off."""
        self.flying, self.aloft, self._contact_s = True, False, None

    def settle(self) -> None:
        """The vehicle stands, or lies, on the ground."""
        self.flying, self.aloft, self._contact_s = False, False, None

    def step(self, t_s: float, contact: bool, climbing_until_s: float) -> tuple[bool, bool]:
        """Return whether the vehicle left the ground in this step, and whether it landed in this step."""
        if not contact:
            left = not self.aloft
            self._contact_s, self.aloft = None, True
            return left, False
        if t_s <= climbing_until_s + _LIFT_OFF_TIMEOUT_S:
            self.aloft = False  # a bounce at the start of a climb is not a landing
        elif self._contact_s is None:
            self._contact_s = t_s
        elif t_s - self._contact_s >= self._landed_after_s:
            self.settle()
            return False, True
        return False, False
