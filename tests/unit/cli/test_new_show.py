"""`gcs new` writes a scenario that plans at once; `gcs show` prints and draws a scenario or plan."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pymap3d
import pytest
from matplotlib import image

from gcs.cli import main
from gcs.cli.planning.plan import show_plan
from gcs.cli.shared.console import Screen
from gcs.plan.plan_file import load_plan
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario


def gcs(*arguments: object) -> int:
    return main.run([str(argument) for argument in arguments])


def is_drawn(path: Path) -> bool:
    return bool(np.ptp(image.imread(path)[..., :3]) > 0.5)


@pytest.mark.slow
def test_a_new_scenario_plans_at_once_and_is_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert gcs("new", tmp_path / "first", "--at", "-33.4", "-70.6", "740") == 0
    assert f"next: gcs plan {tmp_path / 'first'}" in capsys.readouterr().out
    assert gcs("plan", tmp_path / "first", "--to", tmp_path / "first.skein", "--json") == 0
    assert json.loads(capsys.readouterr().out)["ok"]
    assert gcs("show", tmp_path / "first", "--picture", tmp_path / "scenario.png") == 0
    text = capsys.readouterr().out
    assert "first: six quadrotors in a vee" in text
    assert "-33.400000, -70.600000, 740 m above the sea" in text
    assert "hover at 50 % of their thrust" in text
    assert gcs("show", tmp_path / "first.skein", "--picture", tmp_path / "plan.png", "--json") == 0
    shown = json.loads(capsys.readouterr().out)
    assert [row["sysid"] for row in shown["greatest_motion"]] == [1, 2, 3, 4, 5, 6]
    comfort = load_scenario(tmp_path / "first").limits
    assert comfort.accel_max_mps2 == comfort.jerk_max_mps3 == 2.0
    for row in shown["greatest_motion"]:
        assert 0.0 < row["accel_max_mps2"] <= 1.001 * comfort.accel_max_mps2
        assert 0.0 < row["jerk_max_mps3"] <= 1.001 * comfort.jerk_max_mps3
        assert 2.0 < row["speed_horizontal_max_mps"] <= 1.001 * float(np.hypot(*comfort.speed_ned_mps[:2]))
        assert 0.5 < row["speed_vertical_max_mps"] <= 1.001 * comfort.speed_ned_mps[2]
    clearance = re.match(r"yes: clearance ([0-9.]+) m, ", shown["verified"])
    assert clearance is not None
    assert 0.98 * 14.99 < float(clearance[1]) <= 14.99  # a bound, 2 % below the height over flat ground at most
    assert [pad["sysid"] for pad in shown["pads"]] == [1, 2, 3, 4, 5, 6]
    north, east, _ = pymap3d.geodetic2ned(
        *np.array([[p["lat_deg"], p["lon_deg"], p["alt_amsl_m"]] for p in shown["pads"]]).T, -33.4, -70.6, 740
    )
    assert north == pytest.approx([p["north_m"] for p in shown["pads"]], abs=0.02)
    assert east == pytest.approx([p["east_m"] for p in shown["pads"]], abs=0.02)
    assert gcs("show", tmp_path / "first.skein") == 0
    text = capsys.readouterr().out
    assert f"{shown['pads'][5]['lat_deg']:.7f}" in text
    fastest_mps, climb_mps = (
        max(row[f"speed_{way}_max_mps"] for row in shown["greatest_motion"]) for way in ("horizontal", "vertical")
    )
    assert f"│ {fastest_mps:.2f} m/s" in text
    show_plan(Screen(), *load_plan(tmp_path / "first.skein"))
    text = capsys.readouterr().out
    assert f"greatest horizontal speed {fastest_mps:.2f} m/s (vehicle " in text
    assert f"s; limit 5 north, 5 east), vertical {climb_mps:.2f} m/s (vehicle " in text
    assert is_drawn(tmp_path / "scenario.png")
    assert is_drawn(tmp_path / "plan.png")


def test_a_new_scenario_is_short_and_full_has_every_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert gcs("new", tmp_path / "first") == 0
    short = (tmp_path / "first" / "scenario.toml").read_text()
    assert len(short.splitlines()) <= 25
    assert gcs("new", tmp_path / "full" / "first", "--full") == 0
    full = tomllib.loads((tmp_path / "full" / "first" / "scenario.toml").read_text())
    drawn = {"route", "legs", "loops", "keep_in", "survey", "on"}  # by a person: no flight has them by default
    written = {"terrain", "wind", "vehicle", "geozones", "no_fly_beyond"}  # elsewhere, or by the program
    assert set(full) >= set(Scenario.model_fields) - written - drawn
    shown = []
    for folder in ("first", "full/first"):
        capsys.readouterr()
        assert gcs("show", tmp_path / folder, "--json") == 0
        shown.append(json.loads(capsys.readouterr().out))
    assert shown[0] == shown[1]
    assert load_scenario(tmp_path / "full" / "first").judge == load_scenario(tmp_path / "first").judge


def test_nothing_is_overwritten_and_bad_names_and_places_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert gcs("new", tmp_path / "first") == 0
    before = (tmp_path / "first" / "scenario.toml").read_text()
    for arguments, told in (
        ((tmp_path / "first",), "exists already"),
        ((tmp_path / "My Flight",), '"My Flight" cannot be the name'),
        ((tmp_path / "second", "--at", "95", "0", "0"), "--at 95 0 0: out of range"),
    ):
        assert gcs("new", *arguments) == 2
        assert told in capsys.readouterr().err
    assert (tmp_path / "first" / "scenario.toml").read_text() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["first"]


def test_an_elevation_model_is_shown(repo_root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert gcs("show", repo_root / "missions" / "ridge") == 0
    assert "ridge.tif, pixels of 10.0 m; clearance at least 6 m" in capsys.readouterr().out


@pytest.mark.parametrize("full", [False, True])
def test_a_flight_from_one_place_to_another(tmp_path: Path, full: bool) -> None:
    options = ["--full"] if full else []
    places = ["--at", "47.39,8.54,450", "--end", "47.393", "8.546"]
    assert gcs("new", tmp_path / "there", *places, "--count", 4, *options) == 0
    text = (tmp_path / "there" / "scenario.toml").read_text()
    assert "position_deg = [47.393, 8.546]" in text
    scenario = load_scenario(tmp_path / "there")
    lat_deg, lon_deg, _ = pymap3d.ned2geodetic(*scenario.end.position_m[:2], -15.0, 47.39, 8.54, 450)
    assert (lat_deg, lon_deg) == pytest.approx((47.393, 8.546), abs=1e-7)
    assert scenario.end.position_m[2] == 15.0
    assert scenario.start.roll_pitch_yaw_deg[2] == 53.6  # it faces its course


@pytest.mark.parametrize(
    ("options", "says", "then"),
    [
        (("--end", "47.393,8.546"), "from the origin; places are at most 100 km away", "--at LAT,LON"),
        (("--at", "47.39,8.54", "--end", "8.546,47.393"), "swapped latitude and longitude?", "--end 47.393,8.546"),
        (("--at", "47.39,8.54", "--end", "48,8.546"), "a flight is 1 to 20,000 m long", "another place"),
        (("--at", "47.39,8.54", "--end", "there"), "--end there: not a place", "--end 47.40,8.55"),
        (("--end", "47.393,8.546", "--distance", "9"), "gives the course and the distance", "leave out"),
    ],
)
def test_an_end_that_cannot_be_meant_is_asked_about(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], says: str, then: str
) -> None:
    assert gcs("new", tmp_path / "there", *options) == 2
    told = capsys.readouterr().err
    assert says in told and then in told
    assert not (tmp_path / "there").exists()
