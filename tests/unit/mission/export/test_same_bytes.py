"""One plan file, exported as other machines would: with other kernels of BLAS, NumPy and the C library, other threads.

All formats are written, and every file, the index included, must be the same to the byte.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from gcs.plan.plan_file import save_plan
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from tests.machines import OLDEST, OTHERS, environment

EXPORT = """
import sys
from gcs.mission.export.export import export
from gcs.plan.plan_file import load_plan
plan, report = load_plan(sys.argv[1])
smooth_m = float(sys.argv[3]) or None
export(plan, sys.argv[2], formats=["all"], setpoint_rate_hz=5.0, report=report, smooth_m=smooth_m)
"""


def exported(plan: Path, folder: Path, variables: dict[str, str], smooth_m: float = 0.0) -> dict[str, bytes]:
    """The files of an export by a process with these environment variables."""
    command = [sys.executable, "-c", EXPORT, str(plan), str(folder), str(smooth_m)]
    subprocess.run(command, env=environment(variables), check=True, cwd=Path(__file__).parents[4])
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def assert_same(plan: Plan, tmp_path: Path, machines: list[dict[str, str]], smooth_m: float = 0.0) -> None:
    file = tmp_path / "plan.skein"
    save_plan(plan, verify(plan), file)
    first = exported(file, tmp_path / "here", {}, smooth_m)
    assert len(first) > len(plan.sysids)
    for number, variables in enumerate(machines):
        other = exported(file, tmp_path / str(number), variables, smooth_m)
        assert first.keys() == other.keys()
        assert [name for name in first if first[name] != other[name]] == [], variables


@pytest.mark.long
def test_the_oldest_processor_writes_the_same_bytes(hop: Plan, tmp_path: Path) -> None:
    assert_same(hop, tmp_path, [OLDEST], 0.5)


@pytest.mark.long
@pytest.mark.parametrize("name", ["simulation1", "field", "ridge"])
@pytest.mark.parametrize("smooth_m", [0.0, 0.5])
def test_every_processor_writes_the_same_bytes(
    plan_of: Callable[[str], Plan], tmp_path: Path, name: str, smooth_m: float
) -> None:
    assert_same(plan_of(f"{name}/scenario.toml"), tmp_path, [OLDEST, *OTHERS], smooth_m)
