"""The `sim-bridge` command: options, signals, messages and exit codes.

Heavy imports stand inside the function, so that `--help` and wrong arguments are answered at once.
"""

from __future__ import annotations

import json
import math
import signal
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gcs.autopilots.traits import Autopilot
from gcs.errors import GcsError, UsageError, error_text
from gcs.link.endpoints.addresses import host_port, split_host_port
from sim_bridge.protocol.endpoint_address import (
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
AUTOPILOTS = (*(known.key for known in Autopilot), "ardupilot-4.7")
NAVIGATORS = ("own", "ideal")

app = typer.Typer(
    add_completion=False, context_settings={"help_option_names": ["-h", "--help"]}, rich_markup_mode="markdown"
)


@app.command()
def fly(
    mission: Annotated[Path, typer.Argument(metavar="MISSION", help="Mission folder, or the scenario file.")],
    udp: Annotated[
        str | None, typer.Option(help="Ground station that the vehicles send to.", show_default="127.0.0.1:14550")
    ] = None,
    link: Annotated[
        list[str] | None, typer.Option(help="udpout:HOST:PORT, udpin:PORT, tcpin:PORT, pty or pty:PATH; repeatable.")
    ] = None,
    bind: Annotated[
        str, typer.Option(help="Address to listen on. Any other than loopback lets other machines in.")
    ] = LOOPBACK,
    one_port: Annotated[bool, typer.Option("--one-port", help="All vehicles share one port of each link.")] = False,
    speedup: Annotated[str, typer.Option(help="Speed as a multiple of real time, or 'max'.")] = "1",
    autopilot: Annotated[
        str | None, typer.Option(help=f"That of all vehicles: {', '.join(AUTOPILOTS)}.", show_default="the scenario's")
    ] = None,
    nav: Annotated[
        str, typer.Option(help="Navigator for missions: own (that of the autopilot) or ideal (every leg on time).")
    ] = "own",
    epoch: Annotated[
        float | None, typer.Option(metavar="UNIX_S", help="GNSS time at the start.", show_default="now")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of sensor noise, boot clocks and link faults.")] = 0,
    truth: Annotated[Path | None, typer.Option(help="Write the true states to this .npz file at the end.")] = None,
    wind: Annotated[
        str,
        typer.Option(
            help="SPEED@FROM in m/s and degrees: 3@270 is 3 m/s from the west.", show_default="the scenario's"
        ),
    ] = "",
    gusts: Annotated[
        str,
        typer.Option(
            help="light (0.5 m/s), moderate (1 m/s), severe (2 m/s), or another standard deviation in m/s.",
            show_default="none",
        ),
    ] = "",
    fault: Annotated[
        list[str] | None,
        typer.Option(help="SYSID:[up.|down.]KIND[=VALUE][@FROM..UNTIL], e.g. 3:loss=0.2@10..30; repeatable."),
    ] = None,
    faults: Annotated[Path | None, typer.Option(help="TOML file with faults.")] = None,
    signing_key_file: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The vehicles sign with the key in this file, and accept nothing else."),
    ] = None,
    until_eof: Annotated[bool, typer.Option("--until-eof", help="Stop when standard input ends.")] = False,
    check: Annotated[bool, typer.Option("--check", help="Check the options, and end.")] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Emulate the vehicles of MISSION. They send to a ground station over UDP, each from its own port.

    One line of JSON on stdout says when they are ready and at which addresses. Stop them with Ctrl-C.
    """
    del debug  # read by `run`, because the error may be in the arguments
    links = parse_links(udp, link or (), bind=bind, shared=one_port)
    rate = parse_speedup(speedup)
    if autopilot not in (None, *AUTOPILOTS):
        raise UsageError(f"--autopilot must be {' or '.join(AUTOPILOTS)}, not {autopilot!r}.")
    if nav not in NAVIGATORS:
        raise UsageError(f"--nav must be {' or '.join(NAVIGATORS)}, not {nav!r}.")
    if truth is not None and not truth.parent.is_dir():
        raise UsageError(
            f"--truth: the folder {str(truth.parent)!r} for {truth.name} does not exist.",
            hint="create the folder first",
        )
    from gcs.link.wire.signing_keys import load_key  # noqa: PLC0415
    from gcs.scenario.sources.load import load_scenario  # noqa: PLC0415
    from gcs.scenario.values.si import sysids  # noqa: PLC0415
    from sim_bridge.dynamics.wind_field import parse_wind  # noqa: PLC0415
    from sim_bridge.faults.fault_spec import parse_faults, read_fault_file  # noqa: PLC0415
    from sim_bridge.personality import by_name  # noqa: PLC0415
    from sim_bridge.sim.world import World, WorldOptions  # noqa: PLC0415

    scenario = load_scenario(mission)
    texts = (read_fault_file(faults) if faults is not None else []) + (fault or [])
    options = WorldOptions(
        links=links,
        speedup=rate,
        seed=seed,
        faults=parse_faults(texts, sysids(scenario)),
        epoch_unix_s=epoch,
        record_truth=truth is not None,
        personality=None if autopilot is None else by_name(autopilot),
        wind=parse_wind(wind, gusts),
        ideal=nav == "ideal",
        signing_key=load_key(signing_key_file, {}),
    )
    if check:
        return
    with World(scenario, options) as fleet:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: fleet.stop())
        if until_eof:
            fleet.traffic.watch(sys.stdin.fileno())  # it ends when the parent dies
        _warn(links)
        print(json.dumps(_ready(fleet, links, seed)), flush=True)
        fleet.run()
        if truth is not None and fleet.truth is not None:
            fleet.truth.save(truth)


def parse_links(
    udp: str | None, texts: Sequence[str], *, bind: str = LOOPBACK, shared: bool = False
) -> list[EndpointSpec]:
    """Return the endpoints of a command line; the default is UDP to 127.0.0.1:14550. Raises `UsageError`."""
    links = [parse_link(text, bind=bind, shared=shared) for text in texts]
    if udp is not None or not links:
        host, port = parse_ground(udp) if udp is not None else (CALL_GROUND.host, CALL_GROUND.port)
        links.insert(0, EndpointSpec(EndpointKind.UDP_OUT, host, port, shared=shared))
    return links


def _warn(links: Sequence[EndpointSpec]) -> None:
    """Warn where other machines can connect."""
    for spec in links:
        if spec.kind in (EndpointKind.UDP_IN, EndpointKind.TCP_IN) and not is_loopback(spec.host):
            text = f"listening on {spec.host}: every program that reaches this address can command these vehicles"
            print(f"warning: {text}", file=sys.stderr, flush=True)


def _ready(fleet: World, links: Sequence[EndpointSpec], seed: int) -> dict[str, object]:
    """The line on stdout: `ports` are those of the first link that has any, `places` are all addresses."""
    called = next((host_port(spec.host, spec.port) for spec in links if spec.kind is EndpointKind.UDP_OUT), None)
    places = {sysid: [f"{place.kind}:{place.address}" for place in found] for sysid, found in fleet.places.items()}
    return {"ready": True, "ground": called, "ports": fleet.ports, "places": places, "seed": seed}


def parse_ground(text: str) -> tuple[str, int]:
    """Return the host and port of HOST:PORT. Raises `UsageError`."""
    host, port = split_host_port(text) or ("", "")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise UsageError(f"--udp must be HOST:PORT, not {text!r}.", hint="write e.g. --udp 127.0.0.1:14550")
    return host, int(port)


def parse_speedup(text: str) -> float:
    """Return a positive number, inf for `max`. Raises `UsageError`."""
    if text == "max":
        return math.inf
    try:
        rate = float(text)
    except ValueError:
        rate = math.nan
    if not 0 < rate < math.inf:
        raise UsageError(f"--speedup must be a positive number or 'max', not {text!r}.")
    return rate


def run(arguments: Sequence[str] | None = None) -> int:
    """Run one command line and return its exit code. Every error becomes a message, never a traceback."""
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
    print(error_text(message, hint), file=sys.stderr)
    return code
