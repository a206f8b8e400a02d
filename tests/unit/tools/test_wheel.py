"""The wheel as a user has it: in an environment of its own, far from the tree."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

SIZE_MAX = 2_000_000  # bytes


@pytest.mark.slow
def test_a_bundled_mission_plans_and_checks_from_the_wheel_alone(tmp_path: Path, repo_root: Path) -> None:
    """The environment has the wheel only. Its dependencies are those of this one, which pip would fetch for minutes."""

    def done(*command: str | Path, **more: str) -> str:
        kept = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        ran = subprocess.run(command, cwd=tmp_path, env=kept | more, capture_output=True, text=True, check=False)
        assert ran.returncode == 0, f"{command}: {ran.stdout}{ran.stderr}"
        return ran.stdout

    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(build, cwd=repo_root, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    assert wheel.stat().st_size < SIZE_MAX
    names = zipfile.ZipFile(wheel).namelist()
    assert any(name.endswith("licenses/LICENSE") for name in names)
    assert not [name for name in names if "/expected/" in name or name.startswith(("tests/", "tools/", "docs/"))]

    venv = tmp_path / "venv"
    done(sys.executable, "-m", "venv", venv)
    done(venv / "bin" / "python", "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", wheel)
    libraries = {
        "PYTHONPATH": sysconfig.get_path("purelib")
    }  # its .pth files, and so this tree, are not read from there
    gcs = venv / "bin" / "gcs"
    where = done(venv / "bin" / "python", "-c", "import gcs; print(gcs.__file__)", **libraries)
    assert Path(where.strip()).is_relative_to(venv)
    commit = subprocess.run(["git", "rev-parse", "HEAD"], cwd=repo_root, capture_output=True, text=True, check=True)
    assert done(gcs, "--version", **libraries).strip().endswith(f"(commit {commit.stdout[:9]})")

    planned = json.loads(done(gcs, "plan", "ridge", "--json", **libraries))
    assert planned["ok"] and (tmp_path / "plans" / "ridge.skein").is_file()
    done(gcs, "export", "plans/ridge.skein", "--to", "out", "--format", "plan", **libraries)
    missions = sorted((tmp_path / "out").glob("*.plan"))
    assert json.loads(done(gcs, "check", *missions, "--terrain", "ridge", "--json", **libraries))["ok"]
