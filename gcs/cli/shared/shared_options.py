"""The arguments and options that several commands share, with one name and one help text each.

Also shell completion. It reads folders and opens no link: a port opened by the completion would take frames from the
station that flies.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gcs.errors import PeerTimeout, UsageError

if TYPE_CHECKING:
    from gcs.link.session.connection import Connection

SCENARIO, PLAN, FLIGHT = "scenario.toml", ".skein", "flight.json"
_DEPTH = 3  # folders below the one that is typed
_ENTRIES_MAX = 5000  # read for one key press
_READ_MAX = 4000  # bytes of a .toml file

Completion = Callable[[str], list[str]]


def one_of(*words: str) -> Completion:
    """The completion that offers these words."""

    def offered(incomplete: str) -> list[str]:
        return [word for word in words if word.startswith(incomplete)]

    return offered


def missions(incomplete: str) -> list[str]:
    """Mission folders, and scenario and plan files that stand outside them, else the bundled missions."""
    from gcs.scenario.sources.bundled_missions import bundled_names

    found = _Search(SCENARIO, (PLAN, ".toml")).found(incomplete)
    return found or [name for name in bundled_names() if name.startswith(incomplete)]


def plans(incomplete: str) -> list[str]:
    """Plan files."""
    return _Search(None, (PLAN,)).found(incomplete)


def flights(incomplete: str) -> list[str]:
    """Folders of flights, the newest first."""
    return sorted(_Search(FLIGHT, ()).found(incomplete), reverse=True)


def recordings(incomplete: str) -> list[str]:
    """Folders of flights, the newest first, and logs."""
    return [*flights(incomplete), *_Search(FLIGHT, (".tlog",), folders=False).found(incomplete)]


@dataclass
class _Search:
    """Finds folders that hold a file `mark`, and the files outside them that end so; it reads no more than `left`."""

    mark: str | None
    suffixes: tuple[str, ...]
    folders: bool = True
    left: int = _ENTRIES_MAX

    def found(self, incomplete: str) -> list[str]:
        """Return them as the user began to type them."""
        typed, slash, begun = incomplete.rpartition("/")
        found: list[str] = []
        for entry in self._entries(Path(typed or slash or ".")):
            if entry.name.startswith(begun):
                found += self._below(entry, f"{typed}{slash}{entry.name}", _DEPTH)
        return found

    def _below(self, entry: os.DirEntry[str], name: str, depth: int) -> Iterator[str]:
        if not entry.is_dir(follow_symlinks=False):
            if name.endswith(self.suffixes) and (not name.endswith(".toml") or _is_scenario(Path(entry.path))):
                yield name
        elif self.mark is not None and (Path(entry.path) / self.mark).exists():
            if self.folders:
                yield name
        elif depth > 1:
            for inner in self._entries(Path(entry.path)):
                yield from self._below(inner, f"{name}/{inner.name}", depth - 1)

    def _entries(self, folder: Path) -> list[os.DirEntry[str]]:
        """What is in a folder, by name, without hidden entries; nothing where it cannot be read."""
        found: list[os.DirEntry[str]] = []
        with suppress(OSError), os.scandir(folder) as entries:
            for entry in entries:
                self.left -= 1
                if self.left < 0:
                    break
                if not entry.name.startswith("."):
                    found.append(entry)
        return sorted(found, key=lambda entry: entry.name)


def _is_scenario(file: Path) -> bool:
    with suppress(OSError), file.open("rb") as opened:
        return b"schema_version" in opened.read(_READ_MAX)
    return False


def option(
    text: str,
    *names: str,
    metavar: str | None = None,
    shown: str | bool = True,
    words: Sequence[str] = (),
    limits: tuple[float, float, str] | None = None,
    meant: Mapping[str, str] | None = None,
) -> Any:
    """An option with its help text, for `Annotated`; without `names` it has that of the parameter.

    Its value is one of `words`, which the shell offers, or within `limits`: least, most, unit. `meant` has the words
    that others mean. `shown` is the default as the help has it. Parsing raises `UsageError`.
    """

    def checked(param: typer.CallbackParam, value: Any) -> Any:
        if value is not None and words and value not in words:
            raise unknown_choice(param.opts[0], value, words, meant=(meant or {}).get(value.lower()))
        return value if value is None or limits is None else within(param.opts[0], value, *limits)

    offered, callback = one_of(*words) if words else None, checked if words or limits else None
    return typer.Option(
        *names, metavar=metavar, help=text, show_default=shown, autocompletion=offered, callback=callback
    )


def plan_file(shown: str) -> Any:
    """The option --to of commands that write a plan."""
    names = ("--to", "--out", "-o")
    return option("Plan file to write, or the folder for it.", *names, metavar="FILE", shown=shown)


def argument(text: str, metavar: str, completion: Completion | None = None) -> Any:
    """A required argument with its help text, for `Annotated`."""
    return typer.Argument(metavar=metavar, help=text, show_default=False, autocompletion=completion)


MissionArgument = Annotated[
    Path, argument("Mission folder, scenario file, plan file, or name of a bundled mission.", "MISSION", missions)
]
PlanArgument = Annotated[Path, argument("Plan file of `gcs plan`.", "PLAN", plans)]
FlightArgument = Annotated[Path, argument("Folder of the flight.", "FOLDER", flights)]
JsonOption = Annotated[bool, option("Print one JSON object on stdout; stderr then has warnings only.", "--json")]
# `gcs.cli.main.run` reads it from the raw arguments, which may be wrong; it is declared here for --help.
DebugOption = Annotated[bool, option("Print the traceback of an error.", "--debug")]
LimitOption = Annotated[
    float,
    option(
        "Longest time of planning and verifying, all together.",
        "--limit",
        metavar="SECONDS",
        limits=(1.0, 86_400.0, "s"),
    ),
]
LIMIT_S = 1800.0  # far longer than what succeeds
UnverifiedOption = Annotated[bool, option("Use a plan that failed verification, for inspection.", "--unverified")]
UntimedOption = Annotated[
    bool,
    option(
        "Write the plan's own speeds into missions. An autopilot does not keep them; without this option they are "
        "corrected.",
        "--untimed",
    ),
]


DEFAULT_LINK = "udpin:127.0.0.1:14550"
RATES = (0.01, 10_000.0)  # least and most, in multiples of real time
LARGEST_SYSTEM = 254  # 255 is the ground station
GATES: tuple[float, float, str] = (0, 1000, "")  # of --gates; the flight's time limits them further

ListenOption = Annotated[
    float, option("Time to listen for vehicles first.", metavar="SECONDS", limits=(0.01, 3600.0, "s"))
]
LinkOption = Annotated[
    list[str] | None,
    option(
        "Link to the vehicles: udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD. Repeat it for "
        "several links.",
        metavar="LINK",
    ),
]
MapOption = Annotated[
    str | None,
    option(
        "System ids on the link, where they differ from the plan: 1=7 means that vehicle 1 is system 7.",
        "--map",
        metavar="1=7,2=8",
    ),
]
KeyOption = Annotated[
    Path | None,
    option(
        "Sign with the key in this file, and accept only frames that are signed with it. Default: the key in the "
        "environment variable SKEIN_SIGNING_KEY, if it is set.",
        metavar="FILE",
    ),
]
AlsoToOption = Annotated[
    list[str] | None,
    option(
        "Copy what the vehicles send to another ground station, which then watches: udpout:127.0.0.1:14550 for "
        "QGroundControl on this machine. One way: nothing from there reaches a vehicle. Repeat it for several.",
        metavar="LINK",
    ),
]
BackendOption = Annotated[
    str,
    option("skein: Skein's own MAVLink; mavsdk: MAVSDK, which is slower and cannot sign.", words=("skein", "mavsdk")),
]
RadioOption = Annotated[
    int | None,
    option(
        "With --link: all vehicles share a radio of this baud: telemetry is requested so that it fits. Default: the "
        "baud of serial links.",
        metavar="BAUD",
        limits=(1200, 10_000_000, "baud"),
    ),
]
TransferOption = Annotated[
    str,
    option(
        "How ArduPilot receives its mission: items (one by one), file (over MAVLink FTP), or auto (a file where the "
        "vehicle offers MAVLink FTP, else items).",
        words=("auto", "items", "file"),
    ),
]


def connection(
    links: Sequence[str] | None,
    systems: str | None = None,
    key_file: Path | None = None,
    transfer: str = "auto",
    radio_baud: int | None = None,
) -> Connection:
    """The connection that the options describe. Raises `UsageError`."""
    from gcs.link.endpoints.base import parse_link_spec
    from gcs.link.session.connection import Connection
    from gcs.link.wire.signing_keys import load_key

    chosen = tuple(links or (DEFAULT_LINK,))
    for number, link in enumerate(chosen):
        parse_link_spec(link)
        if link in chosen[:number]:
            raise UsageError(f"--link {link} is given twice", hint="give each link once")
    return Connection(chosen, parse_map(systems), load_key(key_file), transfer, radio_baud=radio_baud)


def nobody_heard(known: Connection, listen_s: float, more: str) -> PeerTimeout:
    """The error if no vehicle was heard; `more` follows the time."""
    hint = "start the vehicles, or check the address and port they send to"
    return PeerTimeout(f"no vehicle was heard at {known} within {listen_s:g} s{more}.", hint=hint)


def watchers(also_to: Sequence[str] | None, links: Sequence[str] | None) -> tuple[str, ...]:
    """The values of --also-to. Raises `UsageError`."""
    from gcs.link.session.connection import listeners

    return tuple(str(spec) for spec in listeners(also_to or (), links or ()))


def within(option: str, value: float, least: float, most: float, unit: str = "") -> float:
    """The value, if it is a number from `least` to `most`; NaN is none. Raises `UsageError`."""
    if not least <= value <= most:
        limits = f"{least:.12g} to {most:.12g}{unit and f' {unit}'}"
        raise UsageError(f"{option} {value:g}: not from {limits}", hint=f"give a number from {limits}")
    return value


def unknown_choice(option: str, value: str, known: Sequence[str], *, meant: str | None = None) -> UsageError:
    """The error for an option's value that is not one of `known`; `meant` is the known one of that meaning."""
    every = f"one of {', '.join(known)}"
    hint = f"give {every}" if meant is None else f"give {option} {meant}, or {every}"
    return UsageError(f"{option} {value}: unknown value", hint=hint)


def system_ids(text: str | None) -> tuple[int, ...]:
    """The system ids of `--vehicles 1,3`, each once; none for None. Raises UsageError."""
    parts = [part.strip() for part in text.split(",")] if text is not None else []
    if not all(map(is_system, parts)):
        raise UsageError(f"--vehicles {text}: not system ids", hint="give for example --vehicles 1,3")
    return tuple(dict.fromkeys(map(int, parts)))


def is_system(text: str) -> bool:
    """Whether a text is a system id that a vehicle can have."""
    return text.isascii() and text.isdigit() and len(text) < 9 and 0 < int(text) <= LARGEST_SYSTEM


def as_number(text: str) -> float:
    """The number in a text; NaN, which is within no limits, where it is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def as_share(text: str) -> float:
    """The share in `30%` or `0.3`; NaN where it is none."""
    number, percent, rest = text.strip().partition("%")
    return math.nan if rest else as_number(number) / (100.0 if percent else 1.0)


def as_rate(option: str, text: str) -> float:
    """A speed in multiples of real time, infinite for `max`. Raises `UsageError`."""
    rate, (least, most) = as_number(text), RATES
    if text != "max" and not least <= rate <= most:
        hint = f"give a number from {least:g} to {most:g}, or max"
        raise UsageError(f"{option} {text[:40]}: not a speed", hint=hint)
    return math.inf if text == "max" else rate


def parse_map(text: str | None) -> dict[int, int]:
    """The system id of each vehicle: {1: 7, 2: 8} for `1=7,2=8`. Raises `UsageError`."""
    found: dict[int, int] = {}
    for part in text.split(",") if text else ():
        vehicle, equals, system = part.strip().partition("=")
        if not (equals and is_system(vehicle) and is_system(system)):
            raise UsageError(f"--map {text!r}: {part!r} is not VEHICLE=SYSTEM", hint="write for example --map 1=7,2=8")
        if int(vehicle) in found:
            raise UsageError(f"--map {text!r} names vehicle {vehicle} twice", hint="name each vehicle once")
        found[int(vehicle)] = int(system)
    return found
