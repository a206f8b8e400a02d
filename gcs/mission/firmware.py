"""What differs between the autopilots as receivers of missions: home, frames, stores, speeds.

Knows: one row of numbers for each autopilot, with the source of each. Does not know: formats, links, commands
(`commands`), how they fly (`navigator`).
"""

from __future__ import annotations

from enum import IntEnum

from gcs.mission.model import Frame


class Firmware(IntEnum):
    """MAV_AUTOPILOT values of the autopilots missions are written for."""

    ARDUPILOT = 3
    PX4 = 12

    @property
    def title(self) -> str:
        """Its name for people."""
        return "ArduCopter" if self is Firmware.ARDUPILOT else "PX4"

    @property
    def home_is_item_0(self) -> bool:
        """Whether item 0 of a stored mission is home (ArduPilot) or already flown to (PX4)."""
        return self is Firmware.ARDUPILOT

    @property
    def frames(self) -> frozenset[int]:
        """Altitude frames of items that name a place. PX4 answers MISSION_UNSUPPORTED_FRAME to heights above ground."""
        amsl_and_home = {Frame.GLOBAL, Frame.GLOBAL_RELATIVE_ALT, _GLOBAL_INT, _RELATIVE_INT}
        if self is Firmware.ARDUPILOT:
            return frozenset({*amsl_and_home, Frame.GLOBAL_TERRAIN_ALT, _TERRAIN_INT})
        return frozenset(amsl_and_home)

    @property
    def items_max(self) -> int:
        """Items a mission may have, home included where it counts.

        ArduCopter 4.5 and 4.7 answered NO_SPACE to the 651st. PX4 keeps 500 on its smaller boards, more with more
        memory (NUM_MISSIONS_SUPPORTED).
        """
        return 650 if self is Firmware.ARDUPILOT else 500

    @property
    def fence_items_max(self) -> int:
        """Vertices and circles of a fence: 70 in ArduPilot's manual, 64 less one in PX4 (DM_KEY_FENCE_POINTS)."""
        return 70 if self is Firmware.ARDUPILOT else 63

    @property
    def rally_points_max(self) -> int:
        """Places to return to: ArduPilot's stores hold 10 or more, PX4's oldest 8 less one."""
        return 10 if self is Firmware.ARDUPILOT else 7

    @property
    def inside_every_inclusion(self) -> bool:
        """Whether a vehicle must be inside all inclusion areas (ArduPilot) or inside one of them (PX4)."""
        return self is Firmware.ARDUPILOT

    @property
    def speed_mps(self) -> tuple[float, float]:
        """Slowest and fastest ground speed it takes from DO_CHANGE_SPEED.

        ArduCopter ignores less than WPNAV_WP_SPEED_MIN and limits WPNAV_SPEED to 20 m/s; PX4 flies no faster than
        MPC_XY_VEL_MAX, 12 m/s unless changed.
        """
        return (0.2, 20.0) if self is Firmware.ARDUPILOT else (0.1, 12.0)

    @property
    def default_speed_mps(self) -> float:
        """Ground speed where a mission asks for none: WPNAV_SPEED, MPC_XY_CRUISE."""
        return 10.0 if self is Firmware.ARDUPILOT else 5.0

    @property
    def climb_mps(self) -> tuple[float, float]:
        """Speeds up and down unless changed: WPNAV_SPEED_UP and _DN, MPC_Z_V_AUTO_UP and _DN."""
        return (2.5, 1.5) if self is Firmware.ARDUPILOT else (3.0, 1.5)

    @classmethod
    def named(cls, name: str) -> Firmware:
        """The autopilot a scenario names ("ardupilot", "px4")."""
        return cls[name.upper()]


_GLOBAL_INT, _RELATIVE_INT, _TERRAIN_INT = 5, 6, 11  # the same on the wire
