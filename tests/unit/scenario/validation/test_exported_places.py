"""What was given in degrees stands in the exported missions and fences, to the last digit."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gcs.cli.main import run


@pytest.mark.slow
def test_places_in_degrees_come_out_of_the_export(tmp_path: Path, repo_root: Path) -> None:
    page = (repo_root / "docs" / "scenario.md").read_text(encoding="utf-8")
    (tmp_path / "scenario.toml").write_text(page.partition("<<'END'\n")[2].partition("END\n")[0], encoding="utf-8")
    assert run(["plan", str(tmp_path), "--to", str(tmp_path / "airfield.skein")]) == 0
    assert run(["export", str(tmp_path / "airfield.skein"), "--to", str(tmp_path / "out")]) == 0
    plan = json.loads((tmp_path / "out" / "uav1.plan").read_text(encoding="utf-8"))
    (zone,) = [fence["polygon"] for fence in plan["geoFence"]["polygons"] if not fence["inclusion"]]
    assert sorted(zone) == [[47.401, 8.5508], [47.401, 8.5516], [47.4015, 8.5508], [47.4015, 8.5516]]
    (disk,) = [fence["circle"] for fence in plan["geoFence"]["circles"] if not fence["inclusion"]]
    assert (disk["center"], disk["radius"]) == ([47.4017, 8.5492], 25.0)
    lines = (tmp_path / "out" / "uav1.waypoints").read_text(encoding="utf-8").splitlines()
    last = [line.split("\t") for line in lines if line.split("\t")[3:4] == ["16"]][-1]
    assert tuple(map(float, last[8:11])) == pytest.approx((47.4025, 8.5508, 15.0), abs=1e-7)
