"""What a vehicle has to offer so that it can be loaded: the same from our own sessions and from MAVSDK's.

Knows: names and promises. Does not know: who keeps them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from gcs.link.parameter import Parameter
from gcs.mission.model import Home, MissionItem, VehicleMission


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
