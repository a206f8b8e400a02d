"""Heights that were drawn above the ground stay heights above the ground, over an elevation model or level ground."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from gcs.cli.planning.plan_tables import say_lines
from gcs.cli.shared.console import Screen
from gcs.errors import UsageError
from gcs.frames import Origin, ned_to_geodetic
from gcs.mission.drawings.drawing import Drawing
from gcs.mission.drawings.labels import sentences
from gcs.mission.drawings.route_formats import drawing_in
from gcs.mission.drawings.to_scenario.route_flight import RouteFlight, route_flight, route_text
from gcs.plan.trajectory.leg_lines import leg_lines
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

RIDGE = Path(__file__).parents[5] / "missions" / "ridge" / "ridge.tif"
ORIGIN = Origin(-33.42, -70.58, 740.0)
LAT, LON, _ = ned_to_geodetic(np.array([[20.0, 0.0, 0.0], [350.0, 20.0, 0.0], [670.0, 0.0, 0.0]]), ORIGIN)
PLACES = list(zip(LAT.tolist(), LON.tolist(), strict=True))
ABOVE_M = 20.0


def kml() -> str:
    rows = " ".join(f"{lon},{lat},{ABOVE_M}" for lat, lon in PLACES)
    shape = f"<altitudeMode>relativeToGround</altitudeMode><coordinates>{rows}</coordinates>"
    return f"<kml><Placemark><LineString>{shape}</LineString></Placemark></kml>"


def geojson() -> str:
    geometry = {"type": "LineString", "coordinates": [[lon, lat, ABOVE_M] for lat, lon in PLACES]}
    return json.dumps({"type": "Feature", "properties": {"altitudeMode": "relativeToGround"}, "geometry": geometry})


def waypoints() -> str:
    rows = ["QGC WPL 110", f"0\t1\t0\t16\t0\t0\t0\t0\t{PLACES[0][0]}\t{PLACES[0][1]}\t740\t1"]
    rows += [f"{n}\t0\t10\t16\t0\t0\t0\t0\t{lat}\t{lon}\t{ABOVE_M}\t1" for n, (lat, lon) in enumerate(PLACES, start=1)]
    return "\n".join(rows)


def plan() -> str:
    items = [
        {"type": "SimpleItem", "command": 16, "frame": 10, "params": [0, 0, 0, 0, lat, lon, ABOVE_M]}
        for lat, lon in PLACES
    ]
    mission = {"version": 2, "firmwareType": 3, "plannedHomePosition": [*PLACES[0], 740], "items": items}
    return json.dumps({"fileType": "Plan", "version": 1, "mission": mission})


DRAWN = {"x.kml": kml, "x.geojson": geojson, "x.waypoints": waypoints, "x.plan": plan}


def drawn(name: str) -> Drawing:
    return drawing_in(DRAWN[name]().encode(), name)


def scenario_of(flight: RouteFlight, folder: Path) -> Scenario:
    folder.mkdir()
    (folder / "scenario.toml").write_text(route_text(folder, flight), encoding="utf-8")
    return load_scenario(folder)


def places(scenario: Scenario) -> list[Any]:
    return [scenario.start, *scenario.route, scenario.end]


@pytest.mark.parametrize("name", DRAWN)
def test_heights_above_the_ground_count_from_an_elevation_model(name: str, tmp_path: Path) -> None:
    flight = route_flight(drawn(name), terrain=RIDGE, count=2, shape="line")
    scenario = scenario_of(flight, tmp_path / "over")
    assert [place.height_above_ground_m for place in places(scenario)] == [ABOVE_M] * 3
    for place in places(scenario):
        north, east, height_m = place.position_m
        ground_m = float(ground_height_m(scenario.terrain, np.array(north), np.array(east)))
        assert height_m - ground_m == pytest.approx(ABOVE_M, abs=1e-3)
    assert scenario.route[0].position_m[2] > 60.0  # on the ridge
    assert scenario.origin.alt_amsl_m == pytest.approx(740.0, abs=0.3)  # of home, else of the ground
    assert not any("level ground" in one for one in sentences(flight.left_out))


@pytest.mark.parametrize("name", DRAWN)
def test_without_an_elevation_model_the_ground_is_level_and_that_is_said(name: str, tmp_path: Path) -> None:
    flight = route_flight(drawn(name), (*PLACES[0], 700.0), count=2, shape="line")
    scenario = scenario_of(flight, tmp_path / "level")
    assert [place.height_above_ground_m for place in places(scenario)] == [ABOVE_M] * 3
    assert [place.position_m[2] for place in places(scenario)] == [ABOVE_M] * 3
    (said,) = (one for one in sentences(flight.left_out) if "level ground" in one)
    assert "--terrain" in said


def test_the_box_holds_the_ground_between_the_points(tmp_path: Path) -> None:
    ends = [PLACES[0], PLACES[2]]
    rows = " ".join(f"{lon},{lat},{ABOVE_M}" for lat, lon in ends)
    mode = "<altitudeMode>relativeToGround</altitudeMode>"
    text = f"<kml><Placemark><LineString>{mode}<coordinates>{rows}</coordinates></LineString></Placemark></kml>"
    flight = route_flight(drawing_in(text.encode(), "x.kml"), terrain=RIDGE, count=1, shape="line")
    scenario = scenario_of(flight, tmp_path / "box")
    way_m = np.linspace(scenario.start.position_m, scenario.end.position_m, 200)
    ground_m = ground_height_m(scenario.terrain, way_m[:, 0], way_m[:, 1])
    assert ground_m.max() > 40.0  # no point of the route is on the ridge
    assert scenario.limits.height_m[1] >= ground_m.max() + ABOVE_M
    assert scenario.limits.height_m[0] <= ground_m.min()
    climbed_m = float(np.abs(np.diff(ground_m)).sum())
    assert scenario.time.flight_s > 1.1 * climbed_m / scenario.limits.speed_ned_mps[2]


def test_lines_above_the_ground_are_told_where_no_line_is_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight = route_flight(drawn("x.plan"), terrain=RIDGE, count=2, shape="line")
    scenario = scenario_of(flight, tmp_path / "free")
    lines = tuple(line.opened(beside=True, above=True) for line in leg_lines(scenario))
    made = cast("Plan", SimpleNamespace(scenario=scenario, lines=lines, begin_state=None))
    say_lines(Screen(json=False), made)
    told = " ".join(capsys.readouterr().out.split())
    assert "the leader keeps within no limit; 2 lines at a height above the ground" in told


def test_an_elevation_model_of_another_place_is_refused_by_its_option() -> None:
    away = [(lat + 1.0, lon) for lat, lon in PLACES]
    rows = " ".join(f"{lon},{lat},{ABOVE_M}" for lat, lon in away)
    mode = "<altitudeMode>relativeToGround</altitudeMode>"
    text = f"<kml><Placemark><LineString>{mode}<coordinates>{rows}</coordinates></LineString></Placemark></kml>"
    with pytest.raises(UsageError, match=r"--terrain .*ridge\.tif: is too small"):
        route_flight(drawing_in(text.encode(), "x.kml"), terrain=RIDGE)
