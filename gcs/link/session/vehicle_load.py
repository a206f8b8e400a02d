"""The load of one vehicle (mission, fence, rally points, parameters), its hash, and what is on board instead."""

import hashlib
import struct
from collections.abc import Sequence
from dataclasses import dataclass

from gcs.errors import PeerError
from gcs.frames import from_degE7
from gcs.link.protocols.mission.read_back import compare_missions
from gcs.link.session.vehicle_api import Loadable
from gcs.mavlink import MissionType
from gcs.mission.geofence import BadItem, Geofence, RallyPoint, fence_from_items, rally_from_items
from gcs.mission.model import Home, MissionItem, VehicleMission

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
            parts.update(packed(items))
        for name, value in self.parameters:
            parts.update(f"{name}={value!r};".encode())
        return parts.hexdigest()


def packed(items: Sequence[MissionItem]) -> bytes:
    """Return items as on the wire. Raises `struct.error` or `OverflowError` for values out of range."""
    return b"".join(
        _ITEM.pack(i.command, i.frame, *i.params, i.lat_degE7, i.lon_degE7, i.alt_m, i.autocontinue) for i in items
    )


@dataclass(frozen=True)
class OnboardState:
    """All items on board of one vehicle, without home."""

    sysid: int
    autopilot: int
    home: Home | None
    mission: tuple[MissionItem, ...]
    fence: tuple[MissionItem, ...]
    rally: tuple[MissionItem, ...]

    def geofence(self) -> Geofence:
        """Return the fence as shapes. Raises `PeerError` if its items are invalid (PX4 stores any items)."""
        try:
            return fence_from_items(self.fence)
        except BadItem as error:
            raise PeerError(f"vehicle {self.sysid} has an invalid fence on board: {error}.") from None

    def rally_points(self) -> tuple[RallyPoint, ...]:
        """Return the rally points. Raises `PeerError` if an item is invalid."""
        try:
            return rally_from_items(self.rally)
        except BadItem as error:
            raise PeerError(f"vehicle {self.sysid} has invalid rally points on board: {error}.") from None

    def differences(self, load: VehicleLoad) -> list[str]:
        """Return the differences from `load` in words. Parts that the load does not include are not compared."""
        parts = [("mission", load.mission.items, self.mission)]
        parts += [("fence", items, self.fence) for items in (load.fence,) if items is not None]
        parts += [("rally points", items, self.rally) for items in (load.rally,) if items is not None]
        return [
            f"{name}, item {d.item}: {d.what} required {d.sent}, on board {d.read_back}"
            for name, wanted, found in parts
            for d in compare_missions(wanted, found, autopilot=self.autopilot)
        ]


async def read_onboard(session: Loadable) -> OnboardState:
    """Download all items of one vehicle. Raises `PeerError`."""
    items = await session.download(MissionType.MISSION)
    fence = await session.download(MissionType.FENCE)
    rally = await session.download(MissionType.RALLY)
    home: Home | None = None
    if session.home_is_item_0 and items:
        first, items = items[0], items[1:]
        home = Home(from_degE7(first.lat_degE7), from_degE7(first.lon_degE7), first.alt_m)
    else:
        home = await session.home()
    return OnboardState(session.sysid, session.autopilot, home, items, fence, rally)
