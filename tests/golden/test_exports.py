"""Exports against those under missions/<name>/expected, as parsed data.

Plans of two machines differ by 5 mm or less (docs/planner.md); the tolerances here are ten times that. What a search
finds for a plan (speeds, orders of return altitudes, further rally points) is held against what the scenario requires,
and not against the numbers that it found before. After a change on purpose: `./tools/run python tools/golden.py`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pytest
import shapely

from gcs.mission.export.atomic_folder import INDEX
from gcs.mission.export.export import export
from gcs.mission.formats.qgc_plan import read_mission
from gcs.mission.formats.qgc_wpl import read_waypoints
from gcs.mission.formats.tables.setpoint_table import read_setpoints
from gcs.mission.model import Command, Frame, MissionItem
from gcs.plan.trajectory.plan import Plan

POSITION_M, SPEED_MPS, ACCELERATION_MPS2, YAW_DEG, DELAY_S = 0.05, 0.02, 0.02, 0.5, 0.05
LEAVING_S, LATE_S = 0.3, 2.0
FASTEST_MPS = 7.08  # 5 m/s north and 5 m/s east
FENCE_M, RADIUS_M = 0.5, 0.05
RTL_UNITS_PM = 100  # of RTL_ALT
DEGE7 = round(POSITION_M / 0.0075)  # a unit of longitude is 7.5 mm at this latitude


@pytest.fixture(scope="module", params=[pytest.param("simulation1", marks=pytest.mark.slow), "field"])
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def expected(repo_root: Path, name: str) -> Path:
    return repo_root / "missions" / name / "expected"


@pytest.fixture(scope="module")
def plan(plan_of: Callable[[str], Plan], name: str) -> Plan:
    return plan_of(f"{name}/scenario.toml")


@pytest.fixture(scope="module")
def fresh(plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("golden") / "export"
    export(plan, folder, setpoint_rate_hz=1.0)
    return folder


def test_every_mission_with_golden_files_is_here(repo_root: Path) -> None:
    assert {p.parent.name for p in (repo_root / "missions").glob("*/expected")} == {"simulation1", "field"}


def assert_close(item: MissionItem, golden: MissionItem) -> None:
    assert (item.command, item.frame, item.autocontinue) == (golden.command, golden.frame, golden.autocontinue)
    assert abs(item.lat_degE7 - golden.lat_degE7) <= DEGE7
    assert abs(item.lon_degE7 - golden.lon_degE7) <= DEGE7
    assert item.alt_m == pytest.approx(golden.alt_m, abs=POSITION_M)
    assert item.params[0] == pytest.approx(golden.params[0], abs=LEAVING_S)
    if item.command == Command.DO_CHANGE_SPEED:
        assert 0.0 < item.params[1] <= FASTEST_MPS
    else:
        assert item.params[1:3] == golden.params[1:3]
    turn = (item.params[3] - golden.params[3] + 180) % 360 - 180
    assert abs(turn) <= (YAW_DEG if item.frame == Frame.GLOBAL_RELATIVE_ALT else 0)


def test_the_same_files(fresh: Path, expected: Path) -> None:
    assert {p.name for p in fresh.iterdir()} == {p.name for p in expected.iterdir()}


def test_nobody_edited_the_golden_files_by_hand(expected: Path) -> None:
    index = json.loads((expected / INDEX).read_text())
    for name, digest in index["sha256"].items():
        assert hashlib.sha256((expected / name).read_bytes()).hexdigest() == digest, name


def test_the_index(fresh: Path, expected: Path) -> None:
    ours, golden = (json.loads((folder / INDEX).read_text()) for folder in (fresh, expected))
    bound_to_one_solution = {"plan_hash", "sha256", "deviation", "verified", "timing", "returns", "parameters"}
    bound_to_one_solution.add("separations")
    assert ours.keys() == golden.keys()
    for key in ours.keys() - bound_to_one_solution:
        assert ours[key] == golden[key], key


def test_what_the_missions_hold(fresh: Path, expected: Path, plan: Plan) -> None:
    limits = plan.scenario.limits
    for folder in (fresh, expected):
        verified = json.loads((folder / INDEX).read_text())["verified"]
        assert [f for f in verified["findings"] if f["level"] == "error"] == []
        assert verified["clearance_min_m"] >= limits.clearance_min_m - plan.scenario.mission.tolerance_m
        assert verified["separation_min_m"] >= plan.scenario.judge.separation_min_m


def test_when_everybody_is_expected(fresh: Path, expected: Path) -> None:
    ours, golden = (json.loads((folder / INDEX).read_text()) for folder in (fresh, expected))
    assert ours["refused"] is golden["refused"] is None
    for timing in (ours["timing"], golden["timing"]):
        assert abs(timing["late_s"]) <= LATE_S
        assert timing["spread_s"] <= 0.1 * LATE_S
        assert timing["nearest"]["distance_m"] >= 0.3


def test_returns(fresh: Path, expected: Path, plan: Plan) -> None:
    """Altitudes are a step apart and clear of the ground, all vehicles may return at once, and fences are higher."""
    limits = plan.scenario.limits
    indices = [json.loads((folder / INDEX).read_text()) for folder in (fresh, expected)]
    through = [[(z["zone"], z["ends"]) for z in index["returns"]["through_zones"]] for index in indices]
    assert through[0] == through[1]
    for index in indices:
        returns, parameters = index["returns"], index["parameters"]
        homes_m = dict(zip(map(str, plan.sysids), -plan.pads_ned_m[:, 2], strict=True))
        tops_m = sorted(homes_m[key] + values["RTL_ALT"] / RTL_UNITS_PM for key, values in parameters.items())
        assert np.diff(tops_m).min() >= limits.separation_min_m
        assert tops_m[0] >= returns["ground_max_m"] + limits.clearance_min_m - 1e-3
        assert tops_m[-1] == pytest.approx(returns["top_m"], abs=1e-3)
        for near in (returns["worst"], returns["routed_worst"]):
            assert near["distance_m"] >= plan.scenario.judge.separation_min_m
        for key, values in parameters.items():
            assert values["FENCE_ALT_MAX"] >= returns["top_m"] - homes_m[key] + 9.9
    assert indices[0]["returns"]["step_m"] == indices[1]["returns"]["step_m"]
    searched = {"RTL_ALT", "RTL_SPEED", "FENCE_ALT_MAX"}
    for vehicle, values in indices[0]["parameters"].items():
        assert values.keys() == indices[1]["parameters"][vehicle].keys()
        same = values.keys() - searched
        assert {key: values[key] for key in same} == {key: indices[1]["parameters"][vehicle][key] for key in same}


@pytest.mark.parametrize("sysid", range(1, 7))
def test_fence_and_rally_points(fresh: Path, expected: Path, name: str, sysid: int) -> None:
    ours, golden = (read_mission((d / f"uav{sysid}.plan").read_bytes(), str(d)) for d in (fresh, expected))
    assert [p.inclusion for p in ours.geofence.polygons] == [p.inclusion for p in golden.geofence.polygons] == [True]
    for circle, other in zip(ours.geofence.circles, golden.geofence.circles, strict=True):
        assert (circle.center, circle.inclusion) == (other.center, other.inclusion)
        assert circle.radius_m == pytest.approx(other.radius_m, abs=RADIUS_M)
    assert len(ours.geofence.circles) == (2 if name == "field" else 0)
    shapes = [
        shapely.Polygon([(p.lon_degE7, p.lat_degE7) for p in file.geofence.polygons[0].points])
        for file in (ours, golden)
    ]
    assert shapely.hausdorff_distance(*shapes) <= DEGE7 * FENCE_M / POSITION_M
    landing, golden_landing = ours.rally[0].place, golden.rally[0].place
    assert abs(landing.lat_degE7 - golden_landing.lat_degE7) <= DEGE7
    assert abs(landing.lon_degE7 - golden_landing.lon_degE7) <= DEGE7
    assert 1 <= len(ours.rally) <= (8 if name == "field" else 1)
    assert all(shapes[0].contains(shapely.Point(p.place.lon_degE7, p.place.lat_degE7)) for p in ours.rally)
    for folder, file in ((fresh, ours), (expected, golden)):
        parameters = json.loads((folder / INDEX).read_text())["parameters"][str(sysid)]
        assert all(p.alt_m * 100 == pytest.approx(parameters["RTL_ALT"]) for p in file.rally)


@pytest.mark.parametrize("sysid", range(1, 7))
def test_missions(fresh: Path, expected: Path, sysid: int) -> None:
    ours, golden = (read_waypoints((d / f"uav{sysid}.waypoints").read_bytes(), str(d)) for d in (fresh, expected))
    assert len(ours.items) == len(golden.items)
    for item, other in zip(ours.items, golden.items, strict=True):
        assert_close(item, other)
    assert ours.home is not None
    assert golden.home is not None
    assert astuple(ours.home) == pytest.approx(astuple(golden.home), abs=1e-8)
    plan = read_mission((expected / f"uav{sysid}.plan").read_bytes(), "expected")
    assert (plan.home, plan.items) == (golden.home, golden.items)


@pytest.mark.parametrize("sysid", range(1, 7))
def test_setpoints(fresh: Path, expected: Path, sysid: int) -> None:
    name = f"uav{sysid}.setpoints"
    files = [read_setpoints((folder / name).read_bytes(), str(folder)) for folder in (fresh, expected)]
    ours, golden = (file.stream for file in files)
    assert files[0].origin == files[1].origin
    assert ours.sysids == golden.sysids
    assert np.array_equal(ours.t_s, golden.t_s)
    assert np.allclose(ours.position_ned_m, golden.position_ned_m, rtol=0, atol=POSITION_M)
    assert np.allclose(ours.velocity_ned_mps, golden.velocity_ned_mps, rtol=0, atol=SPEED_MPS)
    assert np.allclose(ours.acceleration_ned_mps2, golden.acceleration_ned_mps2, rtol=0, atol=ACCELERATION_MPS2)
    assert np.allclose(ours.yaw_ned_rad, golden.yaw_ned_rad, rtol=0, atol=np.radians(YAW_DEG))
