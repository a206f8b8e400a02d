"""The load of one vehicle (mission, fence, rally points, parameters) and its hash."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Sequence
from dataclasses import dataclass

from gcs.mavlink import MissionType
from gcs.mission.model import MissionItem, VehicleMission

_ITEM = struct.Struct("<HB4fiifB")


@dataclass(frozen=True)
class VehicleLoad:
    """The load of one vehicle. None leaves the items on board unchanged; an empty tuple clears them."""

    mission: VehicleMission
    fence: tuple[MissionItem, ...] | None = None
    rally: tuple[MissionItem, ...] | None = None
    parameters: tuple[tuple[str, int | float], ...] = ()

    @property
    def sysid(self) -> int:
        """The number of the vehicle."""
        return self.mission.sysid

    @property
    def extras(self) -> tuple[tuple[MissionType, tuple[MissionItem, ...]], ...]:
        """Fence and rally points by type, if the load includes them."""
        both = ((MissionType.FENCE, self.fence), (MissionType.RALLY, self.rally))
        return tuple((kind, items) for kind, items in both if items is not None)

    def digest(self, plan_hash: str) -> str:
        """Return SHA-256 over the plan's hash, the vehicle, and its load in the format of the wire."""
        parts = hashlib.sha256(f"{plan_hash} {self.sysid} {self.mission.home}".encode())
        for kind, items in ((MissionType.MISSION, self.mission.items), *self.extras):
            parts.update(struct.pack("<BH", kind, len(items)))
            parts.update(_packed(items))
        for name, value in self.parameters:
            parts.update(f"{name}={value!r};".encode())
        return parts.hexdigest()


def _packed(items: Sequence[MissionItem]) -> bytes:
    return b"".join(
        _ITEM.pack(i.command, i.frame, *i.params, i.lat_degE7, i.lon_degE7, i.alt_m, i.autocontinue) for i in items
    )
