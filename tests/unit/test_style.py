"""ruff and mypy --strict run with the tests, so that there is one verdict."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.parametrize(
    "command",
    [
        ("ruff", "check", "."),
        ("ruff", "format", "--check", "."),
        ("mypy", "--strict", "gcs", "sim_bridge", "tools"),
    ],
    ids=" ".join,
)
def test_style(command: tuple[str, ...], repo_root: Path) -> None:
    if command[0] == "mypy":
        command = tuple(part for part in command if part != "tools" or any((repo_root / "tools").rglob("*.py")))
    done = subprocess.run([sys.executable, "-m", *command], cwd=repo_root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
