"""What one vehicle is to hold before it may start: mission, fence, rally points, parameters; and its hash.

Knows: items and values, how they look on the wire. Does not know: links, where plans come from.
"""

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
    """Everything for one vehicle. None leaves what the vehicle has; an empty tuple clears it."""

    mission: VehicleMission
    fence: tuple[MissionItem, ...] | None = None
    rally: tuple[MissionItem, ...] | None = None
    parameters: tuple[tuple[str, int | float], ...] = ()

    @property
    def sysid(self) -> int:
        """The vehicle it is for."""
        return self.mission.sysid

    @property
    def extras(self) -> tuple[tuple[MissionType, tuple[MissionItem, ...]], ...]:
        """What goes beside the mission, by type."""
        both = ((MissionType.FENCE, self.fence), (MissionType.RALLY, self.rally))
        return tuple((kind, items) for kind, items in both if items is not None)

    def digest(self, plan_hash: str) -> str:
        """SHA-256 over the plan's hash, the vehicle, and all that it is to hold, as the wire has it."""
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
