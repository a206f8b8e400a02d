"""Other machines, as environment variables of a process: kernels of BLAS, NumPy and the C library, and threads.

The libraries themselves replace a kernel that this processor cannot run.
"""

from __future__ import annotations

import os

import numpy as np


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


def environment(variables: dict[str, str]) -> dict[str, str]:
    """The environment of a process on the machine with these variables."""
    known = {key: value for key, value in os.environ.items() if not key.startswith(("OPENBLAS_", "NPY_", "OMP_"))}
    return {**known, **variables}
