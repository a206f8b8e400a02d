"""One plan file, exported as other machines would: with other kernels of BLAS, NumPy and the C library, other threads.

Variables tell the libraries which processor they run on. A kernel that this processor cannot run is replaced by the
library itself. All formats are written, and every file, the index included, must be the same to the byte.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.plan_file import save_plan
from gcs.plan.verification.verify import verify

EXPORT = """
import sys
from gcs.mission.export.export import export
from gcs.plan.trajectory.plan_file import load_plan
plan, report = load_plan(sys.argv[1])
smooth_m = float(sys.argv[3]) or None
export(plan, sys.argv[2], formats=["all"], setpoint_rate_hz=5.0, report=report, smooth_m=smooth_m)
"""


def simd(level: int) -> str:
    """NumPy's kernels above this level of the processor, which has some of them."""
    return " ".join(np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])[level:])


OLDEST = {
    "OPENBLAS_CORETYPE": "Nehalem",
    "OPENBLAS_NUM_THREADS": "1",
    "NPY_DISABLE_CPU_FEATURES": simd(0),
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F",
    "PYTHONHASHSEED": "1",
    "LC_ALL": "C",
    "TZ": "Asia/Kathmandu",
}
OTHERS = [
    {"OPENBLAS_CORETYPE": "Haswell", "OPENBLAS_NUM_THREADS": "2", "NPY_DISABLE_CPU_FEATURES": simd(1)},
    {"OPENBLAS_CORETYPE": "SkylakeX", "OPENBLAS_NUM_THREADS": "1", "PYTHONHASHSEED": "2"},
    {"OPENBLAS_CORETYPE": "Prescott", "OPENBLAS_NUM_THREADS": "2"},
    {"OPENBLAS_CORETYPE": "Zen", "NPY_DISABLE_CPU_FEATURES": simd(2), "LC_ALL": "C.UTF-8"},
]


def exported(plan: Path, folder: Path, variables: dict[str, str], smooth_m: float = 0.0) -> dict[str, bytes]:
    """The files of an export by a process with these environment variables."""
    known = {key: value for key, value in os.environ.items() if not key.startswith(("OPENBLAS_", "NPY_"))}
    command = [sys.executable, "-c", EXPORT, str(plan), str(folder), str(smooth_m)]
    subprocess.run(command, env={**known, **variables}, check=True, cwd=Path(__file__).parents[4])
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


def test_the_oldest_processor_writes_the_same_bytes(plan_of: Callable[[str], Plan], tmp_path: Path) -> None:
    assert_same(plan_of("field/scenario.toml"), tmp_path, [OLDEST])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["simulation1", "field", "ridge"])
@pytest.mark.parametrize("smooth_m", [0.0, 0.5])
def test_every_processor_writes_the_same_bytes(
    plan_of: Callable[[str], Plan], tmp_path: Path, name: str, smooth_m: float
) -> None:
    assert_same(plan_of(f"{name}/scenario.toml"), tmp_path, [OLDEST, *OTHERS], smooth_m)
