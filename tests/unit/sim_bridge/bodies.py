"""A body that stands where its autopilot wants it, on a fake clock, above flat ground at the height of home."""

from __future__ import annotations

import numpy as np

from gcs.frames import Origin, ned_to_geodetic, to_degE7
from gcs.mavlink import LandedState, MavResult
from gcs.mission.model import Command, Frame, MissionItem
from sim_bridge.autopilot.autopilot import EmulatedAutopilot
from sim_bridge.autopilot.events import ModeChanged, Reached, Said
from sim_bridge.autopilot.guidance.motion_primitives import MotionLimits
from sim_bridge.autopilot.guidance.path_generator import PathGenerator
from sim_bridge.personality import ARDUPILOT, Intent, Personality, Setting

LIMITS = MotionLimits(4.0, 1.6, 1.0, 0.2, 0.85, 0.5, 0.07)
ORIGIN = Origin(47.4, 8.5, 488.0)
HOME = np.array([10.0, 20.0, -1.0])
YAW = 0.6
OK = MavResult.ACCEPTED


def settings_of(personality: Personality) -> dict[Setting, float]:
    return {param.sets: param.value * param.unit for param in personality.params if param.sets is not None}


class Body:
    """`told` is all that was said, `states` the landed states and `currents` the current items as they changed."""

    def __init__(self, personality: Personality = ARDUPILOT, *, ready: bool = True) -> None:
        path_generator = PathGenerator(
            LIMITS, ORIGIN, HOME, speed_mps=3.0, land_mps=0.5, descend_mps=1.5, rtl_height_m=15.0
        )
        self.pilot = EmulatedAutopilot(personality, path_generator, YAW)
        self.settings = settings_of(personality)
        self.pilot.use(self.settings)
        self.t_s = 0.0
        self.healthy = True
        self.told: list = []
        self.states: list[LandedState] = []
        self.currents: list[int] = []
        if ready:
            self.run(5.0)
            assert self.pilot.readiness.ready
            self.told.clear()

    @property
    def down_m(self) -> float:
        return float(self.pilot.path.piece.at(self.t_s)[0, 2])

    @property
    def height_m(self) -> float:
        return float(HOME[2]) - self.down_m

    @property
    def speed_mps(self) -> float:
        return float(np.linalg.norm(self.pilot.path.piece.at(self.t_s)[1, :3]))

    @property
    def estimate(self) -> np.ndarray:
        flat = self.pilot.path.piece.at(self.t_s)
        place = np.minimum(flat[0, :3], [1e9, 1e9, HOME[2]])
        return np.concatenate([place, flat[1, :3], [0, 0, flat[0, 3]], np.zeros(3)])

    def step(self) -> None:
        self.t_s = round(self.t_s + 0.01, 6)
        self.pilot.step(self.t_s, self.down_m >= HOME[2] - 1e-3, self.healthy)
        self.told += self.pilot.events
        self.pilot.events.clear()
        for seen, value in (
            (self.states, self.pilot.mode_actions.landed_state),
            (self.currents, self.pilot.progress.seq),
        ):
            if not seen or seen[-1] != value:
                seen.append(value)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            self.step()

    def run_until(self, condition, patience_s: float = 120.0) -> float:
        """Seconds until the condition holds."""
        start_s = self.t_s
        while not condition():
            self.step()
            assert self.t_s - start_s < patience_s
        return self.t_s - start_s

    def arm(self) -> MavResult:
        return self.pilot.arm(self.t_s, self.estimate)

    def mode(self, intent: Intent) -> MavResult:
        return self.pilot.pursue(self.t_s, intent)

    @property
    def intent(self) -> Intent:
        return self.pilot.mode.intent

    def texts(self) -> list[str]:
        return [e.text for e in self.told + self.pilot.events if isinstance(e, Said)]

    def reached(self) -> list[int]:
        return [e.seq for e in self.told if isinstance(e, Reached)]

    def mode_changes(self) -> int:
        return sum(isinstance(e, ModeChanged) for e in self.told + self.pilot.events)

    def fly(self, height_m: float = 3.0) -> None:
        """Hover at a height, in the mode that follows a ground station or stands."""
        if self.pilot.personality.flight.takeoff_in_guided:
            assert self.mode(Intent.GUIDED) == OK
            assert self.arm() == OK
            assert self.pilot.take_off(self.t_s, height_m) == OK
        else:
            assert self.pilot.take_off(self.t_s, height_m) == OK
            assert self.arm() == OK
        self.run(25.0)
        assert self.pilot.mode_actions.landed_state == LandedState.IN_AIR


def item(command: int, place: tuple[float, float, float] | None = None, **params: float) -> MissionItem:
    """An item at `place`: metres north and east of home, and above it."""
    p = tuple(params.get(f"p{i}", 0.0) for i in range(1, 5))
    if place is None:
        return MissionItem(command, Frame.MISSION, p, 0, 0, 0.0)
    lat, lon, _ = ned_to_geodetic(HOME + np.array([place[0], place[1], 0.0]), ORIGIN)
    return MissionItem(command, Frame.GLOBAL_RELATIVE_ALT, p, to_degE7(lat), to_degE7(lon), place[2])


def mission(personality: Personality = ARDUPILOT) -> tuple[MissionItem, ...]:
    """Take-off, a speed, waypoints, a delay, landing; preceded by home where home is an item."""
    flown = (
        MissionItem(Command.NAV_TAKEOFF, Frame.GLOBAL_RELATIVE_ALT, (0.0, 0.0, 0.0, 0.0), 0, 0, 5.0),
        item(Command.DO_CHANGE_SPEED, p1=1.0, p2=2.0, p3=-1.0),
        item(Command.NAV_WAYPOINT, (8, 0, 5)),
        item(Command.NAV_WAYPOINT, (8, 8, 6)),
        item(Command.NAV_DELAY, p1=3.0),
        item(Command.NAV_WAYPOINT, (0, 8, 5)),
        item(Command.NAV_LAND, (0, 0, 0)),
    )
    home = MissionItem(Command.NAV_WAYPOINT, Frame.GLOBAL, (0.0,) * 4, 474000000, 85000000, 489.0)
    return (home, *flown) if personality is ARDUPILOT else flown
