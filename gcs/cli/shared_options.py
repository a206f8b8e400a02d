"""Arguments and options that commands share, so that they read the same everywhere.

Knows: names and help texts. Does not know: what commands do with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gcs.errors import UsageError

MissionArgument = Annotated[
    Path,
    typer.Argument(metavar="MISSION", help="Mission folder, scenario file or plan (.skein).", show_default=False),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout and nothing else there.")]
# `gcs.cli.main.run` reads it from the arguments, since those may be what is wrong; it is declared for --help.
DebugOption = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]
UnverifiedOption = Annotated[bool, typer.Option("--unverified", help="Use a plan although it does not hold.")]
UntimedOption = Annotated[
    bool,
    typer.Option(
        "--untimed",
        help="Missions ask for the plan's own speeds, which autopilots do not keep, instead of corrected ones.",
    ),
]


if TYPE_CHECKING:
    from gcs.link.connection import Connection

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
TransferOption = Annotated[
    str,
    typer.Option(
        "--transfer",
        help="How ArduPilot gets its mission: auto (as one file where the vehicle offers MAVLink FTP, and item by item "
        "where not), items, or file.",
    ),
]


def connection(
    links: Sequence[str] | None, systems: str | None = None, key_file: Path | None = None, transfer: str = "auto"
) -> Connection:
    """What the options ask for. Raises `UsageError`."""
    from gcs.link.connection import TRANSFERS, Connection
    from gcs.link.endpoints.base import parse_link_spec
    from gcs.link.wire.signing_keys import load_key

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
