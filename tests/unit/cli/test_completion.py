"""Completion by the shell: installed by its option, it offers missions, flights and words, and opens no link."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from gcs.cli.shared.shared_options import flights, missions, plans, recordings

GCS = Path(sys.executable).with_name("gcs")
SCENARIO = "schema_version = 1\n"


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with missions, plans and flights."""
    for name in ("missions/field/scenario.toml", "missions/far/below/gap/scenario.toml", "mine/alone.toml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(SCENARIO)
    (tmp_path / "missions/field/field.skein").touch()
    (tmp_path / "mine/field.skein").touch()
    (tmp_path / "mine/pyproject.toml").write_text("[project]\n")
    for day in ("2026-01-01-120000-field", "2026-02-01-120000-gap"):
        (tmp_path / "flights" / day).mkdir(parents=True)
        (tmp_path / "flights" / day / "flight.json").touch()
    (tmp_path / "flights/other.tlog").touch()
    (tmp_path / ".hidden/mission").mkdir(parents=True)
    (tmp_path / ".hidden/mission/scenario.toml").write_text(SCENARIO)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_missions_are_offered_and_not_what_lies_in_them(place: Path) -> None:
    assert missions("") == ["mine/alone.toml", "mine/field.skein", "missions/field"]
    assert missions("missions/f") == ["missions/far/below/gap", "missions/field"]
    assert missions("./mi") == ["./mine/alone.toml", "./mine/field.skein", "./missions/field"]
    assert missions(f"{place}/missions/fi") == [f"{place}/missions/field"]
    assert missions("nowhere/") == []


def test_plans_flights_and_logs_are_offered(place: Path) -> None:
    assert plans("mine/") == ["mine/field.skein"]
    newest_first = ["flights/2026-02-01-120000-gap", "flights/2026-01-01-120000-field"]
    assert flights("") == newest_first
    assert recordings("fl") == [*newest_first, "flights/other.tlog"]


def test_a_large_folder_is_not_read_whole(tmp_path: Path) -> None:
    for number in range(60):
        for inner in range(100):
            (tmp_path / f"{number}" / f"{inner}").mkdir(parents=True)
    assert missions(f"{tmp_path}/") == []


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes_what_install_completion_installed(place: Path) -> None:
    home = place / "home"
    home.mkdir()
    environment = {**os.environ, "HOME": str(home), "PATH": f"{GCS.parent}:{os.environ['PATH']}"}

    def bash(script: str) -> str:
        # A command after it: bash would replace itself by the last one, and the shell is found by its process.
        done = subprocess.run(
            ["bash", "-c", f"{script}\n:"], cwd=place, env=environment, capture_output=True, text=True, check=True
        )
        return done.stdout

    assert "bash completion installed" in bash("gcs --install-completion")

    def offered(line: str) -> list[str]:
        words = line.split(" ")
        typed = " ".join(f"'{word}'" for word in words)
        return bash(
            f"source ~/.bashrc; COMP_WORDS=({typed}); COMP_CWORD={len(words) - 1}; "
            'complete -p gcs >/dev/null; _gcs_completion gcs; printf "%s\\n" "${COMPREPLY[@]}"'
        ).split()

    assert offered("gcs plan missions/fi") == ["missions/field"]
    assert offered("gcs pl") == ["plan"]
    assert offered("gcs new first --shape c") == ["column", "circle"]
    assert offered("gcs replay ")[0] == "flights/2026-02-01-120000-gap"
