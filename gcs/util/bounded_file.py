"""Bounded reading of untrusted files: every kind has a largest size, and only regular files are read.

So no pipe blocks a command, and no device fills the memory. JSON has bounds on the number of values and on nesting.
"""

import json
import os
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from gcs.errors import FileFormatError, GcsError

MIB = 1024 * 1024
JSON_VALUES_MAX = 1_000_000
SHEETS = (".csv", ".xlsx", ".xls", ".ods")  # suffixes of spreadsheets, which people give in place of other files


@dataclass(frozen=True)
class FileKind:
    """A kind of file, as messages name it, and its largest size."""

    name: str
    largest_bytes: int


PLAN_FILE = FileKind("a plan", 64 * MIB)
SCENARIO_TOML = FileKind("a scenario or vehicle type (TOML)", MIB)
SCENARIO_JSON = FileKind("a scenario (JSON)", 64 * MIB)
FAULT_FILE = FileKind("a fault file", MIB)
MISSION_FILE = FileKind("a mission", 16 * MIB)
EXPORT_INDEX = FileKind("the index of an export", 16 * MIB)
UPLOAD_RECORD = FileKind("the record of an upload", 16 * MIB)
FLIGHT_STATE = FileKind("the state of a flight", MIB)
EVENT_FILE = FileKind("a flight's events", 64 * MIB)
TRUTH_FILE = FileKind("true states", 2048 * MIB)
TRACKS_FILE = FileKind("predicted tracks", 2048 * MIB)
TELEMETRY_LOG = FileKind("a telemetry log", 4096 * MIB)
RECORD_FILE = FileKind("a flight record", 512 * MIB)
KEY_FILE = FileKind("a signing key", 4096)
POSITION_SHEET = FileKind("positions (CSV)", MIB)
DRAWING_FILE = FileKind("a drawn route", 16 * MIB)
TRACK_FILE = FileKind("trajectories to prove", 256 * MIB)
GEOZONE_FILE = FileKind("geozones", 64 * MIB)
FILE_KINDS = (
    *(PLAN_FILE, SCENARIO_TOML, SCENARIO_JSON, FAULT_FILE, MISSION_FILE, EXPORT_INDEX, UPLOAD_RECORD),
    *(FLIGHT_STATE, EVENT_FILE, TELEMETRY_LOG, TRUTH_FILE, TRACKS_FILE, RECORD_FILE, KEY_FILE, POSITION_SHEET),
    *(DRAWING_FILE, TRACK_FILE, GEOZONE_FILE),
)
_KINDS_OF_PLACES = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def read_file(path: Path, kind: FileKind, *, error: type[GcsError] = FileFormatError, hint: str = "") -> bytes:
    """The bytes of a regular file.

    Raises `error` if it is missing, cannot be read, is a folder, pipe or device, or is larger than its kind may be.
    """
    handle = open_regular(path, error=error, hint=hint)
    try:
        with os.fdopen(handle, "rb") as file:
            refuse_size(path, os.fstat(handle).st_size, kind, error=error)
            data = file.read(kind.largest_bytes + 1)  # some files of /proc have no size
    except OSError as problem:
        raise error(f"{path}: {problem.strerror}.", hint=hint) from None
    refuse_size(path, len(data), kind, error=error)
    return data


def open_regular(path: Path, *, error: type[GcsError] = FileFormatError, hint: str = "", pipes: bool = False) -> int:
    """A handle for reading a regular file, or with `pipes` a pipe. Raises `error` for anything else."""
    try:
        _refuse_place(path, path.stat().st_mode, error, pipes)
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            _refuse_place(path, os.fstat(handle).st_mode, error, pipes)  # it may have been replaced meanwhile
        except BaseException:
            os.close(handle)
            raise
    except OSError as problem:
        raise error(f"{path}: {problem.strerror}.", hint=hint, reason=f"{problem.strerror}.") from None
    except ValueError:  # a NUL byte
        raise error(f"{str(path)!r} is not a path.", hint=hint) from None
    return handle


def refuse_size(path: Path, size: int, kind: FileKind, *, error: type[GcsError] = FileFormatError) -> None:
    """Raise `error` for more bytes than a file of this kind may have."""
    if size > kind.largest_bytes:
        raise error(
            f"{path}: {in_mib(size)} are too large for {kind.name}; the limit is {in_mib(kind.largest_bytes)}.",
            hint="name another file",
        )


def in_mib(size: int) -> str:
    """A size as text; a size below 1 MiB in bytes."""
    return f"{size} bytes" if size < MIB else f"{size / MIB:.4g} MiB"


def _refuse_place(path: Path, mode: int, error: type[GcsError], pipes: bool) -> None:
    for is_it, words in _KINDS_OF_PLACES:
        if is_it(mode) and not (pipes and is_it is stat.S_ISFIFO):
            reason = f"is {words}, not a file."
            raise error(f"{path}: {reason}", hint="name a regular file", reason=reason)


def as_utf8(data: bytes) -> bytes:
    """The bytes of a text as UTF-8, also where a program wrote UTF-16. Raises ValueError for broken UTF-16.

    UTF-16 is recognised by its byte order mark, or by the zero bytes beside its first two characters.
    """
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        encoding = "utf-16"
    elif len(data) >= 4 and data[1] == data[3] == 0 and data[0] and data[2]:
        encoding = "utf-16-le"
    elif len(data) >= 4 and data[0] == data[2] == 0 and data[1] and data[3]:
        encoding = "utf-16-be"
    else:
        return data
    try:
        return data.decode(encoding).encode()
    except UnicodeError as error:
        raise ValueError("begins as UTF-16, and is none; save it as UTF-8") from error


class AtLine(ValueError):
    """An error whose sentence begins with its line or column."""


def read_json(data: bytes | str, *, not_finite: bool = False) -> Any:
    """The value of a JSON text. Raises ValueError, also for too many values, deep nesting and numbers without end.

    `not_finite` accepts NaN and Infinity, which are not JSON and which Python writes.
    """
    refuse_crowded_json(data)
    try:
        return json.loads(data, parse_constant=None if not_finite else _not_json)
    except RecursionError:
        raise ValueError("values are nested too deeply") from None


def refuse_crowded_json(data: bytes | str) -> None:
    """Raise ValueError for a text of more values than any file has: each takes many times its length in memory."""
    if isinstance(data, str):
        count = sum(data.count(mark) for mark in ",[{")
    else:
        count = sum(data.count(mark) for mark in (b",", b"[", b"{"))
    if count > JSON_VALUES_MAX:
        raise ValueError(f"about {count:,} values; the limit is {JSON_VALUES_MAX:,}")


def _not_json(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is not JSON")
