"""Connection settings: link names, system ids, signing key, backend."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Collection, Sequence
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gcs.errors import LinkError, UsageError
from gcs.link.endpoints.base import LinkMode, LinkSpec, parse_link_spec
from gcs.link.endpoints.endpoint import Endpoint, UdpEndpoint
from gcs.link.protocols.mission.strategy import Transfer
from gcs.link.session.linked_fleet import FrameDirection, FrameHook, LinkedFleet, NoticeHook
from gcs.link.wire.frame_scanner import frame_system
from gcs.link.wire.signing_keys import signing_with

if TYPE_CHECKING:
    from gcs.link.session.mavsdk_vehicle import MavsdkFleet

BACKENDS = ("skein", "mavsdk")
_HERE = ("127.0.0.1", "::1", "localhost")
_EVERYWHERE = ("0.0.0.0", "::")


@dataclass(frozen=True)
class Connection:
    """The links by name (`udpin:HOST:PORT`), system ids that differ from the plan, and the signing key."""

    links: tuple[str, ...]
    systems: dict[int, int] = field(default_factory=dict)  # of plan vehicles with another MAVLink system id
    key: bytes | None = field(default=None, repr=False)
    transfer: str = "auto"  # a `Transfer`: as a file or item by item
    also_to: tuple[str, ...] = ()  # `udpout:HOST:PORT`: every frame of the vehicles is copied there, one way
    radio_baud: int | None = None  # of a radio behind the links that all vehicles share

    @property
    def slowest_baud(self) -> int | None:
        """The baud of the slowest serial line or radio; None without one."""
        specs = [parse_link_spec(link) for link in self.links]
        serial = [spec.port for spec in specs if spec.mode is LinkMode.SERIAL]
        return min([*serial, *([] if self.radio_baud is None else [self.radio_baud])], default=None)

    @asynccontextmanager
    async def open_backend(self, backend: str) -> AsyncIterator[LinkedFleet | MavsdkFleet]:
        """The open links of one of BACKENDS. Raises `UsageError`, `LinkError`."""
        if backend not in BACKENDS:
            raise UsageError(f"--backend {backend} is not known.", hint=f"use {' or '.join(BACKENDS)}")
        if backend == "skein":
            async with self.open() as fleet:
                yield fleet
            return
        if self.key is not None:
            raise UsageError(
                "MAVSDK cannot sign, and a signing key is given.", hint="remove the key, or use --backend skein"
            )
        if self.transfer == Transfer.FILE:
            raise UsageError(
                "MAVSDK sends missions item by item, and --transfer file is given.",
                hint="remove --transfer, or use --backend skein",
            )
        from gcs.link.session.mavsdk_vehicle import MavsdkFleet  # noqa: PLC0415 (MAVSDK loads slowly)

        async with MavsdkFleet.open(self.links) as mavsdk:
            yield mavsdk

    @asynccontextmanager
    async def open(
        self,
        on_frame: FrameHook | None = None,
        *,
        vehicles: Collection[int] | None = None,
        on_notice: NoticeHook | None = None,
        emulated: AbstractAsyncContextManager[Endpoint] | None = None,
    ) -> AsyncIterator[LinkedFleet]:
        """The open links of our own backend. `vehicles` are those of a plan: no other system gets a session.

        `emulated` takes the place of the links; it is entered last.

        Raises `UsageError`, `LinkError`.
        """
        only = None if vehicles is None else [self.systems.get(sysid, sysid) for sysid in vehicles]
        async with AsyncExitStack() as stack:
            copy = await stack.enter_async_context(copies_to(self.also_to, self.links))
            links = self.links if emulated is None else (await stack.enter_async_context(emulated),)
            fleet = LinkedFleet(
                links,
                on_frame=_also(copy, only, on_frame) if self.also_to else on_frame,
                signing=signing_with(self.key, asyncio.get_running_loop().time()),
                transfer=Transfer(self.transfer),
                only=only,
                on_notice=on_notice,
            )
            yield await stack.enter_async_context(fleet.open())

    def __str__(self) -> str:
        return ", ".join(self.links)


def _also(copy: Callable[[bytes], None], only: Collection[int] | None, on_frame: FrameHook | None) -> FrameHook:
    """Return the hook that copies what vehicles send, besides `on_frame`; `only`: of these systems."""
    systems = None if only is None else frozenset(only)

    def hook(direction: FrameDirection, frame: bytes) -> None:
        if direction is FrameDirection.IN and (systems is None or frame_system(frame) in systems):
            copy(frame)
        if on_frame is not None:
            on_frame(direction, frame)

    return hook


@asynccontextmanager
async def copies_to(specs: Sequence[str], links: Sequence[str]) -> AsyncIterator[Callable[[bytes], None]]:
    """Yield the function that copies a frame to other ground stations, one way: what comes back is not read.

    It never waits: a listener that is slow or gone costs a flight nothing. Raises `UsageError`, `LinkError`.
    """
    async with AsyncExitStack() as stack:
        copies = [UdpEndpoint(spec) for spec in listeners(specs, links)]
        for copy in copies:
            try:
                await copy.open(None)
            except LinkError as error:
                raise LinkError(f"frames cannot be copied to {copy.spec}: {error.message}", hint=error.hint) from error
            stack.callback(copy.close)

        def send(frame: bytes) -> None:
            for copy in copies:
                copy.send(frame)

        yield send


def listeners(specs: Sequence[str], links: Sequence[str]) -> tuple[LinkSpec, ...]:
    """Return the addresses of other ground stations.

    Raises `UsageError` for one that cannot be called, or that is a link to the vehicles: copies would come back.
    """
    found = tuple(map(parse_link_spec, specs))
    for spec in found:
        if spec.mode is not LinkMode.CALL:
            raise UsageError(f"{spec} cannot call a ground station.", hint="write for example udpout:127.0.0.1:14550")
        for link in map(parse_link_spec, links):
            if link.mode in (LinkMode.LISTEN, LinkMode.CALL) and _meets(spec, link):
                raise UsageError(
                    f"frames cannot be copied to {spec}: the vehicles are on {link}.",
                    hint="have the other ground station listen on another port, and name that one",
                )
    return found


def _meets(spec: LinkSpec, link: LinkSpec) -> bool:
    if spec.port != link.port:
        return False
    one, other = ("127.0.0.1" if host in _HERE else host for host in (spec.host, link.host))
    return one == other or (link.mode is LinkMode.LISTEN and link.host in _EVERYWHERE and spec.host in _HERE)
