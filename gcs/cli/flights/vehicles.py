"""`gcs vehicles`: list the vehicles on a link with their state."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.cli.shared import shared_options as shared
from gcs.cli.shared.console import Screen
from gcs.errors import PeerError, UsageError

if TYPE_CHECKING:
    from pathlib import Path

    from gcs.link.session.connection import Connection
    from gcs.link.session.mavsdk_vehicle import MavsdkVehicle
    from gcs.link.session.status_report import VehicleReport
    from gcs.link.session.vehicle_session import VehicleSession
    from gcs.mission.model import Home
    from gcs.types import JsonObject

_WIDE = 120  # columns of a terminal that shows everything without breaking words
_TIMEOUT_S = 10.0
_DONE = {"hold": "holds", "land": "lands", "return": "returns"}


def vehicles(
    link: shared.LinkOption = None,
    listen: shared.ListenOption = 3.0,
    signing_key_file: shared.KeyOption = None,
    backend: shared.BackendOption = "skein",
    json: shared.JsonOption = False,
    debug: shared.DebugOption = False,
) -> int:
    """List the vehicles on a link: autopilot, version, mode, health, home, battery, link quality.

    It changes nothing on board.

    Examples: gcs vehicles --link udpin:127.0.0.1:14550

    gcs vehicles --link tcp:127.0.0.1:5760 --link serial:/dev/ttyUSB0:57600 --json
    """
    screen = Screen(json=json)
    from gcs.util.aio import Stoppable

    known = shared.connection(link, None, signing_key_file)
    screen.say(f"listening at {known} for {listen:g} s")
    reports = Stoppable().run(_ask_all(known, listen, backend))
    _show(screen, reports)
    _say_silent(screen, reports, listen)
    screen.result({"vehicles": [_data(report) for report in reports]})
    return 0


async def _ask_all(known: Connection, listen_s: float, backend: str) -> list[VehicleReport]:
    import asyncio

    from gcs.link.session.linked_fleet import LinkedFleet
    from gcs.link.session.status_report import status_report

    async with known.open_backend(backend) as fleet:
        heard = await fleet.listen(listen_s)
        if not heard:
            raise shared.nobody_heard(known, listen_s, fleet.refused_words())
        if isinstance(fleet, LinkedFleet):
            reports = [status_report(s, fleet.where(n)) for n, s in sorted(fleet.sessions.items()) if n in heard]
        else:
            reports = [vehicle.report() for vehicle in fleet.known if vehicle.heard]
        found = await asyncio.gather(*reports)
        fleet.check()
        return list(found)


def _show(screen: Screen, reports: list[VehicleReport]) -> None:
    from rich.markup import escape
    from rich.table import Table

    wide = screen.console.width >= _WIDE
    table = Table(title=f"{len(reports)} vehicle{'s' * (len(reports) != 1)}")
    home = (("home", True),) if wide else ()  # and whether it is one line
    whole = ("system", True), ("autopilot", True), ("mode", True)
    for column, one_line in (*whole, ("health", False), *home, ("battery", True), ("link", False)):
        table.add_column(column, no_wrap=one_line, overflow="fold")
    for r in reports:
        cells = [str(r.system), f"{r.autopilot}\n{r.version or '?'}", r.mode, health(r), battery(r), quality(r)]
        if wide:
            cells[2] += " (armed)" if r.armed else ""
            cells.insert(4, _place(r.home))
            cells[-1] += f"\n{r.where}"
        else:
            cells[2] += "\n(armed)" if r.armed else ""
            cells[-2:] = battery(r).replace(" ", "\n", 1), quality(r).replace(", ", "\n")
        table.add_row(*(escape(cell) for cell in cells))
    screen.show(table)
    if not wide:
        screen.say(f"home and address: in a terminal of {_WIDE} columns, or with --json")


def _say_silent(screen: Screen, reports: list[VehicleReport], listen_s: float) -> None:
    from gcs.link.session.status_report import REPEATED_S

    silent = [str(r.system) for r in reports if r.prearm_ok is False and not (r.not_ready_texts or r.critical_texts)]
    if silent and listen_s < REPEATED_S:
        screen.say(
            f"vehicle{'s' * (len(silent) > 1)} {', '.join(silent)} told no reason; some autopilots repeat theirs "
            f"every 30 s: --listen {REPEATED_S:g} hears them"
        )


def health(report: VehicleReport) -> str:
    """The faults of a vehicle in a few words, or "ready"."""
    ailing = report.ailing or ()
    wrong = [f"{name} not healthy" for name in ailing if name not in report.mentioned_sensors]
    if report.estimate_ok is False:
        wrong.append("no position estimate")
    if report.prearm_ok is False:
        wrong.append(f"not ready to arm in {report.mode}")
    if report.estimate_ok is None and report.prearm_ok is None:
        wrong.append("no health reported")
    texts = dict.fromkeys((*report.not_ready_texts, *report.critical_texts))
    wrong += [f"reports: {text}" for text in texts]
    mentioned = [f"{name} not healthy" for name in ailing if name in report.mentioned_sensors]
    return ", ".join((*(wrong or ["ready"]), *mentioned))


def battery(report: VehicleReport) -> str:
    """The charge and the voltage as text."""
    share = "?" if report.battery_share is None else f"{report.battery_share:.0%}"
    return share if report.battery_V is None else f"{share} {report.battery_V:.1f} V"


def quality(report: VehicleReport) -> str:
    """The packet loss and the round-trip time as text."""
    loss = "?" if report.loss is None else f"{report.loss:.0%}"
    sync = report.timesync
    return f"{loss} loss" + ("" if sync is None else f", {1e3 * sync.round_trip_s:.0f} ms")


def _place(place: Home | None) -> str:
    if place is None:
        return "not set"
    return f"{place.lat_deg:.6f}\n{place.lon_deg:.6f}\n{place.alt_amsl_m:.1f} m"


def _data(report: VehicleReport) -> JsonObject:
    from dataclasses import asdict

    data = asdict(report)
    if report.timesync is not None:
        data["timesync"] = report.timesync._asdict()
    return data


def command_directly(
    screen: Screen,
    what: str,
    link: list[str],
    vehicles: str | None,
    listen_s: float,
    signing_key_file: Path | None,
    backend: str,
) -> int:
    """Command vehicles on links, whichever program flies them; each obeys by itself.

    Raises UsageError for an unknown command, PeerError where a vehicle did not confirm.
    """
    if what not in _DONE:
        raise UsageError(f"gcs tell {what}: unknown command", hint=f"with --link give one of {', '.join(_DONE)}")
    from gcs.util.aio import Stoppable

    known = shared.connection(link, None, signing_key_file)
    named = shared.system_ids(vehicles)
    said = Stoppable().run(_command(known, backend, what, named, listen_s))
    for sysid, (_, word) in said.items():
        screen.say(f"vehicle {sysid}: {word}")
    if failed := [sysid for sysid, (ok, _) in said.items() if not ok]:
        them = ", ".join(map(str, failed))
        raise PeerError(
            f"vehicles {them} did not confirm.", hint="send the command again, or take over with the remote control"
        )
    screen.result({"told": what, "vehicles": {str(sysid): word for sysid, (_, word) in said.items()}})
    return 0


async def _command(
    known: Connection, backend: str, what: str, named: tuple[int, ...], listen_s: float
) -> dict[int, tuple[bool, str]]:
    """Whether all is as it should be after the command, and the outcome in words, by system id."""
    import asyncio

    async with known.open_backend(backend) as fleet:
        found: dict[int, VehicleSession | MavsdkVehicle] = {}
        found.update(await (fleet.vehicles(named, _TIMEOUT_S) if named else fleet.listen(listen_s)))
        if not found:
            raise shared.nobody_heard(known, listen_s, fleet.refused_words())
        words = await asyncio.gather(*(_command_one(vehicle, what) for vehicle in found.values()))
        return dict(zip(found, words, strict=True))


async def _command_one(vehicle: VehicleSession | MavsdkVehicle, what: str) -> tuple[bool, str]:
    """The outcome for one vehicle; an error of one does not stop the others."""
    from gcs.flight.execution.single_vehicle import control_of

    if not vehicle.armed:
        return True, "is not armed, no command sent"
    try:
        control = control_of(vehicle)
        try:
            await {"hold": control.hold, "land": control.land, "return": control.return_home}[what]()
        finally:
            await control.close()
    except PeerError as error:
        return False, error.message
    return True, _DONE[what]
