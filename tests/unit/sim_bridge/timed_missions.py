"""Missions of timed legs, flown by emulated vehicles without sockets: one vehicle for each, all in one batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs.autopilots.waypoint_models.navigator import Ability, Navigator, NavigatorOrders
from gcs.frames import Origin, ned_to_geodetic, to_degE7
from gcs.mission.model import Command, Frame, MissionItem
from gcs.types import Array
from sim_bridge.autopilot.autopilot import EmulatedAutopilot
from sim_bridge.autopilot.guidance.motion_primitives import MotionLimits
from sim_bridge.autopilot.guidance.path_generator import PathGenerator
from sim_bridge.autopilot.guidance.piece import PieceBatch
from sim_bridge.dynamics.airframes import CONTROL_PERIOD_S, Airframes, Craft
from sim_bridge.dynamics.presets import FIELD
from sim_bridge.dynamics.sensors import GRADES
from sim_bridge.personality import Intent, Personality
from tests.unit.sim_bridge.bodies import settings_of
from tests.unit.sim_bridge.flights import flat_ground

ORIGIN = Origin(47.4, 8.5, 488.0)
APART_M = 2000.0
HOLD_S = 3.0
STEP_S = CONTROL_PERIOD_S
# As strong as the vehicles that were recorded: nothing that the navigators ask for is too much.
LIMITS = MotionLimits(10.0, 4.0, 2.5, 1.5, 10.0, 20.0, 1.0, Ability(horizontal_mps2=6.0, vertical_mps2=5.0))


@dataclass(frozen=True)
class Flight:
    """What one vehicle did: times (M,) from leaving the first waypoint, true positions (M, 3) from its pad."""

    t_s: Array
    position_ned_m: Array
    reached_s: tuple[float, ...]  # when each waypoint but the last was completed


def items_of(orders: NavigatorOrders, personality: Personality, pad_ned_m: Array) -> tuple[MissionItem, ...]:
    """Take-off, the start with a hold, then a speed and a waypoint for every leg; heights count from the pad."""

    def fly_to(command: Command, place: tuple[float, float, float], hold_s: float = 0.0) -> MissionItem:
        lat, lon, _ = ned_to_geodetic(pad_ned_m + np.array([*place[:2], 0.0]), ORIGIN)
        params = (hold_s, 0.0, 0.0, 0.0)
        return MissionItem(command, Frame.GLOBAL_RELATIVE_ALT, params, to_degE7(lat), to_degE7(lon), -place[2])

    def speed(mps: float) -> MissionItem:
        return MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, (1.0, mps, -1.0, 0.0), 0, 0, 0.0)

    start = orders.start_ned_m
    items = [fly_to(Command.NAV_TAKEOFF, (0.0, 0.0, start[2])), speed(5.0), fly_to(Command.NAV_WAYPOINT, start, HOLD_S)]
    for place, mps in zip(orders.waypoints_ned_m, orders.speeds_mps, strict=True):
        items += [speed(mps), fly_to(Command.NAV_WAYPOINT, place)]
    home = (fly_to(Command.NAV_WAYPOINT, (0.0, 0.0, 0.0)),) if personality.missions.home_is_item_0 else ()
    return (*home, *items)


class Fleet:
    """Strong vehicles on flat ground in still air, with their autopilot's navigator, another one, or none (`ideal`)."""

    def __init__(
        self,
        personality: Personality,
        missions: Sequence[NavigatorOrders],
        *,
        ideal: bool = False,
        other: Navigator | None = None,
    ) -> None:
        count = len(missions)
        self.pads_ned_m = np.stack([np.zeros(count), APART_M * np.arange(count), np.zeros(count)], axis=1)
        self.bodies = Airframes(
            Craft(FIELD.quadrotor, FIELD.limits), flat_ground, self.pads_ned_m, np.zeros(count), GRADES["rtk"], seed=1
        )
        flown = other or personality.autopilot.navigator
        navigator = None if ideal else flown.within(LIMITS.ability)
        self.pilots = []
        for pad, orders in zip(self.pads_ned_m, missions, strict=True):
            path_generator = PathGenerator(LIMITS, ORIGIN, pad, navigator=navigator)
            pilot = EmulatedAutopilot(personality, path_generator, 0.0)
            pilot.use(settings_of(personality))
            pilot.progress.hold(items_of(orders, personality, pad))
            self.pilots.append(pilot)
        self._batch = PieceBatch([pilot.path.piece for pilot in self.pilots])
        self._steps = 0
        self._rows: list[list[tuple[float, int, Array]]] = [[] for _ in missions]

    @property
    def t_s(self) -> float:
        return self._steps * STEP_S

    def step(self) -> None:
        landed, healthy = self.bodies.landed.tolist(), self.bodies.healthy.tolist()
        truth = self.bodies.truth[:, :3] - self.pads_ned_m
        for row, pilot in enumerate(self.pilots):
            pilot.step(self.t_s, landed[row], healthy[row])
            pilot.events.clear()
            self._batch.put(row, pilot.path.piece)
            self._rows[row].append((self.t_s, pilot.progress.seq, truth[row].copy()))
        self.bodies.step(self._batch.reference(self.t_s), np.array([pilot.flying for pilot in self.pilots]))
        self._steps += 1

    def fly(self, patience_s: float = 600.0) -> list[Flight]:
        """Until all vehicles hover with nothing left to do."""
        while not all(pilot.readiness.ready for pilot in self.pilots):
            self.step()
        for row, pilot in enumerate(self.pilots):
            if not pilot.personality.modes.act_on_ground:
                assert pilot.pursue(self.t_s, Intent.GUIDED) == 0
                assert pilot.arm(self.t_s, self.bodies.estimate[row]) == 0
                assert pilot.start_mission(self.t_s, self.bodies.estimate[row]) == 0
            else:
                assert pilot.pursue(self.t_s, Intent.MISSION) == 0
                assert pilot.arm(self.t_s, self.bodies.estimate[row]) == 0
        while not all(pilot.flying and pilot.path.at_rest for pilot in self.pilots):
            self.step()
            assert self.t_s < patience_s
        return [self._flight(row) for row in range(len(self.pilots))]

    def _flight(self, row: int) -> Flight:
        t_s, seq, position = (np.array(column) for column in zip(*self._rows[row], strict=True))
        first_leg = 4 + self.pilots[row].progress.first
        changes = np.flatnonzero(np.diff(seq) > 0) + 1
        begin, *reached = changes[seq[changes] >= first_leg].tolist()
        left_s = float(t_s[begin])
        return Flight(t_s[begin:] - left_s, position[begin:], tuple(float(t_s[at]) - left_s for at in reached))
