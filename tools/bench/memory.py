"""How much memory a process has had at most.

Knows: Linux. Does not know: what was measured. The kernel's own figure, ru_maxrss, will not do: it survives exec, so a
small program that a large one starts is reported to be as large as that.
"""

from __future__ import annotations

import re
from pathlib import Path


def peak_mb() -> float:
    """Peak resident memory of this process since its program began, in MB. Raises OSError without /proc."""
    status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
    found = re.search(r"^VmHWM:\s+(\d+) kB$", status, re.M)
    if found is None:
        raise OSError("/proc/self/status does not tell VmHWM")
    return int(found[1]) / 1024
