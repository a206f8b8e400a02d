"""Both ends of a flight against box, ground, pads and time: each rule is broken alone, and told in full.

Three vehicles over flat ground, in a box of 100 m to every side and 40 m high: 1 leads, 2 is 5 m south of it, 3 is 5 m
east and 2 m higher. All fly 50 m north. 5.2 N are 0.6 m/s² more than the weight of 0.5 kg.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from gcs.scenario.validation.boundaries import RULES
from tests.unit.scenario.variants import Data, counted, violated, with_tables

LEADER, SOUTH, EAST = [0.0, 0.0, 10.0], [-5.0, 0.0, 10.0], [0.0, 5.0, 12.0]
STILL, NORTH = [0.0, 0.0, 0.0], [2.0, 0.0, 0.0]
ROW = {"shape": [{"name": "row", "offsets_m": [[0.0, 0.0, 0.0], [8.0, 0.0, 0.0], [16.0, 0.0, -3.0]]}]}
GATE_M = [[20.0, -9.0], [20.0, 9.0]]
RUN_UP = {"run_up_m": 40.6, "run_up_s": 30.0}


def fleet(*places: list[float], **formation: Any) -> Data:
    """Vehicles 1, 2, 3 at these places, and changes."""
    return {"vehicle": [{"sysid": n, "position_m": place} for n, place in enumerate(places, start=1)], **formation}


def to(shape: str, **when: Any) -> Data:
    return {"kind": "reshape", "to": shape, **(when or {"at_s": 50.0})}


def ending(*changes: Data, **formation: Any) -> Data:
    return fleet(LEADER, SOUTH, EAST, **ROW, change=list(changes), **formation)


def hill(north_m: float) -> Data:
    """A hill of 9 m, whose height falls to a third in 5 m."""
    sizes = {"east_m": 0.0, "height_m": 9.0, "spread_north_m": 5.0, "spread_east_m": 5.0}
    return {"mountains": {"north_m": [north_m], **{key: [size] for key, size in sizes.items()}}}


def limits(**changed: Any) -> Data:
    """Tables with these limits."""
    return {"limits": changed}


def end(north_m: float, up_m: float = 10.0) -> Data:
    return {"position_m": [north_m, 0.0, up_m]}


YARD = {
    "time": {"flight_s": 100.0},
    "start": {"position_m": LEADER, "velocity_mps": STILL},
    "end": end(50.0),
    "formation": fleet(LEADER, SOUTH, EAST),
    "ground_phases": {"run_up_m": 0.0, "takeoff_s": 30.0, "landing_s": 30.0},
    "limits": {
        **{"north_m": [-100.0, 100.0], "east_m": [-100.0, 100.0], "height_m": [0.0, 40.0]},
        **{"clearance_min_m": 2.0, "separation_min_m": 3.0},
    },
}


@pytest.fixture(scope="module")
def data(repo_root: Path) -> Data:
    paper = tomllib.loads((repo_root / "missions" / "simulation1" / "scenario.toml").read_text(encoding="utf-8"))
    return with_tables({**paper, "terrain": {}}, **YARD)


@pytest.mark.parametrize(
    ("tables", "told"),
    [
        ({}, ""),
        ({"start": {"position_m": [0.0, 0.0, 10.009]}}, ""),  # a place in degrees is known to a centimetre
        (
            {"start": {"position_m": [0.0, 0.0, 10.02]}},
            "start.position_m = [0.0, 0.0, 10.02]: differs from [0, 0, 10], the position of the leader, vehicle 1."
            " Make them equal: move [start] back, or every vehicle by 0.02 m up",
        ),
        (
            {"start": {"position_m": [1.5, -2.0, 10.0]}},
            "start.position_m = [1.5, -2.0, 10.0]: differs from [0, 0, 10], the position of the leader, vehicle 1."
            " Make them equal: move [start] back, or every vehicle by 1.5 m north, 2 m west",
        ),
        (
            {"start": {"position_m": [1.5, -2.0, 10.0]}, "formation": fleet(LEADER)},
            "start.position_m = [1.5, -2.0, 10.0]: differs from [0, 0, 10], the position of the leader, vehicle 1."
            " Make them equal",
        ),
        (
            {"start": {"position_m": [0.0, 0.5, 10.0]}, "formation": fleet(LEADER, SOUTH)},
            "start.position_m = [0.0, 0.5, 10.0]: differs from [0, 0, 10], the position of the leader, vehicle 1. "
            "Make them equal: move [start] back, or every vehicle by 0.5 m east",
        ),
        (limits(north_m=[-5.0, 50.0]), ""),
        (
            limits(north_m=[-4.9, 100.0]),
            "formation.vehicle[1].position_m[0] = -5.0: puts vehicle 2 outside the box, north -4.9 to 100 m. Set "
            "formation.vehicle[1].position_m[0] to -4.9, or limits.north_m to [-5, 100]",
        ),
        (
            limits(north_m=[-100.0, 49.5]),
            "end.position_m[0] = 50.0: puts vehicles 1, 3 outside the box, north -100 to 49.5 m; vehicle 1 would be"
            " at 50. Set end.position_m[0] to 49.5, or limits.north_m to [-100, 50]",
        ),
        (
            limits(east_m=[-100.0, 4.0]),
            "formation.vehicle[2].position_m[1] = 5.0: puts vehicle 3 outside the box, east -100 to 4 m. Set "
            "formation.vehicle[2].position_m[1] to 4, or limits.east_m to [-100, 5]",
        ),
        (  # too narrow for all
            limits(east_m=[1.0, 4.0]),
            "start.position_m[1] = 0.0: puts vehicles 1, 2, 3 outside the box, east 1 to 4 m; vehicle 1 would be at"
            " 0. Set limits.east_m to [0, 5]\n"
            "end.position_m[1] = 0.0: puts vehicles 1, 2, 3 outside the box, east 1 to 4 m; vehicle 1 would be at "
            "0. Set limits.east_m to [0, 5]",
        ),
        (limits(height_m=[0.0, 12.0]), ""),
        (
            limits(height_m=[0.0, 11.5]),
            "formation.vehicle[2].position_m[2] = 12.0: puts vehicle 3 outside the box, height 0 to 11.5 m. Set "
            "formation.vehicle[2].position_m[2] to 10, as the others have, or limits.height_m to [0, 12]",
        ),
        (
            limits(height_m=[0.0, 9.0]),
            "start.position_m[2] = 10.0: puts vehicles 1, 2, 3 outside the box, height 0 to 9 m; vehicle 3 would be"
            " at 12. Set start.position_m[2] to 7 and move every vehicle by 3 m down, or limits.height_m to [0, "
            "12]; is it in feet? 10 ft are 3.048 m\n"
            "end.position_m[2] = 10.0: puts vehicles 1, 2, 3 outside the box, height 0 to 9 m; vehicle 3 would be "
            "at 12. Set end.position_m[2] to 7, or limits.height_m to [0, 12]; is it in feet? 10 ft are 3.048 m",
        ),
        (
            {
                "start": {"position_m": [-101.0, 0.0, 10.0]},
                "formation": fleet([-101.0, 0.0, 10.0], [-105.0, 0.0, 10.0]),
            },
            "start.position_m[0] = -101.0: puts vehicles 1, 2 outside the box, north -100 to 100 m; vehicle 2 would"
            " be at -105. Set start.position_m[0] to -96 and move every vehicle by 5 m north, or limits.north_m to"
            " [-105, 100]",
        ),
        (
            {"end": end(50.0, 100.0), "ground_phases": {"landing_s": 96.0}},
            "end.position_m[2] = 100.0: puts vehicles 1, 2, 3 outside the box, height 0 to 40 m; vehicle 3 would be"
            " at 102. Set end.position_m[2] to 38, or limits.height_m to [0, 102]; is it in feet? 100 ft are 30.48"
            " m",
        ),
        (
            {"end": end(50.0, 140.0), "ground_phases": {"landing_s": 140.0}},
            "end.position_m[2] = 140.0: puts vehicles 1, 2, 3 outside the box, height 0 to 40 m; vehicle 3 would be"
            " at 142. Set end.position_m[2] to 38, or limits.height_m to [0, 142]",
        ),
        (
            {"end": end(-99.0)},
            "end.position_m[0] = -99.0: puts vehicle 2 outside the box, north -100 to 100 m; vehicle 2 would be at "
            "-104. Set end.position_m[0] to -95, or limits.north_m to [-104, 100]",
        ),
        (
            {"formation": fleet(LEADER, [-101.0, 0.0, 10.0], [-104.5, 5.0, 12.0])},
            "formation.vehicle[2].position_m[0] = -104.5: puts vehicle 3 outside the box, north -100 to 100 m; in "
            "all, vehicles 2, 3 are outside. Set limits.north_m to [-105, 100], or move these vehicles",
        ),
        (
            {"formation": fleet(LEADER, [101.5, 0.0, 10.0], [104.25, 5.0, 12.0])},
            "formation.vehicle[2].position_m[0] = 104.25: puts vehicle 3 outside the box, north -100 to 100 m; in "
            "all, vehicles 2, 3 are outside. Set limits.north_m to [-100, 105], or move these vehicles",
        ),
        (
            {"formation": fleet(LEADER, [-104.5, 0.0, 10.0], [101.5, 5.0, 12.0])},
            "formation.vehicle[1].position_m[0] = -104.5: puts vehicle 2 outside the box, north -100 to 100 m; in "
            "all, vehicles 2, 3 are outside. Set limits.north_m to [-105, 102], or move these vehicles",
        ),
        (
            {"start": {"position_m": [0.5, 0.0, 10.0]}, "formation": fleet(LEADER, [-101.0, 0.0, 10.0], EAST)},
            "start.position_m = [0.5, 0.0, 10.0]: differs from [0, 0, 10], the position of the leader, vehicle 1. "
            "Make them equal: move [start] back, or every vehicle by 0.5 m north\n"
            "start.position_m[0] = 0.5: puts vehicle 2 outside the box, north -100 to 100 m; vehicle 2 would be at "
            "-100.5. Set start.position_m[0] to 1 and move every vehicle by 1 m north, or limits.north_m to [-101,"
            " 100]",
        ),
        (
            {"formation": fleet(LEADER, SOUTH, [0.0, 5.0, 40.5]), "ground_phases": {"landing_s": 38.0}},
            "formation.vehicle[2].position_m[2] = 40.5: puts vehicle 3 outside the box, height 0 to 40 m. Set "
            "formation.vehicle[2].position_m[2] to 10, as the others have, or limits.height_m to [0, 41]",
        ),
        (
            {"formation": fleet(LEADER, [-5.0, 0.0, 41.0], EAST), "ground_phases": {"landing_s": 39.0}},
            "formation.vehicle[1].position_m[2] = 41.0: puts vehicle 2 outside the box, height 0 to 40 m. Set "
            "formation.vehicle[1].position_m[2] to 40, or limits.height_m to [0, 41]",
        ),
    ],
)
def test_places_in_the_box(data: Data, tables: Data, told: str) -> None:
    assert "\n".join(violated(RULES, with_tables(data, **tables))) == told


@pytest.mark.parametrize(
    ("tables", "told"),
    [
        ({"formation": ending(to("row")), "end": end(84.0)}, ""),
        ({"formation": ending(to("row")), "end": end(-100.0)}, ""),
        (
            {"formation": ending(to("row")), "end": end(84.5)},
            "end.position_m[0] = 84.5: puts 1 place of the last shape, row, outside the box, north -100 to 100 m; "
            "the shape would reach from 84.5 to 100.5. Set end.position_m[0] to 84, or limits.north_m to [-100, "
            "101]",
        ),
        (
            {"formation": ending(to("row")), "end": end(93.0)},
            "end.position_m[0] = 93.0: puts 2 places of the last shape, row, outside the box, north -100 to 100 m; "
            "the shape would reach from 93 to 109. Set end.position_m[0] to 84, or limits.north_m to [-100, 109]",
        ),
        (
            {"formation": ending(to("row")), "end": end(100.0)},
            "end.position_m[0] = 100.0: puts 2 places of the last shape, row, outside the box, north -100 to 100 m;"
            " the shape would reach from 100 to 116. Set end.position_m[0] to 84, or limits.north_m to [-100, 116]",
        ),
        (  # the leader alone
            {"formation": ending(to("row")), "end": end(100.5)},
            "end.position_m[0] = 100.5: puts vehicle 1 outside the box, north -100 to 100 m; vehicle 1 would be at "
            "100.5. Set end.position_m[0] to 100, or limits.north_m to [-100, 101]",
        ),
        (
            {"formation": ending(to("row")), "end": end(50.0, 3.5), **limits(height_m=[3.5, 15.0])},
            "end.position_m[2] = 3.5: puts 1 place of the last shape, row, outside the box, height 3.5 to 15 m; the"
            " shape would reach from 0.5 to 3.5. Set end.position_m[2] to 6.5, or limits.height_m to [0, 15]",
        ),
        ({"formation": ending(to("row"), frame="course"), "end": end(84.5)}, ""),
        ({"formation": ending(to("row"), to("start", at_s=70.0)), "end": end(84.5)}, ""),
        (
            {"formation": ending(to("start"), to("row", at_s=70.0)), "end": end(84.5)},
            "end.position_m[0] = 84.5: puts 1 place of the last shape, row, outside the box, north -100 to 100 m; "
            "the shape would reach from 84.5 to 100.5. Set end.position_m[0] to 84, or limits.north_m to [-100, "
            "101]",
        ),
        ({"formation": ending(to("start"), to("row", gate_m=GATE_M)), "end": end(84.5)}, ""),  # whichever comes last
        (
            {"formation": ending(to("row", gate_m=GATE_M)), "end": end(84.5)},
            "end.position_m[0] = 84.5: puts 1 place of the last shape, row, outside the box, north -100 to 100 m; "
            "the shape would reach from 84.5 to 100.5. Set end.position_m[0] to 84, or limits.north_m to [-100, "
            "101]",
        ),
        (
            {"formation": ending(to("row"), to("start", auto=True)), "end": end(84.5)},
            "end.position_m[0] = 84.5: puts 1 place of the last shape, row, outside the box, north -100 to 100 m; "
            "the shape would reach from 84.5 to 100.5. Set end.position_m[0] to 84, or limits.north_m to [-100, "
            "101]",
        ),
        ({"formation": ending(to("row", auto=True)), "end": end(84.5)}, ""),
        ({"formation": ending(to("row")), "end": end(84.5), "route": [{**end(20.0), "shape": "row"}]}, ""),
        (  # told once
            {"formation": fleet(LEADER, [-101.0, 0.0, 10.0], EAST, change=[to("start")]), "end": end(0.5)},
            "formation.vehicle[1].position_m[0] = -101.0: puts vehicle 2 outside the box, north -100 to 100 m. Set "
            "formation.vehicle[1].position_m[0] to -100, or limits.north_m to [-101, 100]",
        ),
        (
            {"formation": fleet(LEADER, [-90.0, 0.0, 10.0], EAST, change=[to("start")]), "end": end(-20.0)},
            "end.position_m[0] = -20.0: puts 1 place of the last shape, start, outside the box, north -100 to "
            "100 m; the shape would reach from -110 to -20. Set end.position_m[0] to -10, or limits.north_m to "
            "[-110, 100]",
        ),
    ],
)
def test_a_last_shape_in_the_box(data: Data, tables: Data, told: str) -> None:
    assert "\n".join(violated(RULES, with_tables(data, **tables))) == told


@pytest.mark.parametrize(
    ("tables", "told"),
    [
        (limits(clearance_min_m=10.0), ""),
        (
            limits(clearance_min_m=10.53),
            "start.position_m[2] = 10.0: vehicle 1 would be 0.53 m too low: limits.clearance_min_m requires 10.53 "
            "m to the highest possible ground around it. Set start.position_m[2] to 10.6 or more\n"
            "end.position_m[2] = 10.0: vehicle 1 would be 0.53 m too low: limits.clearance_min_m requires 10.53 m "
            "to the highest possible ground around it. Set end.position_m[2] to 10.6 or more",
        ),
        (
            {"end": end(50.0, 1.5)},
            "end.position_m[2] = 1.5: vehicle 1 would be 0.50 m too low: limits.clearance_min_m requires 2 m to "
            "the highest possible ground around it. Set end.position_m[2] to 2 or more",
        ),
        (  # not told of the end again
            {"formation": fleet(LEADER, SOUTH, [0.0, 5.0, 1.0])},
            "formation.vehicle[2].position_m[2] = 1.0: vehicle 3 would be 1.00 m too low: limits.clearance_min_m "
            "requires 2 m to the highest possible ground around it. Set formation.vehicle[2].position_m[2] to 2 or"
            " more",
        ),
        (
            {"formation": fleet(LEADER, [-5.0, 0.0, 0.5], [0.0, 5.0, 1.0])},
            "formation.vehicle[1].position_m[2] = 0.5: vehicle 2 would be 1.50 m too low: limits.clearance_min_m "
            "requires 2 m to the highest possible ground around it. Set formation.vehicle[1].position_m[2] to 2 or"
            " more",
        ),
        (
            {
                "formation": fleet([0.0, 0.0, 1.5], [-5.0, 0.0, 1.0]),
                "start": {"position_m": [0.0, 0.0, 1.5]},
                "end": end(50.0, 5.0),
            },
            "start.position_m[2] = 1.5: vehicle 2 would be 1.00 m too low: limits.clearance_min_m requires 2 m to "
            "the highest possible ground around it. Set start.position_m[2] to 2.5 or more",
        ),
        (
            {"start": {"velocity_mps": NORTH}, "ground_phases": RUN_UP, "terrain": hill(-21.0)},
            "ground_phases.run_up_m = 40.6: vehicle 1 would be 0.52 m too low: limits.clearance_min_m requires 2 m"
            " to the highest possible ground around it, 18 m into the run-up. Shorten it, or raise [start]",
        ),
        (
            {
                "start": {"velocity_mps": NORTH},
                "ground_phases": RUN_UP,
                "terrain": hill(-20.0),
                **limits(clearance_min_m=0.5),
            },
            "",
        ),
        ({"ground_phases": RUN_UP, "terrain": hill(-20.0)}, ""),  # from rest there is no run-up
        (
            {"start": {"velocity_mps": NORTH}, "ground_phases": RUN_UP, "terrain": hill(0.0)},
            "start.position_m[2] = 10.0: vehicle 1 would be 1.00 m too low: limits.clearance_min_m requires 2 m to"
            " the highest possible ground around it. Set start.position_m[2] to 11 or more\n"
            "ground_phases.run_up_m = 40.6: vehicle 1 would be 0.40 m too low: limits.clearance_min_m requires 2 m"
            " to the highest possible ground around it, 39 m into the run-up. Shorten it, or raise [start]",
        ),
        (
            {"start": {"velocity_mps": [0.0, 0.0, 1.0]}, "ground_phases": RUN_UP, "terrain": hill(0.0)},
            "start.position_m[2] = 10.0: vehicle 1 would be 1.00 m too low: limits.clearance_min_m requires 2 m to"
            " the highest possible ground around it. Set start.position_m[2] to 11 or more",
        ),
        (
            {"formation": fleet(LEADER, SOUTH, [-5.0, 2.9, 13.0])},
            "formation.vehicle[2].position_m = [-5.0, 2.9, 13.0]: vehicles 2 and 3 fly above each other and would "
            "take off 2.90 m apart; limits.separation_min_m requires 3 m. Move vehicle 3 away by 0.1 m or more",
        ),
        (
            {"formation": fleet(LEADER, SOUTH, [-5.0, 0.0, 13.0])},
            "formation.vehicle[2].position_m = [-5.0, 0.0, 13.0]: vehicles 2 and 3 fly above each other and would "
            "take off 0.00 m apart; limits.separation_min_m requires 3 m. Move vehicle 3 away by 3 m or more",
        ),
        ({"formation": fleet(LEADER, SOUTH, [-5.0, 3.0, 13.0])}, ""),
        ({"formation": fleet(LEADER, SOUTH, [-5.0, 1.0, 11.0])}, ""),  # too near in the air too: another rule
    ],
)
def test_heights_above_the_ground_and_pads(data: Data, tables: Data, told: str) -> None:
    assert "\n".join(violated(RULES, with_tables(data, **tables))) == told


@pytest.mark.parametrize(
    ("tables", "told"),
    [
        (  # 15/8 x 12 m / 2 m/s = 11.25 s
            {"ground_phases": {"takeoff_s": 11.24}},
            "ground_phases.takeoff_s = 11.24: too short for 12.0 m from rest to rest; 2 m/s "
            "(limits.speed_ned_mps[2]) and 0.60 m/s² of spare thrust (limits.thrust_N) take 11.2 s, because a "
            "smooth step is 1.88 times as fast in its middle as on average. Set ground_phases.takeoff_s to 12",
        ),
        ({"ground_phases": {"takeoff_s": 11.26, "landing_s": 11.26}}, ""),
        (
            {"ground_phases": {"landing_s": 11.24}},
            "ground_phases.landing_s = 11.24: too short for 12.0 m from rest to rest; 2 m/s "
            "(limits.speed_ned_mps[2]) and 0.60 m/s² of spare thrust (limits.thrust_N) take 11.2 s, because a "
            "smooth step is 1.88 times as fast in its middle as on average. Set ground_phases.landing_s to 12",
        ),
        (
            {"ground_phases": {"takeoff_s": 11.7}, **limits(accel_max_mps2=0.5)},
            "ground_phases.takeoff_s = 11.7: too short for 12.0 m from rest to rest; 2 m/s "
            "(limits.speed_ned_mps[2]) and 0.5 m/s² (limits.accel_max_mps2) take 11.8 s. Set "
            "ground_phases.takeoff_s to 12",
        ),
        ({"ground_phases": {"takeoff_s": 11.8}, **limits(accel_max_mps2=0.5)}, ""),
        (
            {"ground_phases": {"takeoff_s": 11.7}, **limits(accel_max_mps2=0.5, jerk_max_mps3=10.0)},
            "ground_phases.takeoff_s = 11.7: too short for 12.0 m from rest to rest; 2 m/s "
            "(limits.speed_ned_mps[2]) and 0.5 m/s² (limits.accel_max_mps2) take 11.8 s. Set "
            "ground_phases.takeoff_s to 12",
        ),
        ({"ground_phases": {"takeoff_s": 11.26}, **limits(accel_max_mps2=0.7)}, ""),  # the spare thrust is less
        (
            {"ground_phases": {"takeoff_s": 17.7}, **limits(accel_max_mps2=0.5, jerk_max_mps3=0.128)},
            "ground_phases.takeoff_s = 17.7: too short for 12.0 m from rest to rest; 2 m/s "
            "(limits.speed_ned_mps[2]) and 0.128 m/s³ (limits.jerk_max_mps3) take 17.8 s. Set "
            "ground_phases.takeoff_s to 18",
        ),
        ({"ground_phases": {"takeoff_s": 17.8}, **limits(accel_max_mps2=0.5, jerk_max_mps3=0.128)}, ""),
        (
            {"wind": {"speed_mps": 1.0, "from_deg": 0.0}, "ground_phases": {"takeoff_s": 13.1}},
            "ground_phases.takeoff_s = 13.1: too short for 12.0 m from rest to rest; 2 m/s "
            "(limits.speed_ned_mps[2]) and 0.60 m/s² of spare thrust (limits.thrust_N) take 13.1 s, because a "
            "smooth step in wind is 2.19 times as fast in its middle as on average. Set ground_phases.takeoff_s to"
            " 14",
        ),
        (  # 0.73 N aside
            {"wind": {"speed_mps": 10.0, "from_deg": 0.0}, "ground_phases": {"takeoff_s": 13.4}},
            "ground_phases.takeoff_s = 13.4: too short for 12.0 m from rest to rest; 2 m/s "
            "(limits.speed_ned_mps[2]) and 0.50 m/s² of spare thrust (limits.thrust_N) take 13.5 s. Set "
            "ground_phases.takeoff_s to 14",
        ),
        ({"wind": {"speed_mps": 10.0, "from_deg": 90.0}, "ground_phases": {"takeoff_s": 13.5}}, ""),
        (
            {
                "wind": {"speed_mps": 10.0, "from_deg": 90.0},
                "ground_phases": {"takeoff_s": 14.6},
                **limits(jerk_max_mps3=0.2),
            },
            "ground_phases.takeoff_s = 14.6: too short for 12.0 m from rest to rest; 2 m/s "
            "(limits.speed_ned_mps[2]) and 0.2 m/s³ (limits.jerk_max_mps3) take 14.7 s. Set "
            "ground_phases.takeoff_s to 15",
        ),
        (
            {"end": end(50.0, 20.0), "ground_phases": {"takeoff_s": 11.3, "landing_s": 20.6}},
            "ground_phases.landing_s = 20.6: too short for 22.0 m from rest to rest; 2 m/s "
            "(limits.speed_ned_mps[2]) and 0.60 m/s² of spare thrust (limits.thrust_N) take 20.6 s, because a "
            "smooth step is 1.88 times as fast in its middle as on average. Set ground_phases.landing_s to 21",
        ),
        (
            {
                "formation": fleet(LEADER, SOUTH, [0.0, 5.0, 40.5]),
                "ground_phases": {"takeoff_s": 9.8, "landing_s": 38.0},
            },
            "formation.vehicle[2].position_m[2] = 40.5: puts vehicle 3 outside the box, height 0 to 40 m. Set "
            "formation.vehicle[2].position_m[2] to 10, as the others have, or limits.height_m to [0, 41]\n"
            "ground_phases.takeoff_s = 9.8: too short for 10.0 m from rest to rest; 2 m/s "
            "(limits.speed_ned_mps[2]) and 0.60 m/s² of spare thrust (limits.thrust_N) take 9.8 s. Set "
            "ground_phases.takeoff_s to 10",
        ),
        (  # the leader's 10 m alone
            {"formation": ending(to("row", gate_m=GATE_M)), "ground_phases": {"landing_s": 9.7}},
            "ground_phases.landing_s = 9.7: too short for 10.0 m from rest to rest; 2 m/s "
            "(limits.speed_ned_mps[2]) and 0.60 m/s² of spare thrust (limits.thrust_N) take 9.8 s. Set "
            "ground_phases.landing_s to 10",
        ),
        ({"ground_phases": {"takeoff_s": 1.0}, **limits(thrust_N=[0.0, 4.9])}, ""),  # it cannot hover: another rule
    ],
)
def test_times_of_climb_and_descent(data: Data, tables: Data, told: str) -> None:
    """A quintic over d in T has peaks of 15/8 d/T, 10/sqrt(3) d/T² and 60 d/T³; in wind 35/16, 7.51 and 52.5."""
    assert "\n".join(violated(RULES, with_tables(data, **tables))) == told


def test_a_leader_of_a_counted_formation_stands_at_the_start(data: Data) -> None:
    shape = {"name": "line", "generator": "line", "spacing_m": 4.0}
    many = counted(data, 30, shape)
    assert violated(RULES, with_tables(many, start={"position_m": [0.0, 0.0, 30.0]}, end=end(50.0, 30.0))) == []
    found = violated(RULES, with_tables(many, limits={"east_m": [-30.0, 30.0], "height_m": [0.0, 40.0]}))
    assert found == [
        f"{table}.position_m[1] = 0.0: puts vehicles 16, 17, 18, 19, 20, 21, 22, 23, and 7 more outside the box, east "
        f"-30 to 30 m; vehicle 30 would be at 60. Set limits.east_m to [-56, 60]"
        for table in ("start", "end")
    ]
