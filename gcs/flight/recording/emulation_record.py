"""Under which conditions an emulated flight was flown, written as it begins, so that `gcs refly` can fly it again."""

import json
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from pydantic import TypeAdapter, ValidationError

from gcs.errors import FileFormatError
from gcs.flight.contingency.choices import OnLeaderLoss, OnLoss, TimeKeeping
from gcs.flight.setup.simulator_process import Emulated
from gcs.util.atomic_write import atomic_write
from gcs.util.bounded_file import EVENT_FILE, read_file

EMULATION, TRUTH = "emulation.json", "truth.npz"


@dataclass(frozen=True)
class EmulationRecord:
    """All that fixes an emulated flight beside its plan, to the last bit of the true states."""

    keeping: TimeKeeping
    emulated: Emulated
    follow: bool
    on_loss: OnLoss
    on_leader_loss: OnLeaderLoss
    skein: str = version("skein-gcs")


_RECORD = TypeAdapter(EmulationRecord)


def write_emulation(folder: Path, record: EmulationRecord) -> None:
    """Write the record into the folder of a flight."""
    atomic_write(folder / EMULATION, json.dumps(_RECORD.dump_python(record, mode="json"), indent=2) + "\n")


def read_emulation(folder: Path) -> EmulationRecord:
    """Return the record of a flight. Raises FileFormatError where there is none."""
    path = folder / EMULATION
    if not path.is_file():
        raise FileFormatError(
            f"{folder}: no {EMULATION} in this folder, so its conditions are not known.",
            hint="name the folder of a flight that `gcs fly --sim` has flown",
        )
    try:
        return _RECORD.validate_json(read_file(path, EVENT_FILE))
    except ValidationError as error:
        raise FileFormatError(
            f"{path}: {error.errors()[0]['msg']} at {'.'.join(map(str, error.errors()[0]['loc']))}.",
            hint=f"restore {EMULATION}, or fly the plan again with `gcs fly`",
        ) from error


def first_difference_s(one: Path, other: Path) -> float | None:
    """Return the emulated time from which the true states of two flights differ in any bit; None if they never do.

    Raises FileFormatError for a flight without true states.
    """
    first, second = _truth(one), _truth(other)
    t_s, count = first["t_s"], min(len(first["t_s"]), len(second["t_s"]))
    differs = np.zeros(count, dtype=bool)
    for name, values in first.items():
        others = second.get(name, np.zeros(0))
        timed = values.ndim and len(t_s) in values.shape[:2]
        if not timed or values.ndim != others.ndim:
            if values.tobytes() != others.tobytes():
                return float(t_s[0])
            continue
        axis = values.shape[:2].index(len(t_s))
        rows, other_rows = (np.moveaxis(v, axis, 0)[:count].reshape(count, -1) for v in (values, others))
        if rows.shape != other_rows.shape:
            return float(t_s[0])
        differs |= (_bits(rows) != _bits(other_rows)).any(axis=1)
    if differs.any():
        return float(t_s[int(np.argmax(differs))])
    longest = t_s if len(t_s) > count else second["t_s"]
    return float(longest[count]) if len(longest) > count else None


def _bits(rows: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(rows).view(np.uint8).reshape(len(rows), -1)


def _truth(folder: Path) -> dict[str, np.ndarray]:
    path = folder / TRUTH
    try:
        with np.load(path) as arrays:
            return dict(arrays)
    except (OSError, ValueError, KeyError, BadZipFile) as error:
        raise FileFormatError(
            f"{path}: the true states cannot be read: {error}.", hint="name the folder of a complete emulated flight"
        ) from error
