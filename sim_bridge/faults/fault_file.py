"""Faults from a TOML file, in the words of the command line, by vehicle:

    [faults]
    all = ["down.loss=0.05"]
    3 = ["loss=0.2@10..30", "gnss-outage@20..40"]

Knows: files and TOML. Does not know: what faults there are.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

from gcs.errors import UsageError

_HINT = 'write [faults], and under it for example 3 = ["loss=0.2@10..30"] or all = ["down.delay=0.2"]'


def read_fault_file(path: Path) -> list[str]:
    """The faults as the command line takes them, in the order of the file. Raises `UsageError`."""
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"the fault file {path} cannot be read: {error.strerror}.") from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise UsageError(f"the fault file {path} is not TOML: {error}.", hint=_HINT) from error
    table = data.get("faults")
    if not isinstance(table, dict) or len(data) != 1:
        raise UsageError(f"the fault file {path} has to hold the table [faults] and nothing else.", hint=_HINT)
    texts = []
    for who, faults in table.items():
        if not isinstance(faults, list) or not all(isinstance(fault, str) for fault in faults):
            raise UsageError(f"in the fault file {path}, {who} is not a list of texts.", hint=_HINT)
        texts += [f"{who}:{fault}" for fault in faults]
    return texts
