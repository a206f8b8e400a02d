"""Records the true states, for the assessment of a flight. Vehicles never see them."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from gcs.errors import GcsError
from gcs.physics.quadrotor import Array
from sim_bridge.dynamics.body.airframes import Airframes

PERIOD_STEPS = 1  # of 20 ms: 50 Hz


class TruthRecord:
    """Collects states while the fleet runs.

    The file (.npz): `t_s` (N,) simulated; `t_unix_s` (N,) the same instants in the vehicles' GNSS time; `state`
    (V, N, 12) in common local NED; `control` (V, N, 4); `armed`, `flying` (V, N); `mode` (V, N); `sysid` (V,);
    `boot_offset_s` (V,), added to `t_s` for each vehicle's own clock.
    """

    def __init__(self, sysids: tuple[int, ...], boot_offset_s: list[float], epoch_unix_s: float) -> None:
        self._sysids = sysids
        self._boot_offset_s = boot_offset_s
        self._epoch_unix_s = epoch_unix_s
        self._t_s: list[float] = []
        self._states: list[Array] = []
        self._controls: list[Array] = []
        self._flags: list[list[tuple[bool, bool, int]]] = []

    def add(self, t_s: float, airframes: Airframes, flags: list[tuple[bool, bool, int]]) -> None:
        """Record one time; `flags` are (armed, flying, mode) of every vehicle."""
        self._t_s.append(t_s)
        self._states.append(airframes.truth.copy())
        self._controls.append(airframes.control.copy())
        self._flags.append(flags)

    @property
    def t_s(self) -> Array:
        """Simulated times (N,)."""
        return np.array(self._t_s)

    @property
    def state(self) -> Array:
        """True states (V, N, 12)."""
        return self._by_vehicle(self._states, 12)

    def save(self, path: Path) -> None:
        """Write the file atomically, replacing an earlier one. Raises `GcsError`."""
        t_s = self.t_s
        flags = np.array(self._flags, dtype=np.int64).reshape(len(t_s), len(self._sysids), 3)
        arrays: dict[str, Any] = {
            "t_s": t_s,
            "t_unix_s": t_s + self._epoch_unix_s,
            "state": self.state,
            "control": self._by_vehicle(self._controls, 4),
            "armed": flags[:, :, 0].astype(bool).T,
            "flying": flags[:, :, 1].astype(bool).T,
            "mode": flags[:, :, 2].T,
            "sysid": np.array(self._sysids),
            "boot_offset_s": np.array(self._boot_offset_s),
        }
        try:
            with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".npz", delete=False) as file:
                np.savez(file, **arrays)
            Path(file.name).replace(path)
        except OSError as error:
            raise GcsError(f"the true states cannot be written to {path}: {error.strerror}.") from error

    def _by_vehicle(self, rows: list[Array], width: int) -> Array:
        return np.array(rows).reshape(len(rows), len(self._sysids), width).swapaxes(0, 1)
