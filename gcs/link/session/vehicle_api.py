"""The interface of one vehicle, the same for both backends: `Loadable` before the flight, `Flyable` in flight.

Every failure raises `PeerError`. A flight of a formation does not use `Flyable`: its setpoints are time-stamped
(`gcs.flight`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from gcs.link.protocols.mission.strategy import SentAs
from gcs.link.protocols.parameter_transfer import Parameter
from gcs.mission.model import Home, MissionItem, VehicleMission


class Loadable(Protocol):
    """One vehicle on a link, before the flight."""

    sysid: int

    @property
    def autopilot(self) -> int:
        """MAV_AUTOPILOT."""

    @property
    def armed(self) -> bool:
        """Whether it is armed, by its last heartbeat."""

    @property
    def home_is_item_0(self) -> bool:
        """Whether item 0 of its missions is home."""

    @property
    def sent_as(self) -> SentAs | None:
        """How its last mission went, and why so; None before the first."""

    def heartbeat_age_s(self) -> float:
        """Return the time since its last heartbeat, s."""

    async def upload_items(self, items: Sequence[MissionItem], mission_type: int = 0) -> object:
        """Upload items (an empty list clears), read them back and compare; return once they are on board."""

    async def upload_mission(self, mission: VehicleMission) -> object:
        """Upload a mission with its home, read it back and compare."""

    async def download(self, mission_type: int = 0) -> tuple[MissionItem, ...]:
        """Return the items on board."""

    async def read_parameters(self, names: Sequence[str]) -> dict[str, Parameter]:
        """Return parameters by the requested names, each with the name and unit that this vehicle has for it."""

    async def write_parameters(self, parameters: Sequence[Parameter]) -> None:
        """Set parameters in the vehicle's own types."""

    async def home(self) -> Home | None:
        """Return its home position; None if it has none."""


Ned = tuple[float, float, float]


@dataclass(frozen=True)
class Setpoint:
    """Position, velocity, acceleration and yaw in the vehicle's own local frame (origin: where it was switched on)."""

    position_ned_m: Ned
    velocity_ned_mps: Ned = (0.0, 0.0, 0.0)
    acceleration_ned_mps2: Ned = (0.0, 0.0, 0.0)
    yaw_ned_rad: float = 0.0


class Flyable(Protocol):
    """One vehicle in flight. Every call returns once the vehicle has accepted it."""

    async def arm(self) -> None:
        """Arm in a mode that allows take-off."""

    async def take_off(self, height_m: float) -> None:
        """Take off to `height_m` above its home. Does not wait for the climb."""

    async def hold(self) -> None:
        """Hold position."""

    async def land(self) -> None:
        """Land at the present position. Does not wait for the landing."""

    async def return_home(self) -> None:
        """Start the autopilot's return (RTL), which ends with a landing. Does not wait for it."""

    async def follow(self, setpoint: Setpoint) -> None:
        """Fly to a setpoint, which is repeated until the next setpoint or the next other call."""

    async def close(self) -> None:
        """End the repetition of setpoints. The autopilot then acts as at the end of a setpoint stream."""
