"""Places in degrees as a person gets them wrong: one mistake, the keys of the file, and what to write instead."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gcs.cli.main import run
from gcs.errors import ScenarioError
from gcs.frames import Origin
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.sources.template import scenario_text
from tests.unit.scenario.validation.test_slips import END, ORIGIN, START, ZONE, Edits, edit, keeps_the_rules, told

BOX = "north_m = [-60.0, 360.0]      # [low, high], m\neast_m = [-120.0, 120.0]"
A, B, C = "[47.4012, 8.5504]", "[47.4018, 8.5504]", "[47.4018, 8.5515]"
SWAPPED = "[8.5504, 47.4012], [8.5504, 47.4018], [8.5515, 47.4018]"
TRIANGLE = f"polygon_deg = [{A}, {B}, {C}]"
VEHICLES = "vehicle = [{ sysid = 1, %s }, { sysid = 2, position_m = [0.0, 20.0, 15.0] }]"
FORMATION = 'count = 6                     # system ids 1 to 6\nstart_shape = "vee"\n'
GATE = '\n[[formation.change]]\nkind = "shrink"\nscale = 2.0\n'


def end(text: str) -> Edits:
    return edit((END, text))


def zone(text: str) -> Edits:
    return edit((ZONE, text))


def box(lat: str, lon: str) -> Edits:
    return edit((BOX, f"{lat}\n{lon}"))


HERE = "position_deg = [47.4027, 8.55]"
WRONG: list[tuple[Edits, str, str]] = [  # what is typed, what is told, what is next
    # Something else than latitude and longitude.
    (end("position_deg = [8.55, 47.4027], height_m = 15"), "5,654 km from the origin: swapped", f"write {HERE}"),
    (end("position_deg = [-47.4027, 8.55], height_m = 15"), "south and west are negative;", f"write {HERE}"),
    (end("position_deg = [-47.4027, -8.55], height_m = 15"), "is a sign wrong?", f"write {HERE}"),
    (end("position_deg = [47.4027, 368.55], height_m = 15"), "is this one counted to 360?", f"write {HERE}"),
    (end("position_deg = [474027000, 85500000], height_m = 15"), "times 10 million?", f"write {HERE}"),
    (end("position_deg = [8.55, 47.4027, 15]"), "from the origin: swapped", f"write {HERE}, height_m = 15"),
    (zone(f"polygon_deg = [{A}, {B}, [0, 0]]"), "polygon_deg[2] = [0, 0]: 5,319 km", "correct the place"),
    (end("position_deg = [300, 0], height_m = 15"), "no place on Earth: are these", "position_m = [300, 0, 15]"),
    (end("position_deg = [60, 10], alt_amsl_m = 500"), ": are these metres?", "position_m = [60, 10, height]"),
    (end("position_deg = [51.4027, 8.55], height_m = 15"), "445 km from the origin; places are", "or [origin]"),
    (end("position_deg = [47.4027], height_m = 15"), "has too few values", "change end.position_deg"),
    (end('position_deg = ["47°24\'09\\"N", 8.55], height_m = 9'), "one number, in degrees", "write [47.4025, 8.55]"),
    (end(f"{HERE}, height_m = 15 m"), "height_m = 15 m: has a unit", "write height_m = 15"),
    (end(f"{HERE}, height_ft = 50"), "Skein has it as height_m", "write height_m = 15.24"),
    (zone(f"polygon_deg = [{SWAPPED}]"), ": 5,654 km from the origin: swapped", f"write {TRIANGLE}"),
    (zone(f"polygon_deg = [{SWAPPED}, {SWAPPED}]"), "swapped latitude", "47.4018, 8.5515], [47.4012, 8.5504], ...]"),
    (zone(f"polygon_deg = [{A}, {B}, [8.5515, 47.4018]]"), "]]: 5,654 km from", f"write {TRIANGLE}"),
    (zone("polygon_deg = [[150, 60], [200, 60], [200, 90]]"), "are these metres?", "polygon_m = [[150, 60], [200,"),
    (zone(f"polygon_deg = [{A}, {B}, [51.40, 8.55]]"), "polygon_deg[2] = [51.4, 8.55]: 445 km", "or [origin]"),
    (zone("polygon_deg = [47.4012, 8.5504, 47.4018, 8.5515]"), "polygon_deg[0] = 47.4012: must be a list", "change"),
    (zone(TRIANGLE.replace("],", ", 0],").replace("]]", ", 0]]")), "a list of 2: a number from -90", "polygon_deg[0]"),
    (zone("lat_deg = 8.5508, lon_deg = 47.4013, radius_m = 50"), "swapped latitude", "lat_deg = 47.4013 and lon_deg ="),
    (zone("lat_deg = 150, lon_deg = 60, radius_m = 50"), "are these metres?", "write north_m = 150 and east_m = 60"),
    (box("lat_deg = [-60, 360]", "lon_deg = [-120, 120]"), "are these metres?", "write north_m = [-60, 360] and"),
    (box("lat_deg = [47.4, 47.3]", "lon_deg = [8.54, 8.56]"), "lat_deg = [47.4, 47.3]: must", "exchange the two"),
    (box("lat_deg = [47.3, 47.5]", "lon_deg = [8.56, 8.54]"), "lon_deg = [8.56, 8.54]: must", "exchange the two"),
    (box("north_m = [47.3, 47.5]", "east_m = [8.54, 8.56]"), "look like degrees", "lat_deg = [47.3, 47.5] and lon_deg"),
    # Both forms, or not the whole of one.
    (end(f"{END}, {HERE}, height_m = 15"), "stands beside position_m", "keep one of the two"),
    (end(f"{END}, height_m = 15"), "stands beside position_m; a place is in metres or", "keep one of the two"),
    (end(f"{HERE}, height_m = 15, alt_amsl_m = 503"), "both are the height", "keep one of the two"),
    (end(HERE), "end.height_m: missing", "add height_m"),
    (edit((f"{{ {END} }}", "{}")), "end.position_m: missing; give position_m or", "add end.position_m = ["),
    (end("height_m = 15"), "end.position_deg: missing", "add position_deg = [latitude, longitude]"),
    (end("position_deg = [47.4027, 8.55, 15]"), "has three numbers", f"write {HERE}, height_m = 15"),
    (zone(f"{TRIANGLE}, polygon_m = [[1, 2], [3, 4], [5, 1]]"), "stands beside polygon_m", "keep one of the two"),
    (zone(f"{TRIANGLE}, radius_m = 50"), "]]: stands beside radius_m", "keep the polygon or the disk"),
    (zone("lat_deg = 47.4013, radius_m = 50"), "no_fly[0].lon_deg: missing", "add lon_deg"),
    (zone("lat_deg = 47.4013, east_m = 60, radius_m = 50"), "lat_deg = 47.4013: stands beside east_m", "keep one"),
    (zone("lat_deg = 47.4013, lon_deg = 8.5508"), "a disk needs north_m, east_m (or lat_deg, lon_deg) and", "give it"),
    # Keys that people expect.
    (end("position = [47.4027, 8.55], height_m = 15"), "end.position: unknown key; a place is", f"write {HERE}"),
    (end("latitude = 47.4027, longitude = 8.55, height = 15"), "or position_deg with", f"write {HERE}, height_m = 15"),
    (zone(TRIANGLE.replace("_deg", "")), "nearest known one is polygon_deg", "write polygon_deg instead of polygon"),
    (zone("center = [47.4013, 8.5508], radius_m = 50"), "no_fly[0].center: unknown", "lat_deg = 47.4013 and lon_deg"),
    (zone("centre = [150, 60], radius_m = 50"), "no_fly[0].centre: unknown", "north_m = 150 and east_m = 60"),
    (end("gps = [47.4027, 8.55, 15]"), "end.gps: unknown key; a place", f"write {HERE}, height_m = 15"),
    (end(f"{HERE}, altitude = 15"), "(with position_deg: height, m above", "write height_m instead of"),
    (zone(f"{TRIANGLE}, moves_deg = [[0, 47.4, 8.55]]"), "moves (displacement over", "moves instead of moves_deg"),
    (zone(f"{TRIANGLE}, moves = [[0, 47.4, 8.5504]]"), "look like degrees; moves are displacements", "moves = [["),
    # Places that are where they should not be: the keys of the file, and degrees to write.
    (end(f"{HERE}, height_m = 2"), "end.height_m = 2: vehicle 1 would be 3.00 m too low", "set end.height_m to 5 or"),
    (end(f"{HERE}, height_m = 503"), "height_m = 503: looks like a height above mean sea", "write 15"),
    (end(f"{HERE}, alt_amsl_m = 15"), "is -473 m above the origin", "write height_m = 15"),
    (end("position_deg = [47.4034, 8.55], height_m = 15"), "[47.4034, 8.55]: puts", "end.position_deg to [47.403237"),
    (box("lat_deg = [47.399, 47.402]", "lon_deg = [8.54, 8.56]"), "the box, north -1", "limits.lat_deg to [47.3"),
    (zone("lat_deg = 47.4, lon_deg = 8.55, radius_m = 50"), "contains vehicle 1", "move the zone"),
    (zone(f"polygon_deg = [{A}, {C}, {B}, [47.4012, 8.5515]]"), "polygon_deg = [[47.4", "give the corners in order"),
    (edit((FORMATION, VEHICLES % "position_deg = [47.4001, 8.55], height_m = 15" + "\n")), "differs from [11", "equal"),
]  # fmt: skip


@pytest.mark.parametrize(("edits", "says", "then"), WRONG)
def test_one_wrong_place_is_one_mistake_with_its_own_next_step(
    tmp_path: Path, edits: Edits, says: str, then: str
) -> None:
    error = told(tmp_path, edits)
    assert "\n" not in error.message
    assert says in error.message
    assert then in error.hint
    assert "scenario.toml:" in error.message and "not in this file" not in error.message
    keeps_the_rules(error)


def test_a_box_whose_sides_are_single_numbers_is_told(tmp_path: Path) -> None:
    error = told(tmp_path, box("lat_deg = 47.4", "lon_deg = 8.55"))
    for key, number in (("lat_deg", "47.4"), ("lon_deg", "8.55")):
        assert f"limits.{key} = {number}: must be a list of 2" in error.message


def test_several_wrong_places_are_told_at_once_each_with_its_key_and_line(tmp_path: Path) -> None:
    error = told(
        tmp_path,
        edit(
            (START, "position_deg = [8.55, 47.4], height_m = 15"),
            (END, HERE),
            (ZONE, f"polygon_deg = [{SWAPPED}]"),
            (BOX, "lat_deg = [47.4034, 47.3994]\nlon_deg = [8.5482, 8.5518]"),
        ),
    )
    lines = error.message.splitlines()
    assert lines[0].endswith("has 4 mistakes")
    assert [
        line.partition("scenario.toml:")[2].partition(" = ")[0].partition(": missing")[0] for line in lines[1:]
    ] == [
        "9: start.position_deg",
        "10: end.height_m",
        "12: no_fly[0].polygon_deg",
        "15: limits.lat_deg",
    ]
    keeps_the_rules(error)


def test_places_are_not_asked_about_where_the_origin_itself_is_wrong(tmp_path: Path) -> None:
    error = told(tmp_path, edit(("lat_deg = 47.4", "lat_deg = 474"), (END, f"{HERE}, height_m = 15")))
    assert "\n" not in error.message and "origin.lat_deg = 474: must be a number from -85 to 85" in error.message


@pytest.mark.parametrize(
    ("edits", "says"),
    [
        ((END, "position_deg = [47.4034, 8.55], height_m = 15"), "set end.position_deg to "),
        ((BOX, "lat_deg = [47.399, 47.402]\nlon_deg = [8.54, 8.56]"), "or limits.lat_deg to "),
    ],
)
def test_the_degrees_that_are_proposed_work(tmp_path: Path, edits: tuple[str, str], says: str) -> None:
    hint = told(tmp_path, edit(edits)).hint
    proposed = hint.partition(says)[2].partition("]")[0] + "]"
    key = says.split(".")[1].split(" ", maxsplit=1)[0]
    file = tmp_path / "scenario.toml"
    lines = file.read_text().splitlines()
    old = edits[1].partition(f"{key} = ")[2].partition("]")[0] + "]"
    file.write_text("\n".join(line.replace(f"{key} = {old}", f"{key} = {proposed}") for line in lines))
    load_scenario(tmp_path)


def test_a_place_that_was_converted_is_not_taken_for_degrees(tmp_path: Path) -> None:
    """A zone 47.4 m north and 8.6 m east of an origin at 47.4 degrees north and 8.55 degrees east."""
    lat_deg, lon_deg = 47.4 + 47.4123 / 111_190, 8.55 + 8.6123 / 75_400
    (tmp_path / "scenario.toml").write_text(
        scenario_text(tmp_path / "mine", Origin(*ORIGIN)).replace(
            ZONE, f"lat_deg = {lat_deg}, lon_deg = {lon_deg}, radius_m = 0.5"
        )
    )
    zone = load_scenario(tmp_path).no_fly[0]
    assert zone.north_m == pytest.approx(47.4, abs=0.1) and zone.east_m == pytest.approx(8.6, abs=0.1)


def test_a_leader_in_degrees_starts_where_the_start_in_metres_is(tmp_path: Path) -> None:
    text = scenario_text(tmp_path / "mine", Origin(*ORIGIN))
    text = text.replace(FORMATION, VEHICLES % "position_deg = [47.4, 8.55], height_m = 15" + "\n")
    (tmp_path / "scenario.toml").write_text(text.replace("shape = [", "# shape = ["))
    assert load_scenario(tmp_path).formation.vehicle[0].position_m == (0.0, 0.0, 15.0)


def test_gates_and_summits_have_degrees_of_their_own(tmp_path: Path) -> None:
    file, text = tmp_path / "scenario.toml", scenario_text(tmp_path / "mine", Origin(*ORIGIN))
    summits = (
        "\n[terrain.mountains]\nlat_deg = [47.4, 47.401]\nlon_deg = [8.54]\nheight_m = [1, 1]\n"
        "spread_north_m = [9, 9]\nspread_east_m = [9, 9]\n"
    )
    gate = f"{GATE}gate_deg = [[8.549, 47.401], [8.551, 47.401]]\n"
    file.write_text(text + gate + summits)
    with pytest.raises(ScenarioError) as caught:
        load_scenario(file)
    lines = caught.value.message.splitlines()
    assert len(lines) == 3
    assert "gate_deg = [[8.549, 47.401], [8.551, 47.401]]: 5,654 km" in lines[1] and "swapped" in lines[1]
    assert (
        "terrain.mountains: lists must be equally long" in lines[2]
        and "lat_deg 2, east_m or lon_deg 1, height_m 2" in lines[2]
    )
    file.write_text(
        text
        + gate.replace("[[8.549, 47.401], [8.551, 47.401]]", "[[47.401, 8.549], [47.401, 8.551]]")
        + summits.replace("[8.54]", "[8.54, 8.541]")
    )
    scenario = load_scenario(file)
    assert scenario.formation.change[0].gate_m is not None
    assert scenario.formation.change[0].gate_m[0] == pytest.approx((111.19, -75.48), abs=0.1)
    assert scenario.terrain.mountains.north_m == pytest.approx((0.0, 111.2), abs=0.1)


def test_the_example_of_the_documents_is_a_flight(
    tmp_path: Path, repo_root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (repo_root / "docs" / "scenario.md").read_text(encoding="utf-8")
    (tmp_path / "scenario.toml").write_text(page.partition("<<'END'\n")[2].partition("END\n")[0], encoding="utf-8")
    assert run(["show", str(tmp_path), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert (shown["start"]["lat_deg"], shown["start"]["lon_deg"], shown["start"]["height_m"]) == (47.4, 8.55, 15.0)
    assert (shown["end"]["lat_deg"], shown["end"]["lon_deg"], shown["end"]["alt_amsl_m"]) == (47.4025, 8.5508, 503.0)
    assert shown["end"]["north_m"] == pytest.approx(277.97, abs=0.05)
