"""`gcs prove`: its verdicts as a table, as JSON and as exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from gcs.cli import main
from gcs.frames import ned_to_geodetic
from gcs.mission.formats.qgc_wpl import write_fence
from gcs.mission.geofence import FenceCircle, FencePolygon, Geofence, GeoPoint
from gcs.plan.plan_file import save_plan
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.scenario.values.si import local_origin


@pytest.fixture
def crossing(tmp_path: Path) -> list[str]:
    """Two vehicles that cross 0.453 m apart at t = 4.925 s, half way between two samples."""
    (tmp_path / "a.csv").write_text("t,x,y,z\n0,0,0,10\n10,20,0,10\n")
    (tmp_path / "b.csv").write_text("t,x,y,z\n0,9.7,-10,10.4\n10,9.7,10,10.4\n")
    return ["prove", *(str(tmp_path / name) for name in ("a.csv", "b.csv")), "--frame", "enu"]


def test_a_proof_ends_with_0(crossing: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run([*crossing, "--separation", "0.45", "--height", "5", "12"]) == 0
    out = capsys.readouterr().out
    assert "≥ 0.4528 m" in out
    assert "no limit is stated: speed, acceleration, jerk, thrust, tilt, ground, no-fly zones" in out
    assert "proved: yes, 2 vehicles from 0 s to 10 s" in out


def test_a_violation_ends_with_5_and_names_the_pair_and_the_instant(
    crossing: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.run([*crossing, "--separation", "0.5"]) == 5
    error = capsys.readouterr().err
    assert "separation: 0.453 m at t = 4.9" in error
    assert "(vehicles a and b), at least 0.5 m required" in error


def test_json_has_every_check(crossing: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run([*crossing, "--separation", "0.5", "--vertical-scale", "2", "--json"]) == 5
    data = json.loads(capsys.readouterr().out)
    separation = next(check for check in data["checks"] if check["name"] == "separation")
    assert (data["ok"], separation["verdict"], separation["vehicles"]) == (False, "violated", ["a", "b"])
    assert separation["seen"] == pytest.approx((0.3**2 / 2 + 0.2**2) ** 0.5, abs=2e-3)


def test_the_spans_in_which_it_must_not_be_broken_off_are_named(
    crossing: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.run([*crossing, "--separation", "0.45", "--abort", "hold"]) == 0
    assert "separation, broken" in capsys.readouterr().out
    line = [*crossing, "--separation", "0.45", "--abort", "land"]
    assert main.run(line) == 5
    said = capsys.readouterr()
    assert "4.11 s to 4.40 s: separation, broken off to land 0.212" in said.out
    assert "not proved: separation, broken off to land" in said.err
    assert main.run([*line, "--json"]) == 5
    (span,) = json.loads(capsys.readouterr().out)["unsafe"]
    assert (span["vehicles"], span["verdict"]) == (["a", "b"], "violated")
    assert (span["start_s"], span["end_s"]) == (pytest.approx(4.118, abs=0.011), pytest.approx(4.398, abs=0.011))
    assert span["seen"] == pytest.approx(0.2121, abs=5e-3)


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        (["--separation", "-1"], 2, "--separation"),
        (["--clearance", "3", "--separation", "1"], 2, "give the scenario"),
        ([], 2, "no separation is stated"),
        (["--separation", "1", "--acceleration", "3"], 2, "straight between samples"),
        (["--separation", "1", "--scenario", "none"], 3, "none"),
    ],
)
def test_what_cannot_be_proved_is_refused(
    crossing: list[str], capsys: pytest.CaptureFixture[str], line: list[str], code: int, words: str
) -> None:
    assert main.run([*crossing, *line]) == code
    assert words in capsys.readouterr().err


def test_a_broken_file_ends_with_6(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "a.csv"
    file.write_text("t,x,y,z\n0,0,0,ten\n")
    assert main.run(["prove", str(file), "--frame", "enu"]) == 6
    assert "a.csv, line 2: z must be a finite number, got 'ten'" in capsys.readouterr().err


def test_a_plan_file_is_proved_by_its_own_polynomials_and_may_be_broken_off(
    simulation1_plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "flight.skein"
    save_plan(simulation1_plan, verify(simulation1_plan), file)
    assert main.run(["prove", str(file), "--abort", "hold", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["vehicles"] == [str(sysid) for sysid in simulation1_plan.sysids]
    apart = {check["name"]: check["seen"] for check in data["checks"]}
    t_s = np.linspace(simulation1_plan.t_start_s, simulation1_plan.t_end_s, 20_001)
    least_m = float(simulation1_plan.separations_m(simulation1_plan.clamped(t_s)).min())
    assert apart["separation"] == pytest.approx(least_m, abs=2e-3)
    assert apart["separation, broken off to hold"] == pytest.approx(0.5, abs=1e-3)
    assert main.run(["prove", str(file), str(file)]) == 2
    assert "give it alone" in capsys.readouterr().err


def test_the_areas_of_a_fence_file_are_kept(
    simulation1_plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A square that all of the flight is in, with a hole on its way: 5 m about the place of vehicle 1 at t = 100 s."""
    plan = simulation1_plan
    file, fence = tmp_path / "flight.skein", tmp_path / "area.fence"
    save_plan(plan, verify(plan), file)
    origin = local_origin(plan.scenario)

    def fenced(half_m: float, circle: FenceCircle) -> Geofence:
        corners = half_m * np.array([[-1, -1, 0], [-1, 1, 0], [1, 1, 0], [1, -1, 0]], dtype=np.float64)
        lat, lon, _ = ned_to_geodetic(corners, origin)
        return Geofence((FencePolygon(tuple(map(GeoPoint.at, lat.tolist(), lon.tolist())), inclusion=True),), (circle,))

    place = plan.states(np.array([100.0]))[0, 0, :3]
    lat, lon, _ = ned_to_geodetic(place[None], origin)
    hole = FenceCircle(GeoPoint.at(float(lat[0]), float(lon[0])), 5.0, inclusion=False)
    far = FenceCircle(GeoPoint.at(float(lat[0]) + 0.1, float(lon[0])), 5.0, inclusion=False)
    for half_m, circle, unkept in ((3000.0, far, []), (3000.0, hole, ["no-fly zone"]), (1100.0, far, ["keep-in area"])):
        fence.write_text(write_fence(fenced(half_m, circle)))
        assert main.run(["prove", str(file), "--fence", str(fence), "--json"]) == (5 if unkept else 0)
        checks = json.loads(capsys.readouterr().out)["checks"]
        assert all(any(word in one["name"] for word in unkept) for one in checks if one["verdict"] != "proved")
        assert any("keep-in area" in one["name"] for one in checks)
    inside = next(one for one in checks if "keep-in" in one["name"])
    assert inside["verdict"] == "violated"
    north_m = float(plan.states(plan.clamped(np.linspace(0.0, 292.0, 5001)))[:, :, 0].max())
    assert inside["seen"] == pytest.approx(1100.0 - north_m, abs=0.1)
    lat, lon, _ = ned_to_geodetic(np.array([[2e5, 0.0, 0.0]]), origin)
    fence.write_text(
        write_fence(Geofence((), (FenceCircle(GeoPoint.at(float(lat[0]), float(lon[0])), 9.0, inclusion=True),)))
    )
    assert main.run(["prove", str(file), "--fence", str(fence)]) == 6
    assert "cannot be kept beside the scenario's origin" in capsys.readouterr().err
    assert main.run(["prove", str(file), "--fence", str(file)]) == 6


def test_a_fence_needs_an_origin(crossing: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fence = tmp_path / "area.fence"
    fence.write_text("47 8\n47 8\n47.1 8\n47.1 8.1\n47 8\n")
    assert main.run([*crossing, "--separation", "0.4", "--fence", str(fence)]) == 2
    assert "give the scenario" in capsys.readouterr().err
