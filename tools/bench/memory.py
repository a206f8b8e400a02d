"""Memory, open files, threads and CPU time of a process, on Linux.

The kernel's own peak, ru_maxrss, survives exec: a small program started by a large one would seem as large.
"""

import os
import re
from pathlib import Path

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


def peak_mb() -> float:
    """Peak resident memory of this process since its program began, in MB. Raises OSError without /proc."""
    return _of(_status("self"), "VmHWM") / 1024


def sample(pid: int) -> dict[str, float]:
    """Look at a process: its memory, open files, threads and processor time. Raises OSError when it is gone."""
    folder, status = Path("/proc") / str(pid), _status(str(pid))
    times = (folder / "stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
    cpu_s = (int(times[11]) + int(times[12])) / _TICKS_PER_S
    files = len(list((folder / "fd").iterdir()))
    return {"rss_mb": _of(status, "VmRSS") / 1024, "files": files, "threads": _of(status, "Threads"), "cpu_s": cpu_s}


def _status(process: str) -> str:
    return (Path("/proc") / process / "status").read_text(encoding="ascii", errors="replace")


def _of(status: str, name: str) -> int:
    found = re.search(rf"^{name}:\s+(\d+)", status, re.M)
    if found is None:
        raise ProcessLookupError(f"/proc/*/status does not tell {name}: the process has ended")
    return int(found[1])
