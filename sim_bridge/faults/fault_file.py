"""Reads faults from a TOML file, by vehicle, in the syntax of the command line:

[faults]
all = ["down.loss=0.05"]
3 = ["loss=0.2@10..30", "gnss-outage@20..40"]
"""

from __future__ import annotations

import tomllib
from pathlib import Path

from gcs.errors import UsageError
from gcs.reading.bounded_file import FAULT_FILE, read_file

_HINT = 'write [faults], and under it e.g. 3 = ["loss=0.2@10..30"] or all = ["down.delay=0.2"]'


def read_fault_file(path: Path) -> list[str]:
    """Return the faults as command-line texts, in the order of the file. Raises `UsageError`."""
    try:
        data = tomllib.loads(read_file(path, FAULT_FILE, error=UsageError, hint=_HINT).decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise UsageError(f"the fault file {path} is not TOML: {error}.", hint=_HINT) from error
    table = data.get("faults")
    if not isinstance(table, dict) or len(data) != 1:
        raise UsageError(f"the fault file {path} must contain the table [faults] and nothing else.", hint=_HINT)
    texts = []
    for vehicle, faults in table.items():
        if not isinstance(faults, list) or not all(isinstance(fault, str) for fault in faults):
            raise UsageError(f"in the fault file {path}, {vehicle} must be a list of strings.", hint=_HINT)
        texts += [f"{vehicle}:{fault}" for fault in faults]
    return texts
