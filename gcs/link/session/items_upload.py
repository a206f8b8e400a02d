"""Uploads items to one vehicle, as a file or item by item, reads them back and compares them."""

from collections.abc import Sequence
from typing import Protocol

from gcs.autopilots.traits import autopilot_name
from gcs.errors import PeerError
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.machine import Machine
from gcs.link.protocols.mission.file_upload import FileUpload
from gcs.link.protocols.mission.strategy import Preferred, SentAs, Transfer, planned
from gcs.link.protocols.mission.verified_upload import VerifiedUpload
from gcs.mavlink import MissionType
from gcs.mission.model import MissionItem


class Uploading(Protocol):
    """What an upload needs of the session with a vehicle."""

    sysid: int
    exchange: Exchange

    async def run(self, machine: Machine) -> None:
        """Run a machine until it is done. Raises its error."""

    async def offers_files(self) -> bool | None:
        """Whether it reports MAVLink FTP; None where it is not known."""


async def upload(
    session: Uploading, items: Sequence[MissionItem], mission_type: int, transfer: Transfer
) -> tuple[VerifiedUpload | FileUpload, SentAs]:
    """Return the finished machine that put the items on board, and how they were sent.

    Raises the errors of both machines, and `PeerError` where a file is required and the autopilot takes none.
    """
    exchange = session.exchange
    autopilot = exchange.autopilot
    file_required = transfer is Transfer.FILE and mission_type == MissionType.MISSION and len(items) > 0
    if file_required and not exchange.link.mission_files:
        raise PeerError(
            f"vehicle {session.sysid} takes no missions as files: {autopilot_name(autopilot)} cannot.",
            hint="use --transfer auto or items",
        )
    by_items = VerifiedUpload(items, exchange, mission_type=mission_type)
    way = planned(transfer, autopilot, mission_type, len(items))
    if way.transfer is Transfer.FILE and not file_required:
        way = await _as_offered(session, way)
    if way.transfer is Transfer.ITEMS:
        await session.run(by_items)
        return by_items, way
    as_file = FileUpload(items, exchange)
    either = Preferred(as_file, by_items)
    await session.run(as_file if file_required else either)
    if either.failed is None:
        return as_file, way
    return by_items, SentAs(Transfer.ITEMS, f"the file failed: {either.failed.message}")


async def _as_offered(session: Uploading, way: SentAs) -> SentAs:
    """Items instead of a file unless the vehicle reports MAVLink FTP in AUTOPILOT_VERSION."""
    offers = await session.offers_files()
    if offers is None:
        return SentAs(Transfer.ITEMS, "AUTOPILOT_VERSION did not arrive, so it may take no files")
    return way if offers else SentAs(Transfer.ITEMS, "no MAVLink FTP in AUTOPILOT_VERSION")
