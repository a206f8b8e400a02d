"""Options of commands that talk to vehicles, and what they mean.

Knows: how links, system ids and keys are written. Does not know: sockets. Keys come from files and the environment:
what stands on a command line, everybody on the machine can read.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gcs.errors import UsageError

if TYPE_CHECKING:
    from gcs.link.backend_mavsdk import MavsdkFleet
    from gcs.link.fleet import Fleet, FrameHook

DEFAULT_LINK = "udpin:127.0.0.1:14550"
LARGEST_SYSTEM = 254  # 255 is the ground station

LinkOption = Annotated[
    list[str] | None,
    typer.Option(
        "--link",
        metavar="LINK",
        help="Where vehicles are: udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD; repeat it "
        "for several.",
    ),
]
MapOption = Annotated[
    str | None,
    typer.Option("--map", metavar="1=7,2=8", help="System ids of vehicles that have others than in the plan."),
]
KeyOption = Annotated[
    Path | None,
    typer.Option(
        "--signing-key-file",
        metavar="FILE",
        help="Sign with the key in this file, and believe only what is signed with it. Without it the key is that of "
        "the environment variable SKEIN_SIGNING_KEY, if there is one.",
    ),
]


BackendOption = Annotated[
    str,
    typer.Option("--backend", help="skein: our own machines; mavsdk: MAVSDK's, which neither sign nor are quick."),
]
BACKENDS = ("skein", "mavsdk")
TransferOption = Annotated[
    str,
    typer.Option(
        "--transfer",
        help="How ArduPilot gets its mission: auto (as one file where the vehicle offers MAVLink FTP, and item by item "
        "where not), items, or file.",
    ),
]
TRANSFERS = ("auto", "items", "file")


@dataclass(frozen=True)
class Connection:
    """Links, key and names as given on the command line."""

    links: tuple[str, ...]
    systems: dict[int, int] = field(default_factory=dict)  # of plan vehicles that are called something else
    key: bytes | None = field(default=None, repr=False)
    transfer: str = "auto"  # one of TRANSFERS

    @asynccontextmanager
    async def open_backend(self, backend: str) -> AsyncIterator[Fleet | MavsdkFleet]:
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
        from gcs.link.backend_mavsdk import MavsdkFleet

        async with MavsdkFleet.open(self.links) as foreign:
            yield foreign

    @asynccontextmanager
    async def open(self, on_frame: FrameHook | None = None) -> AsyncIterator[Fleet]:
        """The links, open. Raises `UsageError`, `LinkError`."""
        import asyncio

        from gcs.link.fleet import Fleet
        from gcs.link.keys import signing_with
        from gcs.link.transfer import Transfer

        signing = signing_with(self.key, asyncio.get_running_loop().time())
        async with Fleet.open(
            self.links, on_frame=on_frame, signing=signing, transfer=Transfer(self.transfer)
        ) as fleet:
            yield fleet

    def __str__(self) -> str:
        return ", ".join(self.links)


def connection(
    links: Sequence[str] | None, systems: str | None = None, key_file: Path | None = None, transfer: str = "auto"
) -> Connection:
    """What the options ask for. Raises `UsageError`."""
    from gcs.link.endpoint import parse_link_spec
    from gcs.link.keys import load_key

    chosen = tuple(links or (DEFAULT_LINK,))
    for number, link in enumerate(chosen):
        parse_link_spec(link)
        if link in chosen[:number]:
            raise UsageError(f"--link {link} is given twice")
    if transfer not in TRANSFERS:
        raise UsageError(f"--transfer {transfer}: there are {', '.join(TRANSFERS)}")
    return Connection(chosen, parse_map(systems), load_key(key_file), transfer)


def parse_map(text: str | None) -> dict[int, int]:
    """`1=7,2=8` as {1: 7, 2: 8}. Raises `UsageError` that quotes it."""
    found: dict[int, int] = {}
    for part in text.split(",") if text else ():
        vehicle, equals, system = part.strip().partition("=")
        numbers = [n for n in (vehicle, system) if n.isascii() and n.isdigit() and 0 < int(n) <= LARGEST_SYSTEM]
        if not equals or len(numbers) != 2:
            raise UsageError(f"--map {text!r}: {part!r} is not VEHICLE=SYSTEM", hint="write for example --map 1=7,2=8")
        if int(vehicle) in found:
            raise UsageError(f"--map {text!r} names vehicle {vehicle} twice")
        found[int(vehicle)] = int(system)
    return found
