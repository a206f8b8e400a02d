"""`gcs new` writes times, speeds and phases that its vehicles can fly."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from gcs.cli import main
from gcs.scenario.schema.vehicle_types import preset_file
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.values.si import route_points

ROUTE = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t46.1\t9.2\t500\t1
1\t0\t3\t178\t1\t9\t0\t0\t0\t0\t0\t1
2\t0\t3\t16\t0\t0\t0\t0\t46.1001\t9.2\t20\t1
3\t0\t3\t16\t0\t0\t0\t0\t46.1011\t9.2\t40\t1
4\t0\t3\t16\t0\t0\t0\t0\t46.1021\t9.2\t20\t1
"""
ROOM = 0.9


def vehicle_file(speeds: tuple[float, float]) -> Path:
    """The usual vehicle with other speeds, horizontal and vertical."""
    text = preset_file("quad500").read_text(encoding="utf-8")
    line = f"speed_ned_mps = [{speeds[0]}, {speeds[0]}, {speeds[1]}]"
    file = Path("own.toml")
    file.write_text(re.sub(r"^speed_ned_mps = .*$", line, text, flags=re.MULTILINE), encoding="utf-8")
    return file


@pytest.mark.parametrize("speeds", [(1.5, 0.5), (5.0, 1.5), (12.0, 4.0)])
@pytest.mark.parametrize("line", ["--route r.waypoints --count 1 --shape line", "--count 3", ""])
def test_a_flight_takes_the_time_that_its_vehicles_need(
    line: str, speeds: tuple[float, float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("r.waypoints").write_text(ROUTE, encoding="utf-8")
    assert main.run(["new", "own", *line.split(), "--vehicle", str(vehicle_file(speeds))]) == 0
    scenario = load_scenario("own")
    assert scenario.limits.speed_ned_mps == (speeds[0], speeds[0], speeds[1])
    stops = [scenario.start, *route_points(scenario), scenario.end]
    legs_m = np.abs(np.diff([stop.position_m for stop in stops], axis=0))
    assert (legs_m / scenario.limits.speed_ned_mps).max(axis=1).sum() <= ROOM * scenario.time.flight_s
    assert scenario.start.position_m[2] / speeds[1] <= ROOM * scenario.ground_phases.takeoff_s
    drawn = [point.speed_mps for point in route_points(scenario) if point.speed_mps is not None]
    assert all(speed <= 0.8 * speeds[0] + 1e-9 for speed in drawn)
    if "--route" in line:
        assert scenario.time.flight_s == {1.5: 190.0, 5.0: 65.0, 12.0: 40.0}[speeds[0]]


def test_six_small_vehicles_over_a_stage_stand_as_near_as_they_are_small(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, height_m in (("pads.csv", 0.0), ("row.csv", 0.9)):
        rows = [f"{n + 1},{0.6 * n - 1.5:.1f},{height_m},{height_m}" for n in range(6)]
        Path(name).write_text("\n".join(["number,x,y,z", *rows]) + "\n", encoding="utf-8")
    new = "new stage --at 47.4,8.55,488 --positions pads.csv --shapes row.csv"
    made = "new-vehicle lab.toml --mass 0.035 --propeller 1.8 --battery 1S250mAh"
    assert main.run(made.split()) == 0
    assert main.run([*new.split(), "--spacing", "0.4"]) == 2
    assert "vehicles of 0.75 m would be 0.6 m apart" in capsys.readouterr().err
    assert main.run([*new.split(), "--spacing", "0.4", "--vehicle", "lab.toml"]) == 0
    assert load_scenario("stage").limits.separation_min_m == 0.4
    assert load_scenario("stage").route[0].position_m[2] == 0.9  # as in the sheet, though it is low
    assert main.run([*new.replace("stage", "usual").split(), "--vehicle", "lab.toml"]) == 0
    assert load_scenario("usual").limits.separation_min_m == pytest.approx(0.36)
