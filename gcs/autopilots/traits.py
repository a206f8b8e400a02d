"""The autopilots Skein plans for, and how they differ as receivers of missions: home, frames, stores, speeds.

Knows: one row of numbers for each autopilot, with the source of each. Does not know: formats, links, commands
(`gcs.autopilots.mission_commands`), how they fly (`gcs.autopilots.navigation`). Peers may run others: their numbers
stay plain ints.
"""

from __future__ import annotations

from enum import IntEnum


class Autopilot(IntEnum):
    """MAV_AUTOPILOT values of the autopilots missions are written for."""

    ARDUPILOT = 3
    PX4 = 12

    @property
    def title(self) -> str:
        """Its name for people."""
        return "ArduCopter" if self is Autopilot.ARDUPILOT else "PX4"

    @property
    def key(self) -> str:
        """As scenarios and the command line name it ("ardupilot", "px4")."""
        return self.name.lower()

    @property
    def home_is_item_0(self) -> bool:
        """Whether item 0 of a stored mission is home (ArduPilot) or already flown to (PX4)."""
        return self is Autopilot.ARDUPILOT

    @property
    def frames(self) -> frozenset[int]:
        """Altitude frames of items that name a place. PX4 answers MISSION_UNSUPPORTED_FRAME to heights above ground."""
        return _AMSL | _ABOVE_HOME | (_ABOVE_GROUND if self is Autopilot.ARDUPILOT else frozenset())

    @property
    def items_max(self) -> int:
        """Items a mission may have, home included where it counts.

        ArduCopter 4.5 and 4.7 answered NO_SPACE to the 651st. PX4 keeps 500 on its smaller boards, more with more
        memory (NUM_MISSIONS_SUPPORTED).
        """
        return 650 if self is Autopilot.ARDUPILOT else 500

    @property
    def fence_items_max(self) -> int:
        """Vertices and circles of a fence: 70 in ArduPilot's manual, 64 less one in PX4 (DM_KEY_FENCE_POINTS)."""
        return 70 if self is Autopilot.ARDUPILOT else 63

    @property
    def rally_points_max(self) -> int:
        """Places to return to: ArduPilot's stores hold 10 or more, PX4's oldest 8 less one."""
        return 10 if self is Autopilot.ARDUPILOT else 7

    @property
    def inside_every_inclusion(self) -> bool:
        """Whether a vehicle must be inside all inclusion areas (ArduPilot) or inside one of them (PX4)."""
        return self is Autopilot.ARDUPILOT

    @property
    def speed_mps(self) -> tuple[float, float]:
        """Slowest and fastest ground speed it takes from DO_CHANGE_SPEED.

        ArduCopter ignores less than WPNAV_WP_SPEED_MIN and limits WPNAV_SPEED to 20 m/s; PX4 flies no faster than
        MPC_XY_VEL_MAX, 12 m/s unless changed.
        """
        return (0.2, 20.0) if self is Autopilot.ARDUPILOT else (0.1, 12.0)

    @property
    def default_speed_mps(self) -> float:
        """Ground speed where a mission asks for none: WPNAV_SPEED, MPC_XY_CRUISE."""
        return 10.0 if self is Autopilot.ARDUPILOT else 5.0

    @property
    def climb_mps(self) -> tuple[float, float]:
        """Speeds up and down unless changed: WPNAV_SPEED_UP and _DN, MPC_Z_V_AUTO_UP and _DN."""
        return (2.5, 1.5) if self is Autopilot.ARDUPILOT else (3.0, 1.5)

    @classmethod
    def named(cls, name: str) -> Autopilot:
        """The autopilot of a `key`. Raises KeyError for another."""
        return cls[name.upper()]


# MAV_FRAME as files and as links write it
_AMSL, _ABOVE_HOME, _ABOVE_GROUND = frozenset({0, 5}), frozenset({3, 6}), frozenset({10, 11})
