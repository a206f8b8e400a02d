"""Mission items and setpoints as plain values in SI units and degE7: what files hold and what links carry."""

from dataclasses import dataclass
from enum import IntEnum, StrEnum

import numpy as np

from gcs.frames import Origin, from_degE7
from gcs.mavlink import MavCommand
from gcs.types import Array


class Frame(IntEnum):
    """MAV_FRAME values that occur in missions."""

    GLOBAL = 0  # altitude AMSL
    MISSION = 2  # no position
    GLOBAL_RELATIVE_ALT = 3  # altitude above home
    GLOBAL_TERRAIN_ALT = 10


class Altitude(StrEnum):
    """The datum of a mission's altitudes."""

    RELATIVE = "relative"  # the vehicle's own home
    AMSL = "amsl"  # mean sea level
    TERRAIN = "terrain"  # the ground under the vehicle, along the whole leg

    @property
    def frame(self) -> Frame:
        """The frame of items with such altitudes."""
        return Frame({"amsl": 0, "relative": 3, "terrain": 10}[self])


Command = MavCommand  # of mission items
Home = Origin  # the start position of a vehicle, on the ground: the origin of its own local frame


@dataclass(frozen=True)
class MissionItem:
    """One mission item. Commands and frames are plain ints so that unknown ones survive a round trip.

    `lat_degE7`/`lon_degE7` hold what goes on the wire for position frames (0 for items without a position);
    `alt_m` is metres in the altitude frame that `frame` names.
    """

    command: int
    frame: int
    params: tuple[float, float, float, float]
    lat_degE7: int
    lon_degE7: int
    alt_m: float
    autocontinue: bool = True

    @property
    def place_deg(self) -> tuple[float, float]:
        """Its latitude and longitude, degrees."""
        return from_degE7(self.lat_degE7), from_degE7(self.lon_degE7)


@dataclass(frozen=True)
class VehicleMission:
    """The mission of one vehicle, for any autopilot: home is not an item here."""

    sysid: int
    home: Home
    items: tuple[MissionItem, ...]
    arrival_s: tuple[float | None, ...]  # plan time at which each item with a position is reached, else None
    leaves_s: float = 0.0  # plan time at which all vehicles leave the hover after the take-off
    gates: tuple[tuple[int, float], ...] = ()  # index of a delay, and the plan time at which all vehicles continue


@dataclass(frozen=True)
class SetpointStream:
    """Timed setpoints of all vehicles in the formation's common local NED frame."""

    sysids: tuple[int, ...]
    t_s: Array  # (N,) plan time, 0 = T0
    position_ned_m: Array  # (V, N, 3)
    velocity_ned_mps: Array  # (V, N, 3)
    acceleration_ned_mps2: Array  # (V, N, 3)
    yaw_ned_rad: Array  # (V, N)

    def __post_init__(self) -> None:
        shape = (len(self.sysids), len(self.t_s))
        arrays = (self.position_ned_m, self.velocity_ned_mps, self.acceleration_ned_mps2)
        if any(a.shape != (*shape, 3) for a in arrays) or self.yaw_ned_rad.shape != shape:
            raise ValueError(f"setpoint arrays must be {(*shape, 3)} and yaw {shape}")
        if not all(np.isfinite(a).all() for a in (*arrays, self.yaw_ned_rad)):
            raise ValueError("setpoints must be finite")
