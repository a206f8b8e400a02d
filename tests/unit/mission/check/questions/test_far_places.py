"""Missions with exchanged or unsigned numbers, and with km/h and feet: `gcs check` asks what they are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from gcs.cli.main import run
from gcs.mission.check.findings import Rule
from gcs.mission.check.fleet_check import check_fleet
from gcs.mission.check.flight_limits import FlightLimits
from gcs.mission.check.item_checks import check_items
from tests.unit.mission.fleets import FLAT, at, mission, out_and_land, speed

SWAPPED = """QGC WPL 110
0	1	0	16	0	0	0	0	47.4	8.55	488	1
1	0	3	22	0	0	0	0	47.4	8.55	20	1
2	0	3	16	0	0	0	0	47.401	8.55	20	1
3	0	3	16	0	0	0	0	8.552	47.402	20	1
4	0	3	21	0	0	0	0	47.401	8.55	0	1
"""


def test_a_leg_of_thousands_of_kilometres_is_a_question(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "a.waypoints"
    file.write_text(SWAPPED)
    assert run(["check", str(file), "--autopilot", "ardupilot"]) == 11
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == (
        f"{file}:5: error [place] item 3: swapped latitude and longitude? "
        "It is 5,659 km from the item before it; the check leaves it out"
    )
    assert lines[-1] == "1 finding"  # none about a flight of days, or about millions of metres below the start


@pytest.mark.parametrize(
    ("turn", "asks"),
    [
        (lambda lat, lon: (lon, lat), "swapped latitude and longitude? It is "),
        (lambda lat, lon: (-lat, lon), "has the latitude lost its sign? It is "),
        (lambda lat, lon: (lat, -lon), "has the longitude lost its sign? It is "),
        (lambda lat, lon: (lat // 2, lon), "this place is "),
    ],
)
def test_what_happened_to_the_numbers(turn, asks: str) -> None:  # type: ignore[no-untyped-def]
    up, change, out, land = out_and_land(50.0)
    lat, lon = turn(out.lat_degE7, out.lon_degE7)
    wrong = mission((up, change, replace(out, lat_degE7=lat, lon_degE7=lon), land))
    report = check_fleet([wrong], FLAT, FlightLimits())
    assert [(found.rule, found.item) for found in report.findings] == [(Rule.PLACE, 3)]
    assert report.findings[0].message.startswith(asks)
    assert report.duration_s < 100.0


def test_a_flight_of_kilometres_is_no_question() -> None:
    report = check_fleet([mission(out_and_land(20_000.0))], FLAT, FlightLimits())
    assert Rule.PLACE not in {found.rule for found in report.findings}


def test_a_speed_in_kmh_and_a_height_in_feet_are_asked_about() -> None:
    found = check_items(mission((*out_and_land(50.0)[:1], speed(54.0), *out_and_land(50.0)[2:])))
    assert [one.message.partition("most ")[2] for one in found] == ["20 m/s. Is it in km/h? 54 km/h are 15.0 m/s"]
    high = mission((at(22, 0, 0, 120), at(16, 50, 0, 120), at(21, 50, 0, 0)))
    told = [one.message for one in check_fleet([high], FLAT, FlightLimits(height_max_m=40.0)).findings]
    assert told == ["80.00 m above the ceiling of 40 m. Is it in feet? 120 ft are 36.6 m"]
