"""Where vehicles are and how to talk to them, before anything is opened.

Knows: that there are two backends, and how each is opened. Does not know: command lines, vehicles.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gcs.errors import UsageError
from gcs.link.mission_protocol.strategy import Transfer
from gcs.link.session.linked_fleet import FrameHook, LinkedFleet
from gcs.link.wire.signing_keys import signing_with

if TYPE_CHECKING:
    from gcs.link.mavsdk.mavsdk_vehicle import MavsdkFleet

BACKENDS = ("skein", "mavsdk")
TRANSFERS = tuple(str(way) for way in Transfer)


@dataclass(frozen=True)
class Connection:
    """Links as they are written (`udpin:HOST:PORT`), system ids that differ from the plan's, a key to sign with."""

    links: tuple[str, ...]
    systems: dict[int, int] = field(default_factory=dict)  # of plan vehicles that are called something else
    key: bytes | None = field(default=None, repr=False)
    transfer: str = "auto"  # one of TRANSFERS: how ArduPilot gets its mission

    @asynccontextmanager
    async def open_backend(self, backend: str) -> AsyncIterator[LinkedFleet | MavsdkFleet]:
        """The links by one of BACKENDS. Raises `UsageError`, `LinkError`."""
        if backend not in BACKENDS:
            raise UsageError(f"--backend {backend}: there are {' and '.join(BACKENDS)}")
        if backend == "skein":
            async with self.open() as fleet:
                yield fleet
            return
        if self.key is not None:
            raise UsageError("MAVSDK cannot sign", hint="leave the key away, or use --backend skein")
        if self.transfer == "file":
            raise UsageError("MAVSDK sends missions item by item", hint="leave --transfer away, or use --backend skein")
        from gcs.link.mavsdk.mavsdk_vehicle import MavsdkFleet  # noqa: PLC0415 (loading MAVSDK takes long, and few need it)

        async with MavsdkFleet.open(self.links) as foreign:
            yield foreign

    @asynccontextmanager
    async def open(self, on_frame: FrameHook | None = None) -> AsyncIterator[LinkedFleet]:
        """The links, open. Raises `UsageError`, `LinkError`."""
        signing = signing_with(self.key, asyncio.get_running_loop().time())
        async with LinkedFleet.open(
            self.links, on_frame=on_frame, signing=signing, transfer=Transfer(self.transfer)
        ) as fleet:
            yield fleet

    def __str__(self) -> str:
        return ", ".join(self.links)
