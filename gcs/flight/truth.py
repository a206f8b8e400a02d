"""Where emulated vehicles truly were: the file that `sim-bridge --truth` leaves.

Knows: the file's layout. Does not know: estimates, plans, verdicts.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcs.errors import FileFormatError
from gcs.physics.quadrotor import Array


@dataclass(frozen=True)
class Truth:
    """True states on a common clock, in the formation's local NED frame."""

    sysids: tuple[int, ...]
    unix_s: Array  # (N,) GNSS time
    states: Array  # (V, N, 12)

    def __post_init__(self) -> None:
        if self.states.shape != (len(self.sysids), len(self.unix_s), 12):
            raise ValueError(f"states must be (V, N, 12), not {self.states.shape}")


def load_truth(path: Path) -> Truth:
    """Read a truth file; raises FileFormatError when it is missing or damaged."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            return Truth(tuple(int(i) for i in archive["sysid"]), archive["t_unix_s"], archive["state"])
    except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile) as problem:
        raise FileFormatError(
            f"{path}: no true states of a simulated flight ({type(problem).__name__})",
            hint="the simulator writes them when it ends; look at its own messages",
        ) from problem
