"""Scenarios as a person gets them wrong: what is told, the one next step, and what holds for every message."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from gcs.cli.main import run
from gcs.errors import ScenarioError
from gcs.frames import Origin
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.sources.template import scenario_text

ORIGIN = (47.4, 8.55, 488.0)
START, END = "position_m = [0.0, 0.0, 15.0]", "position_m = [300.0, 0.0, 15.0]"
ZONE = "north_m = 150.0, east_m = 60.0, radius_m = 50.0"
CLEARANCE, SEPARATION, FLIGHT = "clearance_min_m = 5.0", "separation_min_m = 5.0", "flight_s = 90.0"
SPEED = f"{SEPARATION}\nspeed_ned_mps = "
TABLE = "[formation]"
DEGREES = re.compile(r"\w+_deg(?:\[\d+\])? (?:=|to) [\[\]\d., -]+|[Ww]rite \[[\d., -]+\]")  # need seven digits
POSITION, PLACE = "write position_deg", "[47.400245, 8.54935]"

Edits = tuple[tuple[str, str], ...]


def edit(*edits: tuple[str, str]) -> Edits:
    return edits


TAKEOFF, LANDING = (
    ("takeoff_s = 25.0", "takeoff_s = 5"),
    ("takeoff_s = 25.0", "takeoff_s = 25.0, landing_s = 5"),
)
SLIPS: list[tuple[Edits, str, str]] = [  # what is typed, what is told, what is next
    # Times and places that do not fit.
    (edit(TAKEOFF), "too short for 15.0 m", "set ground_phases.takeoff_s to 19"),
    (edit(LANDING), "too short for 15.0 m", "set ground_phases.landing_s to 19"),
    (edit((FLIGHT, "flight_s = 20.0")), "300 m north take at least 60.0 s", "set time.flight_s to 75"),
    (edit((END, "position_m = [400.123456, 0.0, 15.0]")), "= 400.123: puts", "to 360, or limits.north_m to [-60, 401]"),
    (edit((END, "position_m = [300.0, 0.0, 2.3456789]")), "2.65 m too low", "set end.position_m[2] to 5 or more"),
    (edit((ZONE, "north_m = 0.0, east_m = 0.0, radius_m = 50.0")), "contains vehicle 1", "apart by more than 50.0 m"),
    (edit(("spacing_m = 10.0", "spacing_m = 3.3333333")), "5 more pairs are too close", "spacing_m to 5 or more"),
    (edit((TABLE, f"[judge]\nseparation_min_m = 6\n{TABLE}")), "more than the plan keeps", "to 5 or less"),
    (edit((END, f"{END}, velocity_mps = [1, 0, 0]")), "every flight ends in a hover", "remove end.velocity_mps"),
    (edit((f"{START} ", f"{START}, velocity_mps = [2.0, 0, 0]")), "(not in this file): cannot", "run_up_m to 1.0"),
    (edit(("[-60.0, 360.0]", "[360.0, -60.0]")), "must be [low, high]", "exchange the two numbers"),
    (edit((END, "position_m = [300.0, 0.0]")), "has too few values", "change end.position_m"),
    # Degrees and heights of another kind.
    (edit((END, "position_m = [47.400245, 8.54935, 20]")), "look like degrees", f"{POSITION} = {PLACE}, height"),
    (edit((END, "position_m = [8.54935, 47.400245, 20]")), "latitude comes first", f"{POSITION} = {PLACE}, height"),
    (edit((ZONE, "north_m = 47.4012, east_m = 8.5511, radius_m = 50.0")), "look like degrees", "lat_deg = 47.4012 and"),
    (edit((ZONE, "polygon_m = [[47.401, 8.551], [47.402, 8.551], [47.402, 8.552]]")), "degrees", "polygon_deg"),
    (edit((END, "position_m = [474030000, 0.0, 15.0]")), "degrees times 10 million?", "474030000 would be 47.403"),
    (edit(("lat_deg = 47.4", "lat_deg = 474000000")), "degrees times 10 million?", "write lat_deg = 47.4"),
    (edit(("lat_deg = 47.4, lon_deg = 8.55", "lat_deg = 149.2, lon_deg = -35.4")), "swapped lat", "exchange lat_deg"),
    (edit((END, "position_m = [300.0, 0.0, -15.0]")), "is below the origin; heights are positive", "write 15 for 15 m"),
    (edit(("[0.0, 40.0]", "[-40.0, 0.0]")), "the flight is above; heights are positive", "write [0, 40]"),
    (edit(("[0.0, 40.0]", "[0.0, -40.0]")), "heights are positive upwards", "write [0, 40]"),
    (edit((END, "position_m = [300.0, 0.0, 503.0]")), "height above mean sea level", "write 15"),
    (edit((CLEARANCE, "clearance_min_m = -5.0")), "must be a number from 0", "write clearance_min_m = 5"),
    # Units after numbers, commas, other units.
    (edit((CLEARANCE, "clearance_min_m = 5 m")), "clearance_min_m = 5 m: has a unit", "write clearance_min_m = 5"),
    (edit((CLEARANCE, 'clearance_min_m = "5 m"')), "clearance_min_m = 5 m: has a unit", "write clearance_min_m = 5"),
    (edit(("radius_m = 50.0", "radius_m = 50.0m")), "radius_m = 50.0m: has a unit", "write radius_m = 50"),
    (edit((SEPARATION, "separation_min_m = 20 ft")), "is in ft; this key is in m", "write separation_min_m = 6.096"),
    (edit((CLEARANCE, "clearance_min_m = 0.002 mi")), "is in mi; this key is in m", "write clearance_min_m = 3.219"),
    (edit((CLEARANCE, "clearance_min_m = 0.002 nmi")), "is in nmi; this key is in m", "write clearance_min_m = 3.704"),
    (edit((SEPARATION, SPEED + "[18 km/h, 18 km/h, 6 km/h]")), "is in km/h; this key is in m/s", "write [5, 5, 1.667]"),
    (edit((FLIGHT, 'flight_s = "90s"')), "has a unit", "write flight_s = 90"),
    (edit((FLIGHT, "flight_s = 1:30")), "flight_s = 1:30: must be one number", "write flight_s = 90"),
    (edit((FLIGHT, 'flight_s = "1:30"')), "flight_s = 1:30: must be one number, in s", "write flight_s = 90"),
    (edit((FLIGHT, 'flight_s = "0:01:30"')), "must be one number, in s", "write flight_s = 90"),
    (edit((SEPARATION, SPEED + "[10 kn, 10 kn, 5 kn]")), "is in kn; this key is in m/s", "write [5.144, 5.144, 2.572]"),
    (edit(("lon_deg = 8.55", "lon_deg = \"-8:33:00\"")), "must be one number, in degrees", "write lon_deg = -8.55"),
    (edit((FLIGHT, "flight_min = 1.5")), "Skein has it as flight_s", "write flight_s = 90"),
    (edit((SEPARATION, "separation_min_m = 5,5")), "has a decimal comma", "write separation_min_m = 5.5"),
    (edit(("lat_deg = 47.4", "lat_deg = \"47°24'00\\\"N\"")), "one number, in degrees", "write lat_deg = 47.4"),
    (edit((END, "lat = 47.41, lon = 8.55, alt = 15")), "end.lat: unknown key; a place is", f"{POSITION} = [47.41, 8.5"),
    # One typo is one mistake.
    (edit(("clearance_min_m", "clearence_min_m")), "unknown key", "write clearance_min_m instead of clearence_min_m"),
    (edit(("[limits]", "[limit]")), "limit: unknown key", "write limits instead of limit"),
    (edit((TABLE, "[formations]")), "formations: unknown key", "write formation instead of formations"),
    (edit(("flight_s", "flight")), "time.flight: unknown key", "write flight_s instead of flight"),
    (edit(("lat_deg", "latitude")), "origin.latitude: unknown key", "write lat_deg instead of latitude"),
    (edit(("vehicle_type", "vehicletype")), "vehicletype: unknown key", "write vehicle_type instead of vehicletype"),
    (edit(('"quad500"', '"Quad500"')), "is neither a vehicle type nor a file", 'write vehicle_type = "quad500"'),
    (edit(("vehicle_type", "# vehicle_type")), "missing, and there is no table", 'add vehicle_type = "quad500"'),
    (edit(('generator = "vee"', 'generator = "lien"')), "must be one of", 'write generator = "line"'),
    (edit((TABLE, f'[mission]\nautopilot = "PX4"\n{TABLE}')), "must be one of", 'write autopilot = "px4"'),
    (edit(("start_shape = \"vee\"", "start_shape = vee")), "the text vee stands without quotes", 'write "vee"'),
    (edit(("count = 6", "count: 6")), "a colon stands after count", "write count = ..."),
    (edit(("count = 6", "counts = 7\ncount = 6")), "counts: unknown key; known ones are", "remove formation.counts;"),
    (edit(("[limits]", "[limits] x")), "not TOML: something stands after the value", "remove it"),
    (edit((FLIGHT, f"{FLIGHT}, free = False")), "False is not a value of TOML", "write false, in lower case"),
    (edit(("count = 6", "count = 6\ncount = 7")), "this key stands twice", "keep one of the two"),
    (edit((TABLE, f"[limits]\nx = 1\n{TABLE}")), "table [limits] stands twice", "keep one"),
    (edit(("[-120.0, 120.0]", "[-120.0, 120.0")), "a list is not closed", "give the missing ]"),
    (edit(("schema_version = 1", "")), "schema_version: missing", "add schema_version"),
]  # fmt: skip


def told(folder: Path, edits: Edits) -> ScenarioError:
    """The error of a new scenario with some passages replaced."""
    text = scenario_text(folder / "mine", Origin(*ORIGIN))
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new, 1)
    (folder / "scenario.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError) as caught:
        load_scenario(folder)
    return caught.value


@pytest.mark.parametrize(("edits", "says", "then"), SLIPS)
def test_one_slip_is_one_mistake_with_its_own_next_step(tmp_path: Path, edits: Edits, says: str, then: str) -> None:
    error = told(tmp_path, edits)
    assert "\n" not in error.message
    assert says in error.message
    assert then in error.hint
    keeps_the_rules(error)


def keeps_the_rules(error: ScenarioError) -> None:
    """What holds for every message to a person."""
    text = error.message.partition("scenario.toml")[2]  # the folder's name is not ours
    for line in (*text.splitlines(), error.hint):
        assert not re.search(r"\.\d{4}", DEGREES.sub("", line)), line
        assert "gcs schema" not in line or "unknown key" in error.message, line
        assert '\\"' not in line and "''" not in line, line
        assert not re.search(r"\b1 (?:more )?(?:pairs|vehicles|mistakes)\b", line), line
        assert "?." not in line and ".." not in line.replace("...", ""), line
    assert error.hint and "\n" not in error.hint
    assert error.hint[0].islower()


def test_the_value_that_is_proposed_works(tmp_path: Path) -> None:
    """Each next step that says `set KEY to VALUE`, typed as it is."""
    short = edit(TAKEOFF)
    value = told(tmp_path, short).hint.rpartition(" ")[2]
    file = tmp_path / "scenario.toml"
    file.write_text(file.read_text().replace("takeoff_s = 5", f"takeoff_s = {value}"))
    assert load_scenario(tmp_path).ground_phases.takeoff_s == float(value)


def test_all_mistakes_are_told_where_the_vehicle_type_is_wrong_too(tmp_path: Path) -> None:
    error = told(
        tmp_path,
        edit(
            ('"quad500"', '"quad50"'),
            (END, "position_m = [400.0, 0.0, 15.0]"),
            ("count = 6", "cuont = 6"),
        ),
    )
    lines = error.message.splitlines()
    assert lines[0].endswith("has 3 mistakes")
    assert 'vehicle_type = "quad50": is neither a vehicle type nor a file. Write vehicle_type = "quad500"' in lines[1]
    assert "end.position_m[0] = 400.0: puts vehicles 1, 2, 3, 4, 5, 6 outside the box, north" in lines[2]
    assert "formation.cuont: unknown key" in lines[3]
    assert error.hint.startswith('correct all 3; the first: write vehicle_type = "quad500"')
    keeps_the_rules(error)


def test_what_only_one_type_of_vehicle_breaks_is_not_told_of_another(tmp_path: Path) -> None:
    """A climb of 20 m takes one preset longer than the 20 s of the scenario, and the other not."""
    error = told(tmp_path, edit(('"quad500"', '"iris"'), ("15.0] }  ", "18.0] }  ")))
    assert "\n" not in error.message and "takeoff_s" not in error.message


def test_mistakes_of_a_vehicle_file_do_not_hide_those_of_the_scenario(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text("[vehicle]\nmass_kg = 2 kg\n")
    error = told(tmp_path, edit(('"quad500"', '"own.toml"'), (CLEARANCE, "clearance_min_m = 5 m")))
    assert "own.toml:2: vehicle.mass_kg = 2 kg: has a unit" in error.message
    assert "scenario.toml:18: limits.clearance_min_m = 5 m: has a unit" in error.message


def test_slips_of_the_text_do_not_hide_what_comes_after(tmp_path: Path) -> None:
    error = told(tmp_path, edit((CLEARANCE, "clearance_min_m = 5 m"), ("count = 6", "count: 0")))
    assert [line.partition("scenario.toml:")[2] for line in error.message.splitlines()[1:]] == [
        "18: limits.clearance_min_m = 5 m: has a unit; numbers stand alone, and the key's name ends in the unit. "
        "Write clearance_min_m = 5",
        "22: a colon stands after count. Write count = ...",
        "22: formation.count = 0: must be a whole number from 1 to 10000 (number of vehicles 1, 2, ... in start_shape; "
        "up to 254 can be flown)",
    ]


def test_a_mistake_in_a_mistyped_table_has_its_own_line(tmp_path: Path) -> None:
    error = told(tmp_path, edit(("[limits]", "[limit]"), (CLEARANCE, "clearance_min_m = -5.0")))
    assert "scenario.toml:18: limits.clearance_min_m = -5.0: must be a number from 0" in error.message


@pytest.mark.parametrize("centre", ["lat = 47.4, lon = 8.55", "center = [0.0, 0.0]"])
def test_a_disk_whose_centre_has_other_keys_is_still_checked_against_the_start(tmp_path: Path, centre: str) -> None:
    lines = told(tmp_path, edit((ZONE, f"{centre}, radius_m = 50.0"))).message.splitlines()
    assert [line.partition(": ")[2].partition(":")[0] for line in lines[1:]] == [
        f"no_fly[0].{centre.partition(' ')[0]}",
        "no_fly[0].radius_m = 50.0",
    ]
    assert "contains vehicle 1 at its start" in lines[2]


def test_metres_at_an_origin_of_zero_degrees_are_metres(tmp_path: Path) -> None:
    text = scenario_text(tmp_path / "mine", Origin(0.0, 0.0, 0.0))
    (tmp_path / "scenario.toml").write_text(text.replace(START, "position_m = [0.25, 0.25, 15.0]"))
    assert load_scenario(tmp_path).start.position_m[0] == 0.25


def test_a_start_in_degrees_is_no_flight_of_centimetres(tmp_path: Path) -> None:
    """Both ends, also where [origin] is still another place."""
    ends = edit((START, "position_m = [47.400245, 8.549350, 20.0]"), (END, "position_m = [47.400247, 8.549352, 20.0]"))
    for edits in (ends, (*ends, ("lat_deg = 47.4, lon_deg = 8.55", "lat_deg = -35.4, lon_deg = 149.2"))):
        lines = told(tmp_path, edits).message.splitlines()
        assert [line.partition(": ")[2].partition(" = ")[0] for line in lines[1:]] == [
            "start.position_m",
            "end.position_m",
        ]
        assert all("these look like degrees" in line for line in lines[1:])


def test_metres_near_the_numbers_of_the_origin_are_metres(tmp_path: Path) -> None:
    text = scenario_text(tmp_path / "mine", Origin(*ORIGIN)).replace(
        ZONE, "north_m = 47.0, east_m = 9.0, radius_m = 0.5"
    )
    (tmp_path / "scenario.toml").write_text(text.replace("[0.0, 0.0, 15.0]", "[-20.0, 8.5, 15.0]"))
    assert load_scenario(tmp_path).start.position_m[1] == 8.5


def test_rows_of_a_list_with_the_same_mistake_are_told_once(tmp_path: Path) -> None:
    error = told(tmp_path, edit((ZONE, "polygon_m = [[1.5, 2.5, 0], [1.5, 4.5, 0], [3.5, 4.5, 0]]")))
    assert "no_fly[0].polygon_m[0] = [1.5, 2.5, 0]: must be a list of 2" in error.message
    assert error.message.endswith(" (and 2 more in this list)") and error.hint == "change no_fly[0].polygon_m[0]"


def test_a_single_pair_is_one_pair(tmp_path: Path) -> None:
    three = edit(("count = 6", "count = 3"), ("spacing_m = 10.0", "spacing_m = 4.0"))
    assert "; 1 more pair is too close" in told(tmp_path, three).message


def test_speeds_in_kmh_are_asked_about(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = scenario_text(tmp_path / "mine", Origin(*ORIGIN)).replace(SEPARATION, SPEED + "[54, 54, 18]")
    (tmp_path / "scenario.toml").write_text(text)
    assert run(["show", str(tmp_path)]) == 0
    asked = "54 m/s are 194 km/h. Is it in km/h? Then write [15, 15, 5] instead of [54, 54, 18]"
    assert f"WARNING: limits.speed_ned_mps: {asked}" in capsys.readouterr().out
