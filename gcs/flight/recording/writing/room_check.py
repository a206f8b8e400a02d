"""Whether a flight's files can be written, before a vehicle is touched: a folder, room on its disk, the file size."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from gcs.errors import FlightError, UsageError
from gcs.plan.trajectory.plan import Plan

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
        what, hint = (
            f"the disk of {folder.parent} has {_mb(free)} free",
            "free some room, or name another disk with --to",
        )
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
def unwritable_is_told(folder: Path) -> Iterator[None]:
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
