"""Write failures: refused before the flight, recorded as gaps in flight.

A gap is reported once, and again at the flight's end.
"""

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path

from gcs.errors import FlightError, GcsError, UsageError
from gcs.plan.trajectory.plan import Plan
from gcs.types import JsonObject

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

# A vehicle's telemetry and setpoints: 3.3 kB/s were measured. Ten times the usual streams of a radio fit too.
TELEMETRY_BYTES_PER_S = 8_000.0
TRUTH_BYTES_PER_S = 20_000.0  # of an emulated vehicle: 10 kB/s were measured
FIXED_BYTES = 10_000_000.0  # plan, exports, pictures, report
GROUND_S = 300.0  # readiness, upload, take-off, landing
RESERVE = 2.0


@dataclass(frozen=True)
class RecordGap:
    """One file of a flight's folder that lacks something. Times are the ground station's own clock."""

    file: str
    reason: str
    since_unix_s: float
    until_unix_s: float | None  # None: to the end of the flight
    lost: int
    unit: str  # frames, lines or steps

    def __str__(self) -> str:
        until = "" if self.until_unix_s is None else f" until {_clock(self.until_unix_s)}"
        return f"{self.file} lacks {self.lost} {self.unit} since {_clock(self.since_unix_s)}{until} ({self.reason})"


class RecordGaps:
    """The gaps of one flight's folder, by file. Safe to use from two threads."""

    def __init__(self, folder: Path, report: Callable[[str], None], unix_s: Callable[[], float] = time.time) -> None:
        self.folder = folder
        self.in_flight = True
        self._report = report
        self._unix_s = unix_s
        self._gaps: dict[str, RecordGap] = {}
        self._lock = threading.Lock()

    def __bool__(self) -> bool:
        return bool(self._gaps)

    def land(self) -> None:
        """The flight is over."""
        self.in_flight = False

    def lose(self, file: str, problem: Exception | str, lost: int, unit: str) -> None:
        """Count what was not written. The first time, and after the file could be written again, it is reported."""
        reason = problem if isinstance(problem, str) else getattr(problem, "strerror", None) or str(problem)
        with self._lock:
            known = self._gaps.get(file)
            is_new = known is None or known.until_unix_s is not None
            if known is None:
                known = RecordGap(file, reason, self._unix_s(), None, 0, unit)
            self._gaps[file] = replace(known, until_unix_s=None, lost=known.lost + lost)
        if is_new:
            rest = ". The flight goes on; its record is incomplete" if self.in_flight else ""
            self._report(f"{self.folder / file} cannot be written: {reason}{rest}")

    def written(self, file: str) -> None:
        """Note that a file can be written again."""
        known = self._gaps.get(file)
        if known is None or known.until_unix_s is not None:
            return
        with self._lock:
            self._gaps[file] = known = replace(known, until_unix_s=self._unix_s())
        self._report(f"{self.folder / file} is written again; it lacks {known.lost} {known.unit}")

    @contextmanager
    def kept(self, file: str) -> Iterator[None]:
        """Within the block, a file that cannot be written becomes a gap. For pictures and reports."""
        try:
            yield
        except (OSError, GcsError) as problem:
            self.lose(file, problem, 1, "versions")

    @property
    def found(self) -> tuple[RecordGap, ...]:
        """The gaps until now."""
        return tuple(self._gaps.values())

    def data(self) -> tuple[JsonObject, ...]:
        """Return the gaps as plain values, for the report and `--json`."""
        return tuple(asdict(gap) for gap in self.found)

    def words(self) -> str:
        """Return one sentence without its stop; empty if the record is complete."""
        if not self._gaps:
            return ""
        if not self.folder.is_dir():
            reasons = dict.fromkeys(gap.reason for gap in self._gaps.values())
            return f"the record of this flight is lost: its folder {self.folder} is gone ({'; '.join(reasons)})"
        found = (
            str(gap) if (self.folder / gap.file).is_file() else f"there is no {gap.file} ({gap.reason})"
            for gap in self._gaps.values()
        )
        return f"the record of this flight is incomplete: {'; '.join(found)}"


def _clock(unix_s: float) -> str:
    return f"{datetime.fromtimestamp(unix_s):%H:%M:%S}"


def needed_bytes(plan: Plan, *, emulated: bool) -> float:
    """Return the room that the folder of a flight may need, with a reserve."""
    seconds = plan.t_end_s - plan.t_start_s + GROUND_S
    rate = TELEMETRY_BYTES_PER_S + TRUTH_BYTES_PER_S * emulated
    return RESERVE * (FIXED_BYTES + len(plan.sysids) * rate * seconds)


def refuse_without_room(folder: Path, needed: float) -> None:
    """Raises FlightError if the disk of an empty folder has less room, or a file may not grow so large; removes it."""
    found = os.statvfs(folder)
    free = float(found.f_bavail * found.f_frsize)
    largest = resource.getrlimit(resource.RLIMIT_FSIZE)[0] if resource else -1
    if free < needed:
        what = f"the disk of {folder.parent} has {_mb(free)} free"
        hint = "free some room, or name another disk with --to"
    elif 0 <= largest < needed:
        what = f"files of this process may grow to {_mb(largest)}"
        hint = "raise the limit with `ulimit -f unlimited`"
    else:
        return
    with suppress(OSError):
        folder.rmdir()
    raise FlightError(
        f"no-go: {what}; the record of this flight may need {_mb(needed)}. Nothing was uploaded.", hint=hint
    )


@contextmanager
def refusing_unwritable(folder: Path) -> Iterator[None]:
    """Within the block, a failure of the file system raises UsageError. For what is written before the flight."""
    try:
        yield
    except OSError as problem:
        raise UsageError(
            f"no-go: the flight's folder cannot be written: {problem.filename or folder}: "
            f"{problem.strerror or problem}. Nothing was uploaded.",
            hint="name another folder with --to",
        ) from problem


def _mb(size_bytes: float) -> str:
    return f"{size_bytes / 1e6:.1f} MB"
