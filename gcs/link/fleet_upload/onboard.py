"""What a vehicle holds: mission, fence, rally points, read once; and how that differs from what it should hold.

Knows: items of all types, home as item 0. Does not know: files, plans.
"""

from __future__ import annotations

from dataclasses import dataclass

from gcs.errors import PeerError
from gcs.frames import from_degE7
from gcs.link.fleet_upload.vehicle_load import VehicleLoad
from gcs.link.mission_protocol.read_back import compare_missions
from gcs.link.session.vehicle_api import Loadable
from gcs.mavlink import MissionType
from gcs.mission.geofence import BadItem, Geofence, RallyPoint, fence_from_items, rally_from_items
from gcs.mission.model import Home, MissionItem


@dataclass(frozen=True)
class OnboardState:
    """Everything one vehicle holds; home does not count as an item."""

    sysid: int
    autopilot: int
    home: Home | None
    mission: tuple[MissionItem, ...]
    fence: tuple[MissionItem, ...]
    rally: tuple[MissionItem, ...]

    def geofence(self) -> Geofence:
        """The fence as shapes. Raises `PeerError` where it is none (PX4 stores any items)."""
        try:
            return fence_from_items(self.fence)
        except BadItem as error:
            raise PeerError(f"vehicle {self.sysid} holds a fence that is none: {error}.") from None

    def rally_points(self) -> tuple[RallyPoint, ...]:
        """The rally points. Raises `PeerError` where an item is none."""
        try:
            return rally_from_items(self.rally)
        except BadItem as error:
            raise PeerError(f"vehicle {self.sysid} holds rally points that are none: {error}.") from None

    def differences(self, load: VehicleLoad) -> list[str]:
        """In words, what is not as `load` has it; what the load leaves alone is not looked at."""
        parts = [("mission", load.mission.items, self.mission)]
        parts += [("fence", items, self.fence) for items in (load.fence,) if items is not None]
        parts += [("rally points", items, self.rally) for items in (load.rally,) if items is not None]
        return [
            f"{name}, item {d.item}: {d.what} should be {d.sent}, is {d.read_back}"
            for name, wanted, found in parts
            for d in compare_missions(wanted, found, autopilot=self.autopilot)
        ]


async def read_onboard(session: Loadable) -> OnboardState:
    """Download everything. Raises `PeerError`."""
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
