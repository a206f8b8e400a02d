"""What `gcs plan`, `show`, `verify` and `check` say about a no-fly zone whose corner is in the way, and of limits."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from gcs.cli import main

SCENARIO = """
schema_version = 1
name = "corner"
vehicle_type = "quad500"
origin = { lat_deg = 47.39, lon_deg = 8.54, alt_amsl_m = 450.0 }
time = { flight_s = 30.0 }
start = { position_m = [0.0, 0.0, 8.0] }
end = { position_m = [60.0, 0.0, 8.0] }
no_fly = [{ polygon_m = [[30.0, 1.0], [45.0, -30.0], [15.0, -30.0]] }]

[limits]
north_m = [-30.0, 90.0]
east_m = [-60.0, 60.0]
height_m = [0.0, 20.0]
clearance_min_m = 2.0
separation_min_m = 5.0
MARGIN

[formation]
count = 2
start_shape = "line"
shape = [{ name = "line", generator = "line", spacing_m = 8.0 }]
"""


@pytest.fixture
def said(capsys: pytest.CaptureFixture[str]) -> object:
    def gcs(line: str, code: int = 0) -> str:
        assert main.run(line.split()) == code
        both = capsys.readouterr()
        return " ".join(both.out.split() + both.err.split())

    return gcs


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    (tmp_path / "corner").mkdir()
    return tmp_path / "corner"


def test_a_thin_margin_is_said_by_plan_show_verify(folder: Path, said) -> None:  # type: ignore[no-untyped-def]
    (folder / "scenario.toml").write_text(SCENARIO.replace("MARGIN", "zone_margin_m = 0.0"))
    planned = said("plan corner --to corner.skein")
    sentence = "the navigation error of gnss sensors is up to 2.45 m (3 sigma). Set limits.zone_margin_m = 2.45, or"
    error = "up to 2.45 m horizontally, 2.84 m in height (gnss sensors, 3 sigma)"
    assert "distance to no-fly zones" in planned
    for line in ("verify corner.skein", "show corner.skein"):
        told = said(line)
        assert sentence in told, told
        assert error in told
    assert sentence in planned and f"navigation error: {error}" in planned
    assert "margin at least 0 m" in said("show corner")


def test_the_default_margin_is_kept_and_limits_are_not_lost(folder: Path, said) -> None:  # type: ignore[no-untyped-def]
    (folder / "scenario.toml").write_text(SCENARIO.replace("MARGIN", ""))
    planned = json.loads(said("plan corner --to corner.skein --json"))
    assert planned["nearest_zone"]["distance_m"] >= 2.45 - 1e-3
    assert planned["navigation_error"] == {"horizontal_m": 2.45, "vertical_m": 2.84}
    told = said("show corner.skein")
    assert "Set limits.zone_margin_m" not in told
    assert "margin where there is room 2.45 m" in told
    assert re.search(r"no-fly zones [23]\.\d\d m away", told)
    said("export corner.skein --to out")
    for against in ("corner", "corner.skein"):
        checked = said(f"check out/uav1.plan out/uav2.plan --terrain {against}")
        assert "≥ 1.54 m (plan: 5 m)" in checked, checked
        assert "≥ 1.5 m (plan: 2 m)" in checked
        assert "distance to no-fly zones" in checked and "zone 1, uav" in checked
        assert "≤ 20.5 m (plan: 20 m)" in checked
    report = json.loads(said("check out/uav1.plan out/uav2.plan --terrain corner --json"))
    assert (report["separation_asked_m"], report["separation_planned_m"]) == (1.54, 5.0)
    assert report["zone_min_m"] > 1.5
