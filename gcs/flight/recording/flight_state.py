"""`flight.json`: the state from which another process continues a flight."""

import json
import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from gcs.errors import FileFormatError, GcsError, UsageError
from gcs.flight.contingency.choices import FlightMode
from gcs.flight.monitoring.progress import Step
from gcs.flight.recording.record_gaps import RecordGap
from gcs.util.atomic_write import atomic_write
from gcs.util.bounded_file import FLIGHT_STATE, read_file, read_json

NAME = "flight.json"
_FORMAT = "skein-flight-1"
_PID_END = 1 << 31
_CLOCKS_S = 5.0  # the accuracy of a process's start time


@dataclass(frozen=True)
class FlightState:
    """The state of a flight, as last written."""

    mission: str
    plan_hash: str
    links: tuple[str, ...]  # none: emulated vehicles that ended with the flight's process
    systems: dict[int, int]  # MAVLink systems of vehicles with another system id than in the plan
    mode: str
    follow: bool
    step: str
    t0_unix_s: float | None
    pid: int
    waived: tuple[str, ...] = ()  # pre-flight checks that this flight was allowed to fail
    missions: tuple[dict[str, int | str], ...] = ()  # how each vehicle's mission was sent, and why so
    incomplete: tuple[RecordGap, ...] = ()  # what the other files lack
    radio_baud: int | None = None  # of a radio behind the links that all vehicles share

    @property
    def over(self) -> bool:
        """Whether all vehicles had landed."""
        return self.step == Step.DONE

    @property
    def on_the_ground(self) -> bool:
        """Whether it ended, or was left before it armed a vehicle, as a refused flight is."""
        return self.over or self.step in (Step.READY, Step.UPLOAD)


@contextmanager
def held_folder(folder: Path) -> Iterator[None]:
    """Lock a flight's folder, so that one process flies it; the operating system frees the lock when the process ends.

    Raises UsageError if another process holds the lock, or if the process in `flight.json` still runs.
    """
    handle: int | None = None
    try:
        with suppress(OSError, ImportError):
            import fcntl  # noqa: PLC0415 (not on every system)

            handle = os.open(folder, os.O_RDONLY)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise _held_by_another(folder) from None
        with suppress(FileFormatError):
            if _still_runs(read_flight_state(folder).pid, folder / NAME):
                raise _held_by_another(folder)
        try:
            yield
        except GcsError as error:
            error.folder = str(folder)
            raise
    finally:
        if handle is not None:
            os.close(handle)


def _held_by_another(folder: Path) -> UsageError:
    try:
        process = f"process {read_flight_state(folder).pid}"
    except FileFormatError:
        process = "another process"
    return UsageError(
        f"the flight in {folder} is still flown by {process}.",
        hint="stop that process with Ctrl-C; its vehicles then land",
    )


def _still_runs(pid: int, state: Path) -> bool:
    """Whether the process that wrote `state` runs: its number may belong to a later process now."""
    if pid == os.getpid() or pid <= 0:
        return False
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    try:
        up_s = float(Path("/proc/uptime").read_text(encoding="ascii").split()[0])
        ticks = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()[19]
        began_s = time.time() - up_s + int(ticks) / os.sysconf("SC_CLK_TCK")
        return began_s <= state.stat().st_mtime + _CLOCKS_S
    except (OSError, ValueError, IndexError, AttributeError):
        return True  # a system without /proc


_STATE = TypeAdapter(FlightState)


def write_flight_state(folder: Path, state: FlightState) -> None:
    """Replace `flight.json` in `folder`, whole or not at all."""
    atomic_write(folder / NAME, json.dumps({"format": _FORMAT, **asdict(state)}, indent=2) + "\n")


def read_flight_state(folder: Path) -> FlightState:
    """Return the state in `folder`. Raises FileFormatError."""
    path = folder / NAME
    try:
        data = read_json(read_file(path, FLIGHT_STATE, hint="name a flight's folder"))
        if data.pop("format") != _FORMAT:
            raise ValueError("another format")
        state = _STATE.validate_python(data)
        FlightMode(state.mode)
        Step(state.step)
        if not 0 < state.pid < _PID_END:  # 0 and below name whole groups of processes
            raise ValueError(f"pid {state.pid} is not a process")
        if state.t0_unix_s is not None and not math.isfinite(state.t0_unix_s):
            raise ValueError("t0_unix_s is not finite")
        return state
    except ValidationError as problem:
        first = problem.errors(include_url=False, include_input=False)[0]
        reason = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as problem:
        reason = str(problem)
    raise FileFormatError(f"{path} is not the state of a flight ({reason}).", hint="name a flight's folder")


def newest_unfinished(root: Path, warn: Callable[[str], None] = lambda _: None) -> Path:
    """Return the folder of the last flight under `root` that armed vehicles and did not end. Raises UsageError.

    A folder whose `flight.json` cannot be read is passed over, with a warning.
    """
    found = sorted((p.parent for p in root.glob(f"*/{NAME}")), key=lambda folder: (folder / NAME).stat().st_mtime)
    for folder in reversed(found):
        try:
            state = read_flight_state(folder)
        except FileFormatError as problem:
            warn(f"{problem.message} It is passed over.")
            continue
        if not state.on_the_ground and state.links:
            return folder
    raise UsageError(
        f"there is no unfinished flight under {root}.", hint="name its folder, or the folder of flights with --to"
    )
