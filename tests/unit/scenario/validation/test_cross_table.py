"""What tables must agree on: each rule is broken alone, and told with the key to change."""

from __future__ import annotations

import copy
import tomllib
from pathlib import Path
from typing import Any

import pytest

from gcs.scenario.schema.mistake import dotted
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.validation import (
    boundaries,
    cross_table,
    formation_rules,
    route_rules,
    unit_guesses,
    vehicle_rules,
    zone_rules,
)
from gcs.scenario.validation.cross_table import check
from tests.unit.scenario.variants import violated, with_tables


@pytest.fixture
def data(repo_root: Path) -> dict[str, Any]:
    text = (repo_root / "missions" / "simulation1" / "scenario.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def test_simulation1_is_clean(simulation1: Scenario) -> None:
    assert check(simulation1) == []


@pytest.mark.parametrize(
    ("path", "value", "key", "says"),
    [
        (("start", "position_m"), [2.5, 1.0, 3.0], "start.position_m", "vehicle 1"),
        (("limits", "north_m"), [0.5, 1500.0], "formation.vehicle[1].position_m[0]", "vehicles 2, 3, 5 are outside"),
        (("limits", "east_m"), [0.0, 1000.5], "end.position_m[1]", "vehicle 3 would be at 1001"),
        (("limits", "height_m"), [0.0, 2.9], "start.position_m[2]", "outside the box, height 0 to 2.9 m"),
        (("limits", "clearance_min_m"), 0.9, "end.position_m[2]", "limits.clearance_min_m requires 0.9 m"),
        (("limits", "separation_min_m"), 0.6, "formation.vehicle[4].position_m", "vehicles 2 and 5 are 0.50 m apart"),
        (
            ("formation", "vehicle", 4, "position_m"),
            [0.0, 0.0, 4.0],
            "formation.vehicle[4].position_m",
            "take off 0.00",
        ),
        (("no_fly",), [{"north_m": 1202.5, "east_m": 1001.0, "radius_m": 3.0}], "no_fly[0].radius_m", "vehicle 1"),
    ],
)
def test_one_rule_broken(data: dict[str, Any], path: tuple[Any, ...], value: Any, key: str, says: str) -> None:
    mistakes = check(Scenario.model_validate(_changed(data, path, value)))
    found = {dotted(mistake.key): str(mistake) for mistake in mistakes}
    assert key in found
    assert says in found[key]


ZONE = {"north_m": 600.0, "east_m": 100.0, "radius_m": 3.0}
LATEST = {"free": True, "latest_s": 300.0}
MIDDLE = {"position_m": [600.0, 500.0, 20.0]}


def change(**when: Any) -> dict[str, Any]:
    return {"change": [{"kind": "reshape", "to": "start", **when}]}


@pytest.mark.parametrize(
    ("tables", "told"),
    [
        ({"judge": {"separation_min_m": 0.4}}, ""),
        (
            {"judge": {"separation_min_m": 0.41}},
            "judge.separation_min_m = 0.41: more than the plan keeps, limits.separation_min_m = 0.4. Set "
            "judge.separation_min_m to 0.4 or less",
        ),
        ({"start": {"velocity_mps": [5.0, -5.0, 2.0]}}, ""),
        (
            {"start": {"velocity_mps": [5.1, -5.1, -2.1]}, "ground_phases": {"run_up_m": 60.0}},
            "start.velocity_mps[0] = 5.1: too fast north; limits.speed_ned_mps[0] allows -5 to 5 m/s\n"
            "start.velocity_mps[1] = -5.1: too fast east; limits.speed_ned_mps[1] allows -5 to 5 m/s\n"
            "start.velocity_mps[2] = -2.1: too fast up; limits.speed_ned_mps[2] allows -2 to 2 m/s",
        ),
        (
            {"end": {"velocity_mps": [0.0, 0.0, -2.1]}},
            "end.velocity_mps[2] = -2.1: too fast up; limits.speed_ned_mps[2] allows -2 to 2 m/s\n"
            "end.velocity_mps = [0.0, 0.0, -2.1]: must be [0, 0, 0]: every flight ends in a hover, from which it "
            "lands. Remove end.velocity_mps",
        ),
        (
            {"start": {"roll_pitch_yaw_deg": [180.0, -60.0, 60.0]}, "end": {"roll_pitch_yaw_deg": [0.0, 60.1, -60.1]}},
            "end.roll_pitch_yaw_deg[1] = 60.1: too much pitch; limits.roll_pitch_yaw_deg[1] allows -60 to 60 "
            "degrees\n"
            "end.roll_pitch_yaw_deg[2] = -60.1: too much yaw; limits.roll_pitch_yaw_deg[2] allows -60 to 60 "
            "degrees",
        ),
        (
            {"start": {"roll_pitch_yaw_deg": [-9.1, 0.0, 0.0]}, "limits": {"roll_pitch_yaw_deg": [9.0, 60.0, 60.0]}},
            "start.roll_pitch_yaw_deg[0] = -9.1: too much roll; limits.roll_pitch_yaw_deg[0] allows -9 to 9 degrees",
        ),
        ({"objective": {"heading_ref_deg": -60.0}}, ""),
        (
            {"objective": {"heading_ref_deg": -60.5}},
            "objective.heading_ref_deg = -60.5: out of reach; limits.roll_pitch_yaw_deg[2] allows a yaw of -60 to "
            "60 degrees",
        ),
        ({"objective": {"heading_ref_deg": None}}, ""),
        (
            {"time": {"free": True}},
            "time.free = true: needs a cost of time, or the slowest flight is the best. Give [objective] "
            "time_weight, or a latest_s here",
        ),
        ({"time": {"free": True}, "objective": {"time_weight": 1.0}}, ""),
        ({"time": LATEST, "objective": {"time_weight": 1.0}}, ""),
        ({"time": LATEST}, ""),
        (
            {"time": LATEST, "formation": change(at_s=3.0)},
            "time.free = true: the planner cannot choose the time while changes have fixed times. Set auto = true "
            "in each",
        ),
        ({"time": LATEST, "formation": change(auto=True)}, ""),
        ({"time": LATEST, "formation": change(at_point=1), "route": [MIDDLE]}, ""),
        ({"time": LATEST, "no_fly": [ZONE]}, ""),
        (
            {"time": LATEST, "no_fly": [{**ZONE, "moves": [[0.0, 0.0, 0.0], [10.0, 50.0, 0.0]]}]},
            "time.free = true: the planner cannot choose the time while no-fly zones move. Remove their moves",
        ),
        ({"no_fly": [{**ZONE, "moves": [[0.0, 0.0, 0.0], [10.0, 50.0, 0.0]]}]}, ""),
        (
            {"ground_phases": {"run_up_m": 0.0}},
            "ground_phases.run_up_m = 0.0: cannot bring a vehicle from rest to 2.83 m/s in run_up_s = 20 s; it "
            "must lie between 0 and 56.6. Set ground_phases.run_up_m to 28.3",
        ),
        ({"ground_phases": {"run_up_m": 56.56}}, ""),
        (
            {"ground_phases": {"run_up_m": 56.6}, "limits": {"accel_max_mps2": 0.07}},
            "ground_phases.run_up_m = 56.6: cannot bring a vehicle from rest to 2.83 m/s in run_up_s = 20 s; it "
            "must lie between 0 and 56.6. Set ground_phases.run_up_m to 28.3",
        ),
        ({"start": {"velocity_mps": [0.0, 0.0, 1.0]}, "ground_phases": {"run_up_m": 0.0}}, ""),
        ({"limits": {"accel_max_mps2": 0.159}}, ""),
        (
            {"limits": {"accel_max_mps2": 0.063}, "ground_phases": {"run_up_m": 28.3}},
            "limits.accel_max_mps2 = 0.063: too little to cover 1560 m in time.flight_s, which takes at least "
            "0.064 m/s². Set limits.accel_max_mps2 to 0.064 or more\n"
            "limits.accel_max_mps2 = 0.063: too little for a run-up of 28.3 m in 20 s, which takes at least 0.142 "
            "m/s². Set limits.accel_max_mps2 to 0.142 or more",
        ),
        (
            {"time": {"flight_s": 239.0}, "limits": {"accel_max_mps2": 0.05}, "ground_phases": {"run_up_m": 28.3}},
            "limits.accel_max_mps2 = 0.05: too little for a run-up of 28.3 m in 20 s, which takes at least 0.142 "
            "m/s². Set limits.accel_max_mps2 to 0.142 or more",
        ),
    ],
)
def test_what_two_tables_disagree_about_is_told_with_both_values(
    data: dict[str, Any], tables: dict[str, Any], told: str
) -> None:
    """The leader flies 1198 m north and 999 m east at 5 m/s at most; its run-up of 20 s ends at 2.83 m/s."""
    assert "\n".join(violated(cross_table.RULES, with_tables(data, **tables))) == told


@pytest.mark.parametrize(
    ("tables", "told"),
    [
        ({"time": {"flight_s": 239.6}}, ""),
        (
            {"time": {"flight_s": 239.5}},
            "time.flight_s = 239.5: too short: 1198 m north take at least 239.6 s at limits.speed_ned_mps[0] = 5 "
            "m/s. Set time.flight_s to 300 or more",
        ),
        (
            {"end": {"position_m": [2.0, 1.0, 33.0]}, "time": {"flight_s": 14.9}},
            "time.flight_s = 14.9: too short: 30 m vertical take at least 15.0 s at limits.speed_ned_mps[2] = 2 "
            "m/s. Set time.flight_s to 19 or more",
        ),
        (
            {"end": {"position_m": [2.0, 1000.0, 3.0]}, "time": {"flight_s": 199.7}},
            "time.flight_s = 199.7: too short: 999 m east take at least 199.8 s at limits.speed_ned_mps[1] = 5 "
            "m/s. Set time.flight_s to 250 or more",
        ),
        (
            {"time": {"free": True, "latest_s": 239.0}},
            "time.latest_s = 239.0: too short: 1198 m north take at least 239.6 s at limits.speed_ned_mps[0] = 5 "
            "m/s. Set time.latest_s to 300 or more",
        ),
    ],
)
def test_a_flight_that_is_too_short_is_told_with_the_way_and_the_speed(
    data: dict[str, Any], tables: dict[str, Any], told: str
) -> None:
    assert "\n".join(violated(route_rules.RULES, with_tables(data, **tables))) == told


SQUARE = [[0.0, 0.0, 0.0], [0.0, 4.0, 0.0], [4.0, 0.0, 0.0], [4.0, 4.0, 0.0], [8.0, 0.0, 0.0], [8.0, 4.0, 0.0]]


def ending_in_a_square(data: dict[str, Any], east_m: list[float], no_fly: list[dict[str, float]]) -> list[str]:
    formation = data["formation"] | {
        "shape": [{"name": "square", "offsets_m": SQUARE}],
        "change": [{"kind": "reshape", "to": "square", "at_s": 60.0}],
    }
    changed = data | {"formation": formation, "limits": data["limits"] | {"east_m": east_m}, "no_fly": no_fly}
    found = check(Scenario.model_validate(changed))
    return [str(one) for one in found if "last shape" in str(one)]


def test_a_last_shape_beyond_the_box_is_seen_before_anything_is_planned(data: dict[str, Any]) -> None:
    north_m, east_m = data["end"]["position_m"][:2]
    low = data["limits"]["east_m"][0]
    assert ending_in_a_square(data, [low, east_m + 4.0], []) == []
    (told,) = ending_in_a_square(data, [low, east_m + 3.0], [])
    assert "puts 3 places of the last shape, square, outside the box, east 0 to 1003 m" in told
    zone = {"north_m": north_m + 8.0, "east_m": east_m + 4.0, "radius_m": 1.0}
    (told,) = ending_in_a_square(data, [low, east_m + 4.0], [zone])
    assert "contains 1 place of the last shape, square, at the end, 1.00 m inside" in told


def test_rules_look_at_no_table_but_those_they_need(data: dict[str, Any]) -> None:
    """A file with a mistake in one table has no such table. Mistakes of many kinds make many rules look closely."""
    square = {"kind": "reshape", "to": "square", "at_s": 60.0}
    formation = data["formation"] | {
        "shape": [{"name": "square", "offsets_m": SQUARE}],
        "change": [square, square | {"to": "start", "at_s": 160.0}],
    }
    low, east_m = data["limits"]["east_m"][0], data["end"]["position_m"][1]
    narrow = data["limits"] | {"east_m": [low, east_m + 0.5]}
    zone = {"north_m": 1202.5, "east_m": 1001.0, "radius_m": 3.0}
    broken = data | {"formation": formation, "limits": narrow, "no_fly": [zone]}
    for one in (data, broken):
        scenario = Scenario.model_validate(one)
        for rules in (
            unit_guesses.RULES,
            cross_table.RULES,
            vehicle_rules.RULES,
            boundaries.RULES,
            zone_rules.RULES,
            route_rules.RULES,
            formation_rules.RULES,
        ):
            for needed, rule in rules._rules:
                list(rule(Scenario.model_construct(**{table: getattr(scenario, table) for table in needed})))


def test_a_mountain_in_the_run_up_is_seen(data: dict[str, Any]) -> None:
    for name, value in (("north_m", -8.0), ("east_m", -9.0), ("height_m", 6.0), ("spread_north_m", 3.0)):
        data["terrain"]["mountains"][name].append(value)
    data["terrain"]["mountains"]["spread_east_m"].append(3.0)
    mistakes = check(Scenario.model_validate(data))
    assert [dotted(mistake.key) for mistake in mistakes] == ["ground_phases.run_up_m"]


def test_a_mountain_under_the_end_is_seen(data: dict[str, Any]) -> None:
    data["terrain"]["mountains"]["north_m"][0] = 1200.0
    data["terrain"]["mountains"]["east_m"][0] = 1000.0
    mistakes = check(Scenario.model_validate(data))
    assert {dotted(mistake.key) for mistake in mistakes} >= {"end.position_m[2]"}


def test_rules_wait_for_the_tables_they_need(data: dict[str, Any]) -> None:
    scenario = Scenario.model_validate(_changed(data, ("judge", "separation_min_m"), 0.5))
    assert check(scenario, ("judge", "start", "end")) == []
    assert len(check(scenario, ("judge", "limits"))) == 1


def _changed(data: dict[str, Any], path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    changed = copy.deepcopy(data)
    node: Any = changed
    for part in path[:-1]:
        node = node[part]
    node[path[-1]] = value
    return changed


def test_a_climb_that_jerks_more_than_allowed_is_too_short(data: dict[str, Any]) -> None:
    """A quintic over d in T has a jerk of 60 d / T³ at its ends."""
    data["limits"]["jerk_max_mps3"] = 0.02
    (takeoff,) = (m for m in check(Scenario.model_validate(data)) if m.key[-1] == "takeoff_s")
    assert "0.02 m/s³ (limits.jerk_max_mps3)" in takeoff.text
    data["ground_phases"]["takeoff_s"] = float(takeoff.remedy.split()[-1])
    assert not [m for m in check(Scenario.model_validate(data)) if m.key[-1] == "takeoff_s"]
