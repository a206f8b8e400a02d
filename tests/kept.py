"""Plans and verdicts that tests share: kept on disk by what they are made from, and by the source of what makes them.

Workers of one run, later runs and CI find them there. A change of any file that takes part in planning or verifying
makes other names, so that nothing old is ever found. `SKEIN_TEST_CACHE` names the folder; what was not used for a week
goes.
"""

from __future__ import annotations

import functools
import hashlib
import inspect
import os
import pickle
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec, TypeVar

import gcs
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from gcs.util.atomic_write import atomic_write

if TYPE_CHECKING:
    import pytest

P = ParamSpec("P")
R = TypeVar("R")
ROOT = Path(gcs.__file__).resolve().parent.parent  # what runs: it may be a copy of the tree
WEEK_S = 7 * 86400.0
PATCHES: list[pytest.MonkeyPatch] = []  # of the test under way
MAKERS = ("gcs/*.py", "gcs/autopilots", "gcs/physics", "gcs/scenario", "gcs/plan", "requirements.lock")

# The environment of a program that shares plans with the tests; the command `gcs`, and the same as such a program.
SHARING = {"PYTHONPATH": str(Path(__file__).resolve().parent / "sharing")}
GCS_ALONE = [sys.executable, "-c", "import sys; from gcs.cli.main import run; sys.exit(run())"]
GCS = ["env", *(f"{name}={value}" for name, value in SHARING.items()), *GCS_ALONE]


def folder() -> Path:
    """Where results are kept."""
    default = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "skein-tests"
    return Path(os.environ.get("SKEIN_TEST_CACHE") or default)


@functools.cache
def source(*places: str) -> str:
    """The digest of files (or of all Python and TOML files of folders) below the repository."""
    digest = hashlib.sha256()
    for place in places:
        found = [ROOT / place] if (ROOT / place).is_file() else sorted((ROOT / place).rglob("*.[pt][yo]*"))
        for file in found or sorted(ROOT.glob(place)):
            if "__pycache__" not in file.parts:
                digest.update(f"{file.relative_to(ROOT)}\0".encode() + file.read_bytes())
    return digest.hexdigest()


def _text(value: object) -> str:
    """What tells one argument from another. Raises TypeError for what has no such text, as functions."""
    if isinstance(value, Scenario):
        return value.model_dump_json()
    if isinstance(value, Plan):
        return repr(value.content)
    if isinstance(value, tuple):
        return f"({','.join(_text(part) for part in value)})"
    if value is None or isinstance(value, bool | int | float | str):
        return repr(value)
    raise TypeError(type(value))


def _is_patched() -> bool:
    """Whether a test has changed code, so that nothing may be kept or found."""
    return any(p._setattr or any(table is not os.environ for table, *_ in p._setitem) for p in PATCHES)


def kept(function: Callable[P, R], *makers: str, apart_from: tuple[str, ...] = ()) -> Callable[P, R]:
    """The function; its result is read from disk where an earlier call with equal arguments left it.

    Arguments `apart_from` which it was made (workers, reports of progress) make no other result.
    """
    signature = inspect.signature(function)

    @functools.wraps(function)
    def reading(*args: P.args, **named: P.kwargs) -> R:
        if _is_patched():
            made: R = inspect.unwrap(function)(*args, **named)
            return made
        given = signature.bind(*args, **named).arguments
        telling = {key: value for key, value in given.items() if value is not signature.parameters[key].default}
        try:
            arguments = _text(tuple((key, telling[key]) for key in sorted(telling) if key not in apart_from))
        except TypeError:
            return function(*args, **named)
        name = hashlib.sha256(f"{source(*MAKERS, *makers)} {function.__qualname__} {arguments}".encode()).hexdigest()
        file = folder() / name
        try:
            result: R = pickle.loads(file.read_bytes())
            os.utime(file)
        except (OSError, EOFError, pickle.UnpicklingError):
            result = function(*args, **named)
            with suppress(OSError):  # a program under test may have no disk
                atomic_write(file, pickle.dumps(result))
        return result

    return reading


def make_room() -> None:
    """Takes away what no run has used for a week."""
    folder().mkdir(parents=True, exist_ok=True)
    for file in folder().iterdir():
        with suppress(FileNotFoundError):  # another process takes it away, or finishes writing it, at the same time
            if time.time() - file.stat().st_mtime > WEEK_S:
                file.unlink()
