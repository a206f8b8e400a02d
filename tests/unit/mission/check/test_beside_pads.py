"""The ground beside the take-off and the landing of missions, and on the way to their first waypoint."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs.cli.main import run
from gcs.frames import Origin
from gcs.mission.check.findings import Level, Rule
from gcs.mission.check.fleet_check import check_pads
from gcs.mission.flight_limits import FlightLimits, Surroundings
from gcs.mission.predicted.planned_flight import fly
from gcs.scenario.sources.template import scenario_text
from gcs.types import Array
from tests.unit.mission.fleets import FLAT, ORIGIN, UNKNOWN, at, do, mission, out_and_land

LIMITS = FlightLimits(clearance_m=5.0)
HOME = (-35.363262, 149.165237)  # of the scenario that `gcs new` writes
WAY = [(22, 0.0), (16, 60.0), (21, 60.0)]


def wall(from_m: float, to_m: float, height_m: float = 6.0) -> Surroundings:
    """Flat ground with a wall between two places north of home."""

    def heights(north: Array, east: Array) -> Array:
        return np.where((north >= from_m) & (north <= to_m), height_m, 0.0) + 0.0 * east

    def highest(low_m: Array, high_m: Array) -> Array:
        return np.where((high_m[:, 0] >= from_m) & (low_m[:, 0] <= to_m), height_m, 0.0)

    return Surroundings(ORIGIN, heights, highest)


@pytest.mark.parametrize(
    ("around", "item", "message"),
    [
        (FLAT, None, None),
        (UNKNOWN, None, None),
        (wall(1.5, 1.8), None, None),
        (wall(0.5, 0.8), 1, "0.50 m from the ground beside the pad, 2.4 m above it; at least 0.53 m required"),
        (wall(0.5, 0.8, 2.0), None, None),
        (wall(59.2, 59.5), 4, "0.50 m from the ground beside the landing point, 2.4 m above it"),
        (Surroundings(ORIGIN, lambda north, east: 1.0 * north + 0.0 * east), None, None),
    ],
)
def test_slopes_beside_a_pad_are_allowed_and_walls_are_not(
    around: Surroundings, item: int | None, message: str | None
) -> None:
    over = mission(out_and_land(60.0, up_m=15.0))
    found = list(check_pads(over, fly(over, around), around, LIMITS))
    assert [(f.rule, f.level, f.item) for f in found] == ([] if item is None else [(Rule.TERRAIN, Level.ERROR, item)])
    assert message is None or found[0].message.startswith(message)


def test_a_wall_beside_the_place_to_which_a_mission_returns() -> None:
    back = mission([at(22, 0, 0, 15), at(16, 60, 0, 15), do(20)])
    around = wall(0.3, 0.4)
    found = list(check_pads(back, fly(back, around), around, LIMITS))
    assert [(f.item, "landing point" in f.message) for f in found] == [(1, False), (3, True)]


def test_a_home_below_the_ground_is_told() -> None:
    low = mission(out_and_land(60.0, up_m=15.0), home=(0.0, 0.0, -3.2))
    found = list(check_pads(low, fly(low, FLAT), FLAT, LIMITS))
    assert [(f.rule, f.level) for f in found] == [(Rule.TERRAIN, Level.WARNING)]
    assert found[0].message == "home is 3.20 m below the ground; altitudes above home are too low by as much"
    near = mission(out_and_land(60.0, up_m=15.0), home=(0.0, 0.0, -0.4))
    assert list(check_pads(near, fly(near, FLAT), FLAT, LIMITS)) == []


def waypoints(folder: Path) -> Path:
    """A mission of another ground station: up 15 m, 60 m north, down."""
    rows = ["QGC WPL 110", f"0\t1\t0\t16\t0\t0\t0\t0\t{HOME[0]}\t{HOME[1]}\t584\t1"]
    for number, (command, north_m) in enumerate(WAY, start=1):
        lat_deg, alt_m = HOME[0] + north_m / 111_195.0, 0.0 if command == 21 else 15.0
        rows.append(f"{number}\t0\t3\t{command}\t0\t0\t0\t0\t{lat_deg:.7f}\t{HOME[1]:.7f}\t{alt_m}\t1")
    file = folder / "mine.waypoints"
    file.write_text("\n".join(rows) + "\n")
    return file


@pytest.mark.parametrize(
    ("hill", "item", "told"),
    [
        ((25.0, 40.0, 8.0), 2, "flies into the ground, 2"),
        ((1.7, 10.0, 1.0), 1, "from the ground beside the pad"),
    ],
)
def test_a_hill_beside_the_pad_that_the_first_leg_cuts_is_found_as_typed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], hill: tuple[float, float, float], item: int, told: str
) -> None:
    scenario = tmp_path / "first" / "scenario.toml"
    scenario.parent.mkdir()
    north_m, height_m, spread_m = hill
    keys = f"north_m = [{north_m}]\neast_m = [0.0]\nheight_m = [{height_m}]\n"
    keys += f"spread_north_m = [{spread_m}]\nspread_east_m = [{spread_m}]\n"
    scenario.write_text(f"{scenario_text(scenario.parent, Origin(*HOME, 584.0))}\n[terrain.mountains]\n{keys}")
    code = run(["check", str(waypoints(tmp_path)), "--terrain", str(scenario), "--timing", "planned"])
    output = capsys.readouterr()
    assert code == 11, output.err
    assert [line for line in output.out.splitlines() if f"error [terrain] item {item}" in line and told in line]
