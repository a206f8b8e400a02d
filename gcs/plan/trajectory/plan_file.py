"""Plans on disk: one `.skein` file (a NumPy archive) with the polynomials, the scenario and the verdict."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from gcs.errors import FileFormatError
from gcs.files import atomic_write
from gcs.plan.formation.changes.timeline import Move
from gcs.plan.formation.shape import Shape
from gcs.plan.trajectory.plan import Alternative, MeshRound, Phase, Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.plan.verification.verify import Check, Report
from gcs.scenario.schema.scenario import Scenario

SUFFIX = ".skein"
_FORMAT = 2
_MAGIC = b"PK\x03\x04"  # of a zip archive with at least one file
_ARRAYS = (
    "meta",
    "joints_s",
    "state",
    "control",
    "shape_joints_s",
    "shape_functions",
    "shape_tables_ned_m",
    "checksum",
)


def save_plan(plan: Plan, report: Report, path: Path | str) -> None:
    """Write plan and verdict; an older file is replaced only when the new one is complete."""
    meta = {
        "format": _FORMAT,
        "scenario": plan.scenario.model_dump(mode="json"),
        "phases": [asdict(p) for p in plan.phases],
        "objective": plan.objective,
        "mesh_history": [asdict(r) for r in plan.mesh_history],
        "alternatives": [asdict(a) for a in plan.alternatives],
        "moves": [asdict(m) for m in plan.moves],
        "timings_s": plan.timings_s,
        "begin_state": plan.begin_state,
        "report": asdict(report),
    }
    buffer = io.BytesIO()
    motion = plan.leader_trajectory
    arrays = {
        "meta": np.frombuffer(json.dumps(meta).encode(), dtype=np.uint8),
        "joints_s": motion.joints_s,
        "state": motion.state.c,
        "control": motion.control.c,
        "shape_joints_s": plan.shape.joints_s,
        "shape_functions": plan.shape.functions.c,
        "shape_tables_ned_m": plan.shape.basis_ned_m,
    }
    np.savez_compressed(buffer, **arrays, checksum=_checksum(arrays))
    atomic_write(Path(path), buffer.getvalue())


def is_plan_file(path: Path) -> bool:
    """Whether a path is to be read as a plan: its content begins as an archive does, else its suffix is `.skein`."""
    try:
        with path.open("rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC or path.suffix == SUFFIX
    except IsADirectoryError:
        return False
    except OSError:
        return path.suffix == SUFFIX


def load_plan(path: Path | str) -> tuple[Plan, Report]:
    """The plan and its verdict; raises FileFormatError for a file that is missing, damaged, or no plan.

    The content decides, not the file's name.
    """
    hint = "make it anew with `gcs plan`"
    if Path(path).is_file() and not zipfile.is_zipfile(path):
        raise FileFormatError(f"{path}: not a plan of this program: its content is no NumPy archive", hint=hint)
    try:
        with np.load(path, allow_pickle=False) as archive:
            if lacking := [name for name in _ARRAYS if name not in archive.files]:
                raise FileFormatError(
                    f"{path}: not a plan of this program: the archive has no array {lacking[0]}", hint=hint
                )
            arrays = {name: archive[name] for name in archive.files}
        meta = json.loads(arrays["meta"].tobytes())
        if meta["format"] != _FORMAT:
            raise FileFormatError(
                f"{path}: plan format {meta['format']} is not the {_FORMAT} of this version", hint=hint
            )
        checksum = arrays.pop("checksum")
        plan = Plan(
            Scenario.model_validate(meta["scenario"]),
            Trajectory(PPoly(arrays["state"], arrays["joints_s"]), PPoly(arrays["control"], arrays["joints_s"])),
            Shape(PPoly(arrays["shape_functions"], arrays["shape_joints_s"]), arrays["shape_tables_ned_m"]),
            tuple(Phase(**p) for p in meta["phases"]),
            meta["objective"],
            tuple(MeshRound(**{**r, "complaints": tuple(r["complaints"])}) for r in meta["mesh_history"]),
            tuple(Alternative(**a) for a in meta["alternatives"]),
            tuple(Move(**m) for m in meta["moves"]),
            meta["timings_s"],
            None if meta.get("begin_state") is None else tuple(meta["begin_state"]),
        )
        verdict = meta["report"]
        report = Report(tuple(Check(**c) for c in verdict.pop("checks")), **verdict)
        intact = np.array_equal(checksum, _checksum(arrays))
    except FileNotFoundError:
        raise FileFormatError(f"{path}: there is no such plan", hint="make it with `gcs plan`") from None
    except FileFormatError:
        raise
    except Exception as problem:  # a damaged archive fails in NumPy, zipfile, zlib, tokenize, ... in ways of their own
        raise FileFormatError(f"{path}: not a plan of this program ({type(problem).__name__})", hint=hint) from problem
    if not intact:
        raise FileFormatError(f"{path}: the plan was changed after it was written", hint=hint)
    return plan, report


def _checksum(arrays: dict[str, NDArray[Any]]) -> NDArray[np.uint8]:
    """SHA-256 over everything in the file, the verdict included, so that no edited verdict passes."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        digest.update(name.encode() + np.ascontiguousarray(arrays[name]).tobytes())
    return np.frombuffer(digest.digest(), dtype=np.uint8)
