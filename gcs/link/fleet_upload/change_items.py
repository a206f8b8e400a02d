"""Replaces single items of the missions that are on board of all vehicles, also in flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Protocol

from gcs.aio import each
from gcs.link.fleet_upload.upload_fleet import Holdings
from gcs.link.fleet_upload.vehicle_load import VehicleLoad
from gcs.mission.model import MissionItem


class ItemChanger(Protocol):
    """One vehicle on a link that replaces items of its mission."""

    async def replace_items(self, items: Mapping[int, MissionItem], *, look_first: bool = False) -> None:
        """Replace items of the mission on board, by their index without home; read them back and compare."""


async def change_items(
    sessions: Mapping[int, ItemChanger],
    held: Holdings,
    loads: Sequence[VehicleLoad],
    indices: Mapping[int, Sequence[int]],
    *,
    look_first: bool = False,
) -> Holdings:
    """Replace the items with these indices, by vehicle; return the new proof of what is on board.

    `loads` are the loads to have, which differ from those of `held` in these items only. With `look_first` items that
    are on board already are not sent. Raises the first `PeerError` after the other vehicles have stopped: each of these
    items is then the old one or the new one.
    """

    async def change(load: VehicleLoad) -> None:
        items = {index: load.mission.items[index] for index in indices[load.sysid]}
        await sessions[load.sysid].replace_items(items, look_first=look_first)

    await each(loads, change)
    return replace(held, digests={load.sysid: load.digest(held.plan_hash) for load in loads})
