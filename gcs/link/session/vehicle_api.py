"""What can be asked of a vehicle in flight, the same from our own sessions and from MAVSDK's.

Knows: names, frames and promises. Does not know: who keeps them. Nothing here flies a plan: streams of a formation are
stamped, and checked before (`gcs.flight`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from gcs.link.microservices.parameter import Parameter
from gcs.mission.model import Home, MissionItem, VehicleMission

Ned = tuple[float, float, float]


@dataclass(frozen=True)
class Setpoint:
    """Where to be and how to move there, in the vehicle's own local frame (its origin is where it was switched on)."""

    position_ned_m: Ned
    velocity_ned_mps: Ned = (0.0, 0.0, 0.0)
    acceleration_ned_mps2: Ned = (0.0, 0.0, 0.0)
    yaw_ned_rad: float = 0.0


class Flyable(Protocol):
    """One vehicle. Every call returns when the vehicle has taken it up; `PeerError` says why it did not."""

    async def arm(self) -> None:
        """Lets its motors turn, in a mode it can take off in."""

    async def take_off(self, height_m: float) -> None:
        """Climbs so high above its home; returns at once."""

    async def hold(self) -> None:
        """Stays where it is."""

    async def land(self) -> None:
        """Lands where it is; returns at once."""

    async def return_home(self) -> None:
        """Flies home and lands there, by its own autopilot; returns at once."""

    async def follow(self, setpoint: Setpoint) -> None:
        """Flies to a setpoint, which is repeated until the next one, or until it is told something else."""

    async def close(self) -> None:
        """Ends what is repeated. The vehicle then does what its autopilot does when a stream ends."""


class Loadable(Protocol):
    """One vehicle on a link. Whatever fails raises `PeerError`."""

    sysid: int

    @property
    def autopilot(self) -> int:
        """MAV_AUTOPILOT."""

    @property
    def armed(self) -> bool:
        """Whether its last heartbeat says so."""

    @property
    def home_is_item_0(self) -> bool:
        """Whether its missions carry home as item 0."""

    def heartbeat_age_s(self) -> float:
        """Seconds since it was heard."""

    async def deliver(self, items: Sequence[MissionItem], mission_type: int = 0) -> object:
        """Sends items (none: clears), reads them back and compares; returns once the vehicle holds them."""

    async def upload_mission(self, mission: VehicleMission) -> object:
        """The same with a mission and its home."""

    async def download(self, mission_type: int = 0) -> tuple[MissionItem, ...]:
        """What the vehicle holds."""

    async def read_parameters(self, names: Sequence[str]) -> dict[str, Parameter]:
        """Parameters by name."""

    async def write_parameters(self, parameters: Sequence[Parameter]) -> None:
        """Sets parameters in the vehicle's own types."""

    async def home(self) -> Home | None:
        """Where its home is; None while it has none."""
