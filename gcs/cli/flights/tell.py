"""`gcs tell`: command vehicles on a link to hold, land or return."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from gcs.cli.completions import one_of
from gcs.cli.console import Screen
from gcs.cli.shared_options import (
    LISTEN_S,
    BackendOption,
    DebugOption,
    JsonOption,
    KeyOption,
    LinkOption,
    connection,
    within,
)
from gcs.errors import PeerError, PeerTimeout, UsageError

if TYPE_CHECKING:
    from gcs.link.connection import Connection
    from gcs.link.mavsdk.mavsdk_vehicle import MavsdkVehicle
    from gcs.link.session.vehicle_session import VehicleSession

_TIMEOUT_S = 10.0
_DONE = {"hold": "holds", "land": "lands", "return": "returns"}


def tell(
    what: Annotated[
        str,
        typer.Argument(
            metavar="hold|land|return",
            help="Command for the vehicles.",
            show_default=False,
            autocompletion=one_of("hold", "land", "return"),
        ),
    ],
    link: LinkOption = None,
    vehicles: Annotated[
        str | None,
        typer.Option(
            "--vehicles", metavar="1,3", help="System ids of the vehicles; without it, all vehicles heard on the link."
        ),
    ] = None,
    listen: Annotated[
        float, typer.Option("--listen", metavar="SECONDS", help="Time to listen for vehicles first.")
    ] = 2.0,
    signing_key_file: KeyOption = None,
    backend: BackendOption = "skein",
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Command vehicles in flight to hold their position, to land there, or to return (RTL).

    Each vehicle returns on its own; `gcs attach --return` returns a formation at staggered altitudes. Vehicles that are
    not armed receive no command. Exit status 0 when every armed vehicle has confirmed.

    Examples: gcs tell land --link udpin:127.0.0.1:14550

    gcs tell hold --vehicles 1,3 --link udpin:127.0.0.1:14550
    """
    screen = Screen(json=json)
    if what not in _DONE:
        raise UsageError(f"gcs tell {what}: unknown command", hint=f"give one of {', '.join(_DONE)}")
    if not link:
        raise UsageError("--link is missing", hint=f"for example gcs tell {what} --link udpin:127.0.0.1:14550")
    within("--listen", listen, *LISTEN_S, "s")
    from gcs.aio import Stoppable

    known = connection(link, None, signing_key_file)
    said = Stoppable().run(_tell(known, backend, what, _named(vehicles), listen))
    for sysid, word in said.items():
        screen.say(f"vehicle {sysid}: {word}")
    failed = [sysid for sysid, word in said.items() if word not in (_DONE[what], _LEFT)]
    if failed:
        named = ", ".join(map(str, failed))
        raise PeerError(
            f"vehicles {named} did not confirm.", hint="send the command again, or take over with the remote control"
        )
    screen.result({"told": what, "vehicles": {str(sysid): word for sysid, word in said.items()}})
    return 0


_LEFT = "is not armed, no command sent"


def _named(text: str | None) -> tuple[int, ...]:
    parts = [part.strip() for part in text.split(",")] if text is not None else []
    if not all(part.isascii() and part.isdigit() and len(part) < 9 and 0 < int(part) < 255 for part in parts):
        raise UsageError(f"--vehicles {text}: not system ids", hint="give for example --vehicles 1,3")
    return tuple(dict.fromkeys(map(int, parts)))


async def _tell(known: Connection, backend: str, what: str, named: tuple[int, ...], listen_s: float) -> dict[int, str]:
    """The outcome of the command, by system id."""
    import asyncio

    async with known.open_backend(backend) as fleet:
        found: dict[int, VehicleSession | MavsdkVehicle] = {}
        found.update(await (fleet.vehicles(named, _TIMEOUT_S) if named else fleet.listen(listen_s)))
        if not found:
            raise PeerTimeout(
                f"no vehicle was heard at {known} within {listen_s:g} s.",
                hint="check the link, and that the vehicles are switched on",
            )
        words = await asyncio.gather(*(_tell_one(vehicle, what) for vehicle in found.values()))
        return dict(zip(found, words, strict=True))


async def _tell_one(vehicle: VehicleSession | MavsdkVehicle, what: str) -> str:
    """The outcome for one vehicle; an error of one does not stop the others."""
    from gcs.flight.sequence.single_vehicle import control_of

    if not vehicle.armed:
        return _LEFT
    try:
        control = control_of(vehicle)
        try:
            await {"hold": control.hold, "land": control.land, "return": control.return_home}[what]()
        finally:
            await control.close()
    except PeerError as error:
        return error.message
    return _DONE[what]
