"""`gcs tell`: everybody on a link, or some, holds, lands or goes home."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from gcs.cli.console import Screen
from gcs.cli.shared_options import BackendOption, DebugOption, JsonOption, KeyOption, LinkOption, connection
from gcs.errors import PeerError, PeerTimeout, UsageError

if TYPE_CHECKING:
    from gcs.link.connection import Connection
    from gcs.link.mavsdk.mavsdk_vehicle import MavsdkVehicle
    from gcs.link.session.vehicle_session import VehicleSession

_PATIENCE_S = 10.0
_DONE = {"hold": "holds", "land": "lands", "return": "returns"}


def tell(
    what: Annotated[str, typer.Argument(metavar="hold|land|return", help="What they are to do.", show_default=False)],
    link: LinkOption = None,
    vehicles: Annotated[
        str | None,
        typer.Option("--vehicles", metavar="1,3", help="MAVLink systems; without it everybody who is heard."),
    ] = None,
    listen: Annotated[float, typer.Option("--listen", metavar="SECONDS", help="How long to listen first.")] = 2.0,
    signing_key_file: KeyOption = None,
    backend: BackendOption = "skein",
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Tell vehicles in flight to stay where they are, to land there, or to go home by their own autopilot.

    They go home each by itself: `gcs attach --return` brings a formation home staggered. Whoever is not armed is left
    alone. Exit status 0 when every armed one has said that it does.

    Examples: gcs tell land --link udpin:127.0.0.1:14550

    gcs tell hold --vehicles 1,3 --link udpin:127.0.0.1:14550
    """
    screen = Screen(json=json)
    if what not in _DONE:
        raise UsageError(f"gcs tell {what}: there are {', '.join(_DONE)}")
    if not link:
        raise UsageError("say where they are", hint=f"for example gcs tell {what} --link udpin:127.0.0.1:14550")
    if not listen > 0:
        raise UsageError(f"--listen {listen:g}: give some seconds")
    import asyncio

    known = connection(link, None, signing_key_file)
    said = asyncio.run(_tell(known, backend, what, _named(vehicles), listen))
    for sysid, word in said.items():
        screen.say(f"vehicle {sysid}: {word}")
    failed = [sysid for sysid, word in said.items() if word not in (_DONE[what], _LEFT)]
    if failed:
        named = ", ".join(map(str, failed))
        raise PeerError(
            f"vehicles {named} did not say that they do.", hint="tell them again, or take their remote control"
        )
    screen.result({"told": what, "vehicles": {str(sysid): word for sysid, word in said.items()}})
    return 0


_LEFT = "is not armed, and was left alone"


def _named(text: str | None) -> tuple[int, ...]:
    parts = [part.strip() for part in text.split(",")] if text is not None else []
    if not all(part.isascii() and part.isdigit() and 0 < int(part) < 255 for part in parts):
        raise UsageError(f"--vehicles {text}: give system ids, for example 1,3")
    return tuple(dict.fromkeys(map(int, parts)))


async def _tell(known: Connection, backend: str, what: str, named: tuple[int, ...], listen_s: float) -> dict[int, str]:
    """What became of it, by system id."""
    import asyncio

    async with known.open_backend(backend) as fleet:
        found: dict[int, VehicleSession | MavsdkVehicle] = {}
        found.update(await (fleet.vehicles(named, _PATIENCE_S) if named else fleet.listen(listen_s)))
        if not found:
            raise PeerTimeout(f"no vehicle was heard at {known} within {listen_s:g} s.", hint="check the link")
        words = await asyncio.gather(*(_tell_one(vehicle, what) for vehicle in found.values()))
        return dict(zip(found, words, strict=True))


async def _tell_one(vehicle: VehicleSession | MavsdkVehicle, what: str) -> str:
    """One vehicle's trouble is not the others'."""
    from gcs.flight.sequence.single_vehicle import control_of

    if not vehicle.armed:
        return _LEFT
    try:
        hands = control_of(vehicle)
        try:
            await {"hold": hands.hold, "land": hands.land, "return": hands.return_home}[what]()
        finally:
            await hands.close()
    except PeerError as error:
        return error.message
    return _DONE[what]
