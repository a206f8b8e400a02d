"""`flight.json`: what another process needs to continue a flight whose process has ended."""

from __future__ import annotations

import json
import math
import os
from dataclasses import asdict, dataclass
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from gcs.errors import FileFormatError, UsageError
from gcs.files import atomic_write
from gcs.flight.options import FlightMode
from gcs.flight.progress import Step
from gcs.flight.recording.writing.record_gaps import RecordGap
from gcs.reading.bounded_file import FLIGHT_STATE, read_file
from gcs.reading.bounded_json import read_json

NAME = "flight.json"
_FORMAT = "skein-flight-1"
_PID_END = 1 << 31


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

    @property
    def over(self) -> bool:
        """Whether all vehicles had landed."""
        return self.step == Step.DONE

    @property
    def on_the_ground(self) -> bool:
        """Whether it ended, or was left before it armed a vehicle, as a refused flight is."""
        return self.over or self.step in (Step.READY, Step.UPLOAD)

    @property
    def flown_by_another(self) -> bool:
        """Whether its process still runs."""
        if self.pid == os.getpid():
            return False
        try:
            os.kill(self.pid, 0)
        except ProcessLookupError:
            return False
        except PermissionError:
            return True
        return True


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


def newest_unfinished(root: Path) -> Path:
    """Return the folder of the last flight under `root` that armed vehicles and did not end. Raises UsageError."""
    found = sorted((p.parent for p in root.glob(f"*/{NAME}")), key=lambda folder: (folder / NAME).stat().st_mtime)
    for folder in reversed(found):
        state = read_flight_state(folder)
        if not state.on_the_ground and state.links:
            return folder
    raise UsageError(
        f"there is no unfinished flight under {root}.", hint="name its folder, or the folder of flights with --to"
    )
