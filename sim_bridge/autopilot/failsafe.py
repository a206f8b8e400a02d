"""Failsafes: a silent ground station, a low battery, a fence breach, a lost position estimate.

The personality says which parameters set each failsafe; `EmulatedAutopilot.fail` carries out the action. Silence of
the ground station is measured in wall time `now_s`, because links are real; everything else in simulated time. The
autopilot itself detects the loss of a setpoint stream (`OffboardTimeout`).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

from gcs.types import Array
from sim_bridge.autopilot.autopilot import EmulatedAutopilot
from sim_bridge.missions.fence import FenceShape
from sim_bridge.personality import Intent, Note, Setting
from sim_bridge.personality.table import Actions, BatteryFailsafe

_PERIOD_S = 0.2
_HEIGHT, _RADIUS, _SHAPES = 1, 2, 4  # bits of FENCE_KINDS


class Breach(IntEnum):
    """FENCE_BREACH."""

    NONE = 0
    HEIGHT = 2
    BOUNDARY = 3


_CHARGE_STATES = {Note.BATTERY_LOW: 2, Note.BATTERY_CRITICAL: 3, Note.BATTERY_EMERGENCY: 4}
_NAMES = {_HEIGHT: "Max Alt", _RADIUS: "Circle", _SHAPES: "Polygon"}


@dataclass(frozen=True)
class Readings:
    """The measurements that failsafes check."""

    place_ned_m: Array  # (3,)
    volt: float
    used_Ah: float
    left_Ah: float
    share: float  # remaining share of the charge
    healthy: bool  # of the estimate


class Failsafe:
    """Watches one vehicle. `breach` is the present fence breach; `breaches` counts them."""

    def __init__(self, autopilot: EmulatedAutopilot) -> None:
        self._autopilot = autopilot
        self._failsafes = autopilot.personality.failsafes
        self._settings: Mapping[Setting, float] = {}
        self._shapes: tuple[FenceShape, ...] = ()
        self._next_check_s = -math.inf
        self._heard_s: float | None = None
        self._link_lost = False
        self._low_since_s: dict[Note, float] = {}
        self._low: set[Note] = set()
        self._placed_s = math.inf  # when the position was last known; inf before the first flight
        self.breach = Breach.NONE
        self.breaches = 0
        self.breached_s = 0.0
        self._told_s = 0.0  # of a breach

    def use(self, settings: Mapping[Setting, float]) -> None:
        """Apply these settings."""
        self._settings = settings

    def fence(self, shapes: Sequence[FenceShape]) -> None:
        """Set the polygons and circles of the fence."""
        self._shapes = tuple(shapes)

    def hear(self, sysid: int, now_s: float) -> None:
        """Take a HEARTBEAT of a ground station at wall time `now_s`."""
        if self._failsafes.link_only_ours and sysid != self._settings.get(Setting.GROUND_STATION):
            return
        self._heard_s = now_s
        if self._link_lost:
            self._link_lost = False
            self._autopilot.event_queue.add_text(Note.LINK_FOUND)

    def due(self, t_s: float) -> bool:
        """Whether the next check is due."""
        return t_s >= self._next_check_s

    def step(self, t_s: float, now_s: float, readings: Readings) -> None:
        """Run all failsafe checks."""
        self._next_check_s = t_s + _PERIOD_S
        self._watch_battery(t_s, readings)
        if self._autopilot.armed:
            self._watch_link(t_s, now_s)
        if self._autopilot.flying:
            self._watch_fence(t_s, readings.place_ned_m)
        self._watch_estimate(t_s, readings.healthy)

    @property
    def charge_state(self) -> int:
        """MAV_BATTERY_CHARGE_STATE of the battery failsafes so far: 1 is OK."""
        return max((_CHARGE_STATES[note] for note in self._low), default=1)

    @property
    def fenced(self) -> bool:
        """Whether a fence is enabled."""
        off = self._failsafes.fence_off
        return self._setting(Setting.FENCE_ENABLED) != 0.0 if off is None else self._value(Setting.FENCE_ACTION) != off

    def _watch_link(self, t_s: float, now_s: float) -> None:
        action = self._value(Setting.LINK_LOSS_ACTION)
        if self._heard_s is None or self._link_lost or not action:
            return
        if now_s - self._heard_s > self._setting(Setting.LINK_TIMEOUT_S):
            self._link_lost = True
            intent = self._failsafes.link.get(action)
            mode = self._autopilot.personality.modes.of(intent) if intent is not None else None
            self._autopilot.event_queue.add_text(Note.LINK_LOST, action=mode.name if mode is not None else "Continuing")
            self._act(t_s, intent)

    def _watch_estimate(self, t_s: float, healthy: bool) -> None:
        if healthy or not self._autopilot.flying:
            self._placed_s = t_s
        elif t_s - self._placed_s >= self._failsafes.estimate_timeout_s:
            self._placed_s = math.inf
            known = self._failsafes.estimate
            intent = known if isinstance(known, Intent) else known.get(self._value(Setting.ESTIMATE_ACTION))
            mode = self._autopilot.personality.modes.of(intent) if intent is not None else None
            if mode is not None and self._autopilot.mode.intent is not Intent.LAND:
                self._autopilot.event_queue.add_text(Note.PLACE_LOST, action=mode.name)
            self._act(t_s, intent)

    def _watch_battery(self, t_s: float, readings: Readings) -> None:
        for failsafe in self._failsafes.battery:
            if failsafe.note in self._low:
                continue
            if not self._is_low(failsafe, readings):
                self._low_since_s.pop(failsafe.note, None)
            elif t_s - self._low_since_s.setdefault(failsafe.note, t_s) >= self._failsafes.battery_timeout_s:
                self._low.add(failsafe.note)
                self._autopilot.event_queue.add_text(failsafe.note, volt=readings.volt, mAh=1000.0 * readings.used_Ah)
                self._act(t_s, self._chosen(failsafe.action, failsafe.actions))

    def _is_low(self, failsafe: BatteryFailsafe, readings: Readings) -> bool:
        if failsafe.volt is not None and readings.volt < self._setting(failsafe.volt):
            return True
        if failsafe.left is not None and readings.left_Ah < self._setting(failsafe.left):
            return True
        return failsafe.share is not None and readings.share < self._setting(failsafe.share)

    def _watch_fence(self, t_s: float, place_ned_m: Array) -> None:
        kind = self._crossed(place_ned_m) if self.fenced else 0
        before, self.breach = self.breach, _breach_of(kind)
        if not kind or (before is not Breach.NONE and t_s < self._told_s + self._failsafes.fence_repeats_s):
            return
        self._told_s = t_s
        self._autopilot.event_queue.add_text(Note.FENCE_BREACHED, fence=_NAMES[kind])
        if before is not Breach.NONE:
            return
        self.breaches += 1
        self.breached_s = t_s
        self._act(t_s, self._chosen(Setting.FENCE_ACTION, self._failsafes.fence))

    def _crossed(self, place_ned_m: Array) -> int:
        """The kind of fence that the vehicle has crossed; 0 for none."""
        kinds = int(self._settings.get(Setting.FENCE_KINDS, float(_HEIGHT | _RADIUS | _SHAPES)))
        north_m, east_m, down_m = (place_ned_m - self._autopilot.path_generator.home_ned_m).tolist()
        height_m, radius_m = self._setting(Setting.FENCE_HEIGHT_M), self._setting(Setting.FENCE_RADIUS_M)
        if kinds & _HEIGHT and 0.0 < height_m < -down_m:
            return _HEIGHT
        if kinds & _RADIUS and 0.0 < radius_m < math.hypot(north_m, east_m):
            return _RADIUS
        return _SHAPES if kinds & _SHAPES and self._beyond_shapes(*place_ned_m[:2].tolist()) else 0

    def _beyond_shapes(self, north_m: float, east_m: float) -> bool:
        wrong = [shape.violated(north_m, east_m) for shape in self._shapes]
        if not self._failsafes.one_area_suffices:
            return any(wrong)
        areas = [bad for bad, shape in zip(wrong, self._shapes, strict=True) if not shape.stay_outside]
        forbidden = any(bad for bad, shape in zip(wrong, self._shapes, strict=True) if shape.stay_outside)
        return forbidden or (bool(areas) and all(areas))

    def _act(self, t_s: float, intent: Intent | None) -> None:
        if intent is not None and self._autopilot.armed:
            self._autopilot.fail(t_s, intent)

    def _chosen(self, setting: Setting | None, actions: Actions) -> Intent | None:
        return actions.get(self._value(setting)) if setting is not None else None

    def _setting(self, setting: Setting) -> float:
        return self._settings.get(setting, 0.0)

    def _value(self, setting: Setting) -> int:
        return int(self._settings.get(setting, 0.0))


def _breach_of(kind: int) -> Breach:
    return Breach.NONE if not kind else Breach.HEIGHT if kind == _HEIGHT else Breach.BOUNDARY
