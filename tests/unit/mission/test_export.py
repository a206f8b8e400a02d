"""Export folders: complete, consistent, and replaced whole or not at all."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

from gcs.errors import FileFormatError, UsageError
from gcs.mission.build import build_missions
from gcs.mission.export import INDEX, export
from gcs.mission.planfile import read_plan_file
from gcs.mission.setpoints import read_setpoints
from gcs.mission.waypoints import read_waypoints
from gcs.plan.trajectory import Plan


def contents(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.iterdir()}


def test_everything_is_there_and_says_the_same(simulation1_plan: Plan, tmp_path: Path) -> None:
    index = export(simulation1_plan, tmp_path / "out", setpoint_rate_hz=2)
    written = contents(tmp_path / "out")
    document = json.loads(written.pop(INDEX))
    assert document["plan_hash"] == simulation1_plan.hash
    assert document["sha256"] == index.sha256
    assert {name: hashlib.sha256(data).hexdigest() for name, data in written.items()} == index.sha256
    for mission in build_missions(simulation1_plan):
        waypoints = read_waypoints(written[f"uav{mission.sysid}.waypoints"], "w")
        plan = read_plan_file(written[f"uav{mission.sysid}.plan"], "p")
        assert waypoints.items == plan.items == mission.items
        assert waypoints.home == plan.home == mission.home
        assert index.items == len(mission.items)
    assert read_setpoints(written["setpoints.csv"], "s").sysids == simulation1_plan.sysids


def test_px4_counts_no_home(simulation1_plan: Plan, tmp_path: Path) -> None:
    options = simulation1_plan.scenario.mission.model_copy(update={"autopilot": "px4"})
    plan = replace(simulation1_plan, scenario=simulation1_plan.scenario.model_copy(update={"mission": options}))
    export(plan, tmp_path, setpoint_rate_hz=2)
    file = read_waypoints((tmp_path / "uav1.waypoints").read_bytes(), "w", home_first=False)
    assert file.items == build_missions(plan)[0].items
    assert json.loads((tmp_path / "uav1.plan").read_text())["mission"]["firmwareType"] == 12


def test_the_same_plan_gives_the_same_bytes_and_replaces_the_old(simulation1_plan: Plan, tmp_path: Path) -> None:
    out = tmp_path / "out"
    export(simulation1_plan, out, setpoint_rate_hz=2)
    before = contents(out)
    (out / "uav3.plan").write_text("damaged")
    export(simulation1_plan, out, setpoint_rate_hz=2)
    assert contents(out) == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_failure_on_the_way_leaves_the_old_export(
    simulation1_plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    export(simulation1_plan, out, setpoint_rate_hz=2)
    before = contents(out)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        export(simulation1_plan, out, setpoint_rate_hz=5)
    assert contents(out) == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_folder_that_cannot_be_swapped_in_is_put_back(
    simulation1_plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    export(simulation1_plan, out, setpoint_rate_hz=2)
    before = contents(out)
    rename = Path.rename

    def refuse_new(self: Path, target: Path) -> Path:
        if self.name == "new":
            raise PermissionError(13, "Permission denied")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", refuse_new)
    with pytest.raises(PermissionError):
        export(simulation1_plan, out, setpoint_rate_hz=5)
    assert contents(out) == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_what_no_export_made_is_never_replaced(simulation1_plan: Plan, tmp_path: Path) -> None:
    out = tmp_path / "out"
    export(simulation1_plan, out, setpoint_rate_hz=2)
    (out / "notes.txt").write_text("mine")
    with pytest.raises(UsageError, match=r"notes\.txt"):
        export(simulation1_plan, out, setpoint_rate_hz=2)
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "cat.jpg").write_bytes(b"")
    with pytest.raises(UsageError, match=r"cat\.jpg"):
        export(simulation1_plan, tmp_path / "photos", setpoint_rate_hz=2)
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="is a file"):
        export(simulation1_plan, tmp_path / "file", setpoint_rate_hz=2)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"format": "other", "sha256": {}}'])
def test_somebody_elses_index(simulation1_plan: Plan, tmp_path: Path, text: str) -> None:
    (tmp_path / INDEX).write_text(text)
    with pytest.raises(FileFormatError, match="not the index of an export"):
        export(simulation1_plan, tmp_path, setpoint_rate_hz=2)
    assert (tmp_path / INDEX).read_text() == text
