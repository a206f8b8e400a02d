"""What another process uses now: memory, open files, threads, processor time. Knows: Linux."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Sample:
    """One look at a process."""

    rss_mb: float
    files: int
    threads: int
    cpu_s: float


def sample(pid: int) -> Sample:
    """Look at a process. Raises OSError when it is gone."""
    folder = Path("/proc") / str(pid)
    status = (folder / "status").read_text(encoding="ascii", errors="replace")
    resident = re.search(r"^VmRSS:\s+(\d+) kB$", status, re.M)
    threads = re.search(r"^Threads:\s+(\d+)$", status, re.M)
    if resident is None or threads is None:
        raise ProcessLookupError(f"process {pid} has ended")
    times = (folder / "stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
    cpu_s = (int(times[11]) + int(times[12])) / _TICKS_PER_S
    return Sample(int(resident[1]) / 1024, len(list((folder / "fd").iterdir())), int(threads[1]), cpu_s)
