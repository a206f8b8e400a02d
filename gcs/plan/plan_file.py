"""Plans on disk: one `.skein` file (a NumPy archive) with the polynomials, the scenario and the verdict of its writer.

A file can be changed, and its checksum made anew. So the stored verdict is for display only: `load_plan` verifies the
plan again, and nothing else gives a report that permits a flight or an export.
"""

from __future__ import annotations

import base64
import hashlib
import io
import json
import os
import warnings
from collections.abc import Callable
from dataclasses import asdict, astuple, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter
from scipy.interpolate import PPoly

from gcs.errors import FileFormatError, UsageError
from gcs.physics.states import POSITION
from gcs.plan.formation.shape import Shape
from gcs.plan.formation.timeline import Move
from gcs.plan.prepared_returns import PreparedReturn, PreparedReturns
from gcs.plan.trajectory.leg_lines import LegLimits
from gcs.plan.trajectory.passages import passages_contradiction
from gcs.plan.trajectory.phases import Phase, PhaseKind, phases_of
from gcs.plan.trajectory.plan import Alternative, MeshRound, Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.plan.verification.verify import OK, Check, Report, verdict_of, verify
from gcs.scenario.environment.no_fly import zones
from gcs.scenario.schema.scenario import Scenario
from gcs.types import AnyArray, JsonObject
from gcs.util.archives import ArrayKind, BadArchive, read_arrays
from gcs.util.atomic_write import atomic_write
from gcs.util.bounded_file import MIB, PLAN_FILE, SHEETS, open_regular, read_json, refuse_size
from gcs.util.long_work import report as say_at

SUFFIX = ".skein"
_FORMAT = 2
_MAGIC = b"PK\x03\x04"  # of a zip archive with at least one file
_HINT = "make it anew with `gcs plan`"
_JOINTS_BYTES = 8 * 10_000
ARRAYS = {
    "meta": ArrayKind("u1", 1, 32 * MIB),
    "joints_s": ArrayKind("f8", 1, _JOINTS_BYTES),
    "state": ArrayKind("f8", 3, 32 * MIB),
    "control": ArrayKind("f8", 3, 16 * MIB),
    "shape_joints_s": ArrayKind("f8", 1, _JOINTS_BYTES),
    "shape_functions": ArrayKind("f8", 3, 16 * MIB),
    "shape_tables_ned_m": ArrayKind("f8", 3, 64 * MIB),
    "checksum": ArrayKind("u1", 1, 32),
}


@dataclass(frozen=True)
class _StoredMargins:
    """What decides on a stored check; its name and the rest are for people."""

    worst: float
    tolerance: float
    proved: float | None = None  # older files have none


_PHASES = TypeAdapter(tuple[Phase, ...])
_ROUNDS = TypeAdapter(tuple[MeshRound, ...])
_ALTERNATIVES = TypeAdapter(tuple[Alternative, ...])
_MOVES = TypeAdapter(tuple[Move, ...])
_CHECKS = TypeAdapter(tuple[_StoredMargins, ...])
_SAME_M = 1e-3  # two verdicts with figures this close say the same, and two places are one
_SAME_S = 1e-6


@dataclass(frozen=True)
class StoredVerdict:
    """What a plan file says about its own plan. It permits nothing."""

    ok: bool
    clearance_min_m: float
    separation_min_m: float | None  # of one vehicle there is none

    def difference(self, found: Report) -> str:
        """What a verification found otherwise, in words; empty if it agrees."""
        if self.ok != found.ok:
            stored = "verified" if self.ok else "failed"
            return f"its stored verdict is '{stored}', but it {'passes' if found.ok else 'fails'} verification now"
        figures = (
            ("clearance", self.clearance_min_m, found.clearance_min_m),
            ("separation", self.separation_min_m or 0.0, found.separation_min_m or 0.0),
        )
        for name, stored_m, found_m in figures:
            if not abs(stored_m - found_m) <= _SAME_M:
                return f"its stored verdict says {name} {stored_m:.3f} m, but verification now finds {found_m:.3f} m"
        return ""


@dataclass(frozen=True)
class StoredReturns:
    """The prepared returns of a plan file as they are written there: neither read nor verified."""

    rows: tuple[JsonObject, ...] = ()


def save_plan(plan: Plan, report: Report, path: Path | str, returns: PreparedReturns | None = None) -> None:
    """Write plan and verdict; an older file is replaced only when the new one is complete.

    `returns` are kept in it as plan files of their own, which `load_returns` reads and older versions pass over. Raises
    UsageError where they are too large together.
    """
    write_plan(plan, report, path, returns)


def write_plan(plan: Plan, report: Report, path: Path | str, returns: PreparedReturns | StoredReturns | None) -> None:
    """The same, also with returns as another file has them."""
    atomic_write(Path(path), _content(plan, report, returns))


def _content(plan: Plan, report: Report, returns: PreparedReturns | StoredReturns | None = None) -> bytes:
    """The bytes of a plan file."""
    meta: JsonObject = {
        "format": _FORMAT,
        "scenario": plan.scenario.model_dump(mode="json"),
        "phases": [asdict(p) for p in plan.phases],
        "objective": plan.objective,
        "mesh_history": [asdict(r) for r in plan.mesh_history],
        "alternatives": [asdict(a) for a in plan.alternatives],
        "moves": [asdict(m) for m in plan.moves],
        "timings_s": plan.timings_s,
        "begin_state": plan.begin_state,
        "report": {**asdict(report), "checks": [_stored(check) for check in report.checks]},
    }
    if plan.route_s:
        meta["route_s"] = plan.route_s
        meta["leg_limits"] = [[m if np.isfinite(m) else None for m in astuple(one)] for one in plan.leg_limits]
    if plan.used_before:
        meta["used_before"] = plan.used_before
    if plan.zones_since_s:
        meta["zones_since_s"] = [t_s if np.isfinite(t_s) else None for t_s in plan.zones_since_s]
    if returns is not None:
        rows = returns.rows if isinstance(returns, StoredReturns) else map(_stored_return, returns.returns)
        meta["returns"] = list(rows)
    text = json.dumps(meta).encode()
    if len(text) > ARRAYS["meta"].largest_bytes:
        raise UsageError(
            f"the plan with its returns has {len(text) / MIB:.0f} MiB; a file has room for "
            f"{ARRAYS['meta'].largest_bytes / MIB:.0f} MiB",
            hint="prepare fewer returns (--every)",
        )
    buffer = io.BytesIO()
    motion = plan.leader_trajectory
    arrays = {
        "meta": np.frombuffer(text, dtype=np.uint8),
        "joints_s": motion.joints_s,
        "state": motion.state.c,
        "control": motion.control.c,
        "shape_joints_s": plan.shape.joints_s,
        "shape_functions": plan.shape.functions.c,
        "shape_tables_ned_m": plan.shape.basis_ned_m,
    }
    np.savez_compressed(buffer, **arrays, checksum=_checksum(arrays))
    return buffer.getvalue()


def _stored_return(one: PreparedReturn) -> dict[str, object]:
    """A return as the file has it: its own plan file as text, or the reason why there is none."""
    data: dict[str, object] = {"begins_s": one.begins_s, "why_not": one.why_not, "cpu_s": one.cpu_s}
    if one.plan is not None:
        data["plan"] = base64.b64encode(_content(one.plan, verify(one.plan))).decode()
    return data


def is_plan_file(path: Path) -> bool:
    """Whether a path is to be read as a plan: its content begins as an archive does, else its suffix is `.skein`."""
    try:
        if path.is_dir() or path.suffix.lower() in SHEETS:  # some sheets are archives too
            return False
        with os.fdopen(open_regular(path), "rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC or path.suffix == SUFFIX
    except (FileFormatError, OSError, ValueError):
        return path.suffix == SUFFIX


def load_plan(path: Path | str, say: Callable[[str], None] = warnings.warn) -> tuple[Plan, Report]:
    """The plan of a file, and the report of its verification, made now: what the file says of itself permits nothing.

    `say` takes a sentence when the stored verdict is another one. Raises FileFormatError for a file that is missing,
    damaged, no plan, or cannot be verified. The content decides, not the file's name.
    """
    plan, stored = read_plan(path)
    try:
        with np.errstate(all="ignore"):  # a polynomial without bounds fails its checks
            report = verify(plan)
    except Exception as problem:  # polynomials that no planner made fail in NumPy and SciPy in ways of their own
        raise FileFormatError(
            f"{path}: the plan cannot be verified ({type(problem).__name__}: {problem})", hint=_HINT
        ) from problem
    if difference := stored.difference(report):
        say(f"{path}: {difference}")
    return plan, report


def load_returns(path: Path | str) -> PreparedReturns:
    """The returns that are kept in a plan file, each verified now, which takes about as long as verifying the plan.

    A return that no longer passes, or that begins otherwise than the plan flies there, has the reason instead. A file
    without returns has none. Raises FileFormatError as `load_plan` does.
    """
    plan, _ = read_plan(path)
    return PreparedReturns(tuple(_checked(plan, one) for one in read_returns(path, stored_returns(path)).returns))


def stored_returns(path: Path | str) -> StoredReturns:
    """The returns of a plan file as it has them, to be kept in another one. Raises FileFormatError."""
    try:
        meta = read_json(_arrays(Path(path))["meta"].tobytes(), not_finite=True)
        return StoredReturns(tuple(meta.get("returns", ())))
    except FileFormatError:
        raise
    except Exception as problem:
        raise _damaged(path, problem) from problem


def read_returns(path: Path | str, stored: StoredReturns) -> PreparedReturns:
    """The returns that a plan file has, in order of time, not verified. Raises FileFormatError."""
    try:
        found = [_decoded(path, row) for row in stored.rows]
    except FileFormatError:
        raise
    except Exception as problem:
        raise _damaged(path, problem) from problem
    return PreparedReturns(tuple(sorted(found, key=lambda one: one.begins_s)))


def _damaged(path: Path | str, problem: Exception) -> FileFormatError:
    return FileFormatError(f"{path}: its returns are damaged ({type(problem).__name__})", hint=_HINT)


def _decoded(path: Path | str, row: JsonObject) -> PreparedReturn:
    """One return of a file."""
    begins_s, cpu_s = float(row["begins_s"]), float(row["cpu_s"])
    if "plan" not in row:
        return PreparedReturn(begins_s, None, str(row["why_not"]), cpu_s)
    label = f"{path}, return from t = {begins_s:g} s"
    content = io.BytesIO(base64.b64decode(row["plan"], validate=True))
    try:
        made, _ = _read(label, _finite(label, read_arrays(content, ARRAYS)))
    except BadArchive as reason:
        raise FileFormatError(f"{label}: not a plan of this program: {reason}", hint=_HINT) from reason
    return PreparedReturn(begins_s, made, "", cpu_s)


def _checked(plan: Plan, one: PreparedReturn) -> PreparedReturn:
    """One return, verified."""
    made, begins_s = one.plan, one.begins_s
    if made is None:
        return one
    say_at(f"verifying the return from t = {begins_s:g} s")
    at_s = np.array([begins_s])
    if made.sysids != plan.sysids or made.begin_state is None or abs(made.t_start_s - begins_s) > _SAME_S:
        return replace(one, plan=None, why_not="it is not a return of this plan")
    apart_m = float(np.abs(made.states(at_s)[..., POSITION] - plan.states(at_s)[..., POSITION]).max())
    if not apart_m <= _SAME_M:
        return replace(one, plan=None, why_not=f"it begins {apart_m:.3f} m beside the plan")
    with np.errstate(all="ignore"):
        found = verify(made)
    if not found.ok:
        return replace(one, plan=None, why_not=f"it fails verification now: {found.failures[0]}")
    return one


def read_plan(path: Path | str) -> tuple[Plan, StoredVerdict]:
    """The plan of a file and its stored verdict, for display. Raises FileFormatError as `load_plan` does."""
    return _read(path, _arrays(Path(path)))


def _read(path: Path | str, arrays: dict[str, AnyArray]) -> tuple[Plan, StoredVerdict]:
    """The plan in the arrays of a file."""
    try:
        meta = read_json(arrays["meta"].tobytes(), not_finite=True)
        if meta["format"] != _FORMAT:
            raise FileFormatError(
                f"{path}: plan format {meta['format']} is not the {_FORMAT} of this version", hint=_HINT
            )
        checksum = arrays.pop("checksum")
        plan = Plan(
            Scenario.model_validate(meta["scenario"]),
            Trajectory(PPoly(arrays["state"], arrays["joints_s"]), PPoly(arrays["control"], arrays["joints_s"])),
            Shape(PPoly(arrays["shape_functions"], arrays["shape_joints_s"]), arrays["shape_tables_ned_m"]),
            _PHASES.validate_python(meta["phases"]),
            float(meta["objective"]),
            _ROUNDS.validate_python(meta["mesh_history"]),
            _ALTERNATIVES.validate_python(meta["alternatives"]),
            _MOVES.validate_python(meta["moves"]),
            {str(name): float(seconds) for name, seconds in meta["timings_s"].items()},
            None if meta.get("begin_state") is None else tuple(map(float, meta["begin_state"])),
            tuple(map(float, meta.get("route_s", ()))),
            tuple(LegLimits(*(np.inf if m is None else float(m) for m in one)) for one in meta.get("leg_limits", ())),
            zones_since_s=tuple(-np.inf if t_s is None else float(t_s) for t_s in meta.get("zones_since_s", ())),
            used_before=tuple(map(float, meta.get("used_before", ()))),
        )
        data = meta["report"]
        checks = _CHECKS.validate_python(data["checks"])
        separation_m = data["separation_min_m"]
        stored = StoredVerdict(
            all(verdict_of(check.worst, check.tolerance, check.proved) in OK for check in checks),
            float(data["clearance_min_m"]),
            None if separation_m is None else float(separation_m),
        )
        intact = np.array_equal(checksum, _checksum(arrays))
    except FileFormatError:
        raise
    except Exception as problem:  # other content fails in json, pydantic, NumPy, SciPy, ... in ways of its own
        raise FileFormatError(f"{path}: not a plan of this program ({type(problem).__name__})", hint=_HINT) from problem
    if not intact:
        raise FileFormatError(f"{path}: the plan was changed after it was written", hint=_HINT)
    if wrong := _contradiction(plan):
        raise FileFormatError(f"{path}: {wrong}", hint=_HINT)
    return plan, stored


def _arrays(path: Path) -> dict[str, AnyArray]:
    """The arrays of a file, finite, and no larger than those of a plan. Raises FileFormatError."""
    try:
        if not path.exists():
            raise FileFormatError(f"{path}: there is no such plan", hint="make it with `gcs plan`")
        with os.fdopen(open_regular(path, hint=_HINT), "rb") as file:
            refuse_size(path, os.fstat(file.fileno()).st_size, PLAN_FILE)
            arrays = read_arrays(file, ARRAYS)
    except BadArchive as reason:
        raise FileFormatError(f"{path}: not a plan of this program: {reason}", hint=_HINT) from reason
    except (OSError, ValueError) as problem:
        raise FileFormatError(f"{path}: not a plan of this program: {problem}", hint=_HINT) from None
    return _finite(path, arrays)


def _finite(path: Path | str, arrays: dict[str, AnyArray]) -> dict[str, AnyArray]:
    """The arrays. Raises FileFormatError for a number that is not finite."""
    for name, values in arrays.items():
        if not np.isfinite(values).all():
            where = tuple(int(n) for n in np.argwhere(~np.isfinite(values))[0])
            raise FileFormatError(f"{path}: {name}{list(where)} is {values[where]}, not a finite number", hint=_HINT)
    return arrays


def _stored(check: Check) -> dict[str, object]:
    """A check as the file has it: its constraint by name."""
    return {"name": check.name, **{key: value for key, value in asdict(check).items() if key != "constraint"}}


def _contradiction(plan: Plan) -> str:
    """What contradicts itself in a plan, in words; empty for a plan as `make_plan` or a re-plan makes it.

    The verifier tests each phase by its name, so other phases than those of the scenario would evade it.
    """
    motion, shape = plan.leader_trajectory, plan.shape
    for name, joints_s in (("joints_s", motion.joints_s), ("shape_joints_s", shape.joints_s)):
        if not (np.diff(joints_s) > 0.0).all():
            return f"{name} do not increase"
    if motion.state.c.shape[2] != 12:
        return f"the leader has {motion.state.c.shape[2]} states, not 12"
    expected = phases_of(plan.scenario)
    if plan.begin_state is not None:
        if len(plan.begin_state) != 12 or not np.isfinite(plan.begin_state).all():
            return "the state that it begins with is not 12 finite numbers"
        mission = next(n for n, phase in enumerate(expected) if phase.name == PhaseKind.MISSION)
        expected = (Phase(PhaseKind.MISSION, motion.start_s, expected[mission].end_s), *expected[mission + 1 :])
    if not all(0.0 <= share <= 1.0 for share in plan.used_before):
        return "the used shares of batteries are not numbers from 0 to 1"
    if plan.phases != expected or not motion.start_s < plan.flight_s:
        return "its phases are not those of its scenario"
    if len(plan.zones_since_s) not in (0, len(zones(plan.scenario))):
        return f"it says since when {len(plan.zones_since_s)} zones count, and has {len(zones(plan.scenario))}"
    mission_s = plan.phase(PhaseKind.MISSION).start_s, plan.phase(PhaseKind.MISSION).end_s
    in_the_air = plan.begin_state is not None
    if wrong := passages_contradiction(plan.scenario, plan.route_s, mission_s, in_the_air=in_the_air):
        return wrong
    if plan.leg_limits and len(plan.leg_limits) != len(plan.route_s) + 1:
        return f"it has limits of {len(plan.leg_limits)} legs for {len(plan.route_s)} route points"
    if not all(most > 0.0 for limits in plan.leg_limits for most in astuple(limits)):  # not a number either
        return "the limits of a leg are not numbers above 0"
    span = (expected[0].start_s, expected[-1].end_s)
    for name, part in (("leader's track", motion), ("shape", shape)):
        if not np.allclose((part.start_s, part.end_s), span, rtol=0.0, atol=1e-6):
            return f"the {name} is from {part.start_s:g} to {part.end_s:g} s, its phases {span[0]:g} to {span[1]:g} s"
    return ""


def _checksum(arrays: dict[str, AnyArray]) -> NDArray[np.uint8]:
    """SHA-256 over everything in the file, against damage. It proves nothing about the writer."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        digest.update(name.encode() + np.ascontiguousarray(arrays[name]).tobytes())
    return np.frombuffer(digest.digest(), dtype=np.uint8)
