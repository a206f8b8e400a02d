"""The library does what the commands do: the tutorial's example flies; vehicles on links arm only when confirmed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import gcs
from gcs.plan.trajectory.plan import Plan
from tests.kept import SHARING
from tests.unit.docs.test_readme import BLOCKS

MISSION = '"simulation1"'


@pytest.mark.long
def test_the_example_plans_exports_and_flies(short_mission: Path, tmp_path: Path) -> None:
    """On a flight of half a minute instead of six."""
    (block,) = (b for b in BLOCKS["docs/tutorial.md"] if b.language == "python" and "gcs.fly(" in b.code)
    assert MISSION in block.code
    assert len(block.code.splitlines()) <= 10
    code = block.code.replace(MISSION, repr(str(short_mission)))
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={**os.environ, **SHARING},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    folder, held, rms_m = done.stdout.split()
    assert held in ("True", "False")
    assert 0.0 < float(rms_m) < 1.0
    names = {entry.name for entry in (tmp_path / folder).iterdir()}
    assert {"plan.skein", "telemetry.tlog", "events.jsonl", "truth.npz", "report.json", "export"} <= names
    assert len(list((tmp_path / "out").glob("*.waypoints"))) == 6


def test_vehicles_on_a_link_are_not_armed_without_confirmation(hop: Plan, tmp_path: Path) -> None:
    with pytest.raises(gcs.GcsError, match="not armed without confirmation") as caught:
        gcs.fly(hop, link=gcs.Connection(("udpin:127.0.0.1:0",)), to=tmp_path)
    assert "confirmed=True" in caught.value.hint
    assert list(tmp_path.iterdir()) == []


def test_everything_public_is_there_and_described() -> None:
    for name in gcs.__all__:
        assert getattr(gcs, name).__doc__, name
    assert {"load_scenario", "make_plan", "verify", "export", "Connection", "fly"} <= set(gcs.__all__)
