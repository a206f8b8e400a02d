"""The `sim-bridge` command.

Knows: options, signals, how endings are told. Does not know: vehicles. Heavy imports stand inside the function, so
that `--help` and wrong arguments are answered at once.
"""

from __future__ import annotations

import json
import math
import signal
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gcs.autopilots.traits import Autopilot
from gcs.errors import GcsError, UsageError
from sim_bridge.protocol.endpoints.address import (
    CALL_GROUND,
    LOOPBACK,
    EndpointKind,
    EndpointSpec,
    is_loopback,
    parse_link,
)

if TYPE_CHECKING:
    from sim_bridge.sim.world import World

STOPPED = 130
BUG = 70
AUTOPILOTS = tuple(known.key for known in Autopilot)
NAVIGATORS = ("own", "ideal")

app = typer.Typer(add_completion=False, context_settings={"help_option_names": ["-h", "--help"]})


@app.command()
def fly(
    mission: Annotated[Path, typer.Argument(metavar="MISSION", help="Mission folder, or the scenario file.")],
    udp: Annotated[
        str | None, typer.Option(help="Ground station that the vehicles call.", show_default="127.0.0.1:14550")
    ] = None,
    link: Annotated[
        list[str] | None,
        typer.Option(help="udpout:HOST:PORT, udpin:PORT, tcpin:PORT, pty or pty:PATH; as many as are wanted."),
    ] = None,
    bind: Annotated[str, typer.Option(help="Address to listen at; another one lets others in.")] = LOOPBACK,
    one_port: Annotated[bool, typer.Option("--one-port", help="All vehicles share one port of each link.")] = False,
    speedup: Annotated[str, typer.Option(help="Times real time, or 'max'.")] = "1",
    autopilot: Annotated[
        str | None, typer.Option(help="Whose manners: ardupilot or px4.", show_default="the scenario's")
    ] = None,
    nav: Annotated[
        str,
        typer.Option(help="Who flies missions' waypoints: the autopilot's own navigator, or an ideal one, on time."),
    ] = "own",
    seed: Annotated[int, typer.Option(min=0, help="Of sensor noise, boot clocks and bad links.")] = 0,
    truth: Annotated[Path | None, typer.Option(help="Write the true states to this .npz file at the end.")] = None,
    wind: Annotated[
        str,
        typer.Option(help="SPEED@FROM in m/s and degrees: 3@270 blows out of the west.", show_default="the scenario's"),
    ] = "",
    gusts: Annotated[
        str, typer.Option(help="light, moderate, severe or their standard deviation in m/s.", show_default="none")
    ] = "",
    fault: Annotated[
        list[str] | None,
        typer.Option(help="SYSID:[up.|down.]KIND[=VALUE][@FROM..UNTIL], for example 3:loss=0.2@10..30."),
    ] = None,
    faults: Annotated[Path | None, typer.Option(help="TOML file with more of them.")] = None,
    until_eof: Annotated[bool, typer.Option("--until-eof", help="Stop when standard input ends.")] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Emulate the vehicles of MISSION: they call a ground station over UDP, each from a port of its own.

    One line of JSON on stdout says when they are there and where. They fly until Ctrl-C.
    """
    del debug  # read by `run`, because the arguments may be what is wrong
    links = parse_links(udp, link or (), bind=bind, shared=one_port)
    rate = parse_speedup(speedup)
    if autopilot not in (None, *AUTOPILOTS):
        raise UsageError(f"--autopilot {autopilot!r} is neither {' nor '.join(AUTOPILOTS)}.")
    if nav not in NAVIGATORS:
        raise UsageError(f"--nav {nav!r} is neither {' nor '.join(NAVIGATORS)}.")
    if truth is not None and not truth.parent.is_dir():
        raise UsageError(f"there is no folder {str(truth.parent)!r} to write {truth.name} to.")
    from gcs.scenario.load import load_scenario  # noqa: PLC0415
    from gcs.scenario.si import sysids  # noqa: PLC0415
    from sim_bridge.dynamics.body.wind_field import parse_wind  # noqa: PLC0415
    from sim_bridge.faults.fault_file import read_fault_file  # noqa: PLC0415
    from sim_bridge.faults.fault_spec import parse_faults  # noqa: PLC0415
    from sim_bridge.personality import by_name  # noqa: PLC0415
    from sim_bridge.sim.world import World, WorldOptions  # noqa: PLC0415

    scenario = load_scenario(mission)
    texts = (read_fault_file(faults) if faults is not None else []) + (fault or [])
    options = WorldOptions(
        links=links,
        speedup=rate,
        seed=seed,
        faults=parse_faults(texts, sysids(scenario)),
        record_truth=truth is not None,
        personality=by_name(autopilot or scenario.mission.autopilot),
        wind=parse_wind(wind, gusts),
        ideal=nav == "ideal",
    )
    with World(scenario, options) as fleet:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: fleet.stop())
        if until_eof:
            fleet.stop_at_end_of(sys.stdin.fileno())
        _warn(links)
        print(json.dumps(_ready(fleet, links, seed)), flush=True)
        fleet.run()
        if truth is not None:
            fleet.save_truth(truth)


def parse_links(
    udp: str | None, texts: Sequence[str], *, bind: str = LOOPBACK, shared: bool = False
) -> list[EndpointSpec]:
    """The endpoints of a command line; vehicles call the usual port where none is named. Raises `UsageError`."""
    links = [parse_link(text, bind=bind, shared=shared) for text in texts]
    if udp is not None or not links:
        host, port = parse_ground(udp) if udp is not None else (CALL_GROUND.host, CALL_GROUND.port)
        links.insert(0, EndpointSpec(EndpointKind.UDP_OUT, host, port, shared=shared))
    return links


def _warn(links: Sequence[EndpointSpec]) -> None:
    """Say so when others are let in."""
    for spec in links:
        if spec.kind in (EndpointKind.UDP_IN, EndpointKind.TCP_IN) and not is_loopback(spec.host):
            text = f"listening at {spec.host}: whoever reaches that address may command these vehicles"
            print(f"warning: {text}", file=sys.stderr, flush=True)


def _ready(fleet: World, links: Sequence[EndpointSpec], seed: int) -> dict[str, Any]:
    """`ports` are those of the first link that has any, `places` all."""
    called = next((f"{spec.host}:{spec.port}" for spec in links if spec.kind is EndpointKind.UDP_OUT), None)
    places = {sysid: [f"{place.kind}:{place.address}" for place in found] for sysid, found in fleet.places.items()}
    return {"ready": True, "ground": called, "ports": fleet.ports, "places": places, "seed": seed}


def parse_ground(text: str) -> tuple[str, int]:
    """HOST:PORT. Raises `UsageError`."""
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise UsageError(f"--udp {text!r} is not HOST:PORT.", hint="write for example --udp 127.0.0.1:14550")
    return host, int(port)


def parse_speedup(text: str) -> float:
    """A positive number, or `max` for inf. Raises `UsageError`."""
    if text == "max":
        return math.inf
    try:
        rate = float(text)
    except ValueError:
        rate = math.nan
    if not 0 < rate < math.inf:
        raise UsageError(f"--speedup {text!r} is neither a positive number nor 'max'.")
    return rate


def run(arguments: Sequence[str] | None = None) -> int:
    """Run one command line and return its exit code; nothing escapes as a traceback."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in arguments
    try:
        return app(args=arguments or ["--help"], prog_name="sim-bridge", standalone_mode=False) or 0
    except KeyboardInterrupt:
        return STOPPED
    except typer.TyperException as error:
        return _failed(error.format_message(), "see `sim-bridge --help`", error.exit_code)
    except GcsError as error:
        if debug:
            traceback.print_exc()
        return _failed(error.message, error.hint, error.exit_code)
    except Exception as error:
        if debug:
            traceback.print_exc()
        text = f"{type(error).__name__}: {error}"
        return _failed(f"this is a bug in sim-bridge: {text}", "run it again with --debug", BUG)


def _failed(message: str, hint: str, code: int) -> int:
    print(f"error: {message}", file=sys.stderr)
    if hint:
        print(f"next: {hint}", file=sys.stderr)
    return code
