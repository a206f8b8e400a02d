"""Mistakes in [formation], [[formation.shape]] and [[formation.change]]: told with the line and key they are at."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from gcs.errors import ScenarioError
from gcs.scenario.sources.load import load_scenario
from tests.unit.scenario.variants import formation_text

Told = Callable[[str], list[str]]

FLEET = '[formation]\nleader = 1\ncount = 6\nstart_shape = "grid"'
GRID = '[[formation.shape]]\nname = "grid"\ngenerator = "grid"\nspacing_m = 2.0'


@pytest.fixture
def told(tmp_path: Path, repo_root: Path) -> Told:
    """What loading Simulation 1 with another formation tells: lines without the file, counted from [formation] = 1."""
    text = (repo_root / "missions" / "simulation1" / "scenario.toml").read_text(encoding="utf-8")
    # Room for any shape: only mistakes inside the formation are to be reported.
    text = text.replace("north_m = [0.0, 1500.0]", "north_m = [-100.0, 1500.0]")
    text = text.replace("east_m = [0.0, 1500.0]", "east_m = [-100.0, 1500.0]")
    file, above = tmp_path / "scenario.toml", text[: text.index("[formation]")].count("\n")

    def load(formation: str) -> list[str]:
        file.write_text(formation_text(text, formation), encoding="utf-8")
        try:
            load_scenario(file)
        except ScenarioError as error:
            lines = [line.removeprefix(f"{file}:") for line in error.message.splitlines() if " mistakes" not in line]
            if len(lines) == 1:
                lines = [f"{lines[0]}. {error.hint[0].upper()}{error.hint[1:]}"]
            numbered = [line.partition(": ") for line in lines]
            return [f"{int(number) - above}: {sentence}" for number, _, sentence in numbered]
        return []

    return load


def change(*lines: str) -> str:
    return "\n".join([FLEET, GRID, "[[formation.change]]", *lines])


def test_a_counted_formation_that_changes_is_fine(told: Told) -> None:
    wedge = (
        '[[formation.shape]]\nname = "wedge"\noffsets_m = [[0,0,0], [-2,1,0], [-2,-1,0], [-4,2,0], [-4,0,1], [-4,-2,0]]'
    )
    changes = [
        'kind = "rotate"\nangle_deg = -90.0\nat_s = 0.0',
        'kind = "rotate"\nangle_deg = 20.0\naxis = [0, 1, 0]\ngate_m = [[1400.0, 0.0], [1600.0, 0.0]]',
        'kind = "shrink"\nscale = 2\nat_s = 100.0',
        'kind = "shrink"\nscale = 0.5\nauto = true\nweight = 0.1',
        'kind = "reshape"\nto = "wedge"\nassignment = "fixed"\nat_s = 100.0',
        'kind = "reshape"\nto = "start"\nat_s = 200.0',
        'kind = "rotate"\nangle_deg = 90.0\nauto = true',
    ]
    assert told("\n".join([FLEET, GRID, wedge, *(f"[[formation.change]]\n{text}" for text in changes)])) == []


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        (['kind = "spin"'], '10: formation.change[0].kind = "spin": must be one of "rotate", "shrink", "reshape"'),
        (
            ['kind = "shrink"', "scale = 0.5"],
            "9: formation.change[0]: has no time. Give one of at_s, done_at_s, gate_m, at_point and auto = true",
        ),
        (
            ['kind = "shrink"', "scale = 0.5", "auto = true", "at_s = 0.0"],
            "12: formation.change[0].auto = true: at_s sets the time already. Keep one of the two",
        ),
        (
            ['kind = "shrink"', "scale = 0.5", "gate_m = [[1, 2], [3, 4]]", "at_s = 5"],
            "12: formation.change[0].gate_m = [[1, 2], [3, 4]]: at_s sets the time already",
        ),
        (
            ['kind = "shrink"', "scale = 0.5", "gate_m = [[1.0, 2.0], [1, 2]]"],
            "12: formation.change[0].gate_m = [[1.0, 2.0], [1, 2]]: is a single point",
        ),
        (
            ['kind = "shrink"', "scale = 0.5", "gate_m = [[1.0, 2.0]]"],
            "12: formation.change[0].gate_m = [[1.0, 2.0]]: has too few values; it must be a list of 2",
        ),
        (
            ['kind = "rotate"', "at_s = 5.0"],
            "9: formation.change[0].angle_deg: missing; kind = \"rotate\" needs it (rotate: angle about `axis`",
        ),
        (['kind = "shrink"', "at_s = 5.0"], '9: formation.change[0].scale: missing; kind = "shrink" needs it (shrink'),
        (['kind = "reshape"', "at_s = 5.0"], '9: formation.change[0].to: missing; kind = "reshape" needs it (reshape'),
        (
            ['kind = "shrink"', "at_s = 5.0", "scale = 0.5", "angle_deg = 20.0"],
            '13: formation.change[0].angle_deg = 20.0: has no effect with kind = "shrink". Remove it, or give',
        ),
        (
            ['kind = "rotate"', "at_s = 5.0", "angle_deg = 20.0", "axis = [0, 0, 0]"],
            "13: formation.change[0].axis = [0, 0, 0]: has no direction. Give for example [0, 0, 1], straight up",
        ),
        (
            ['kind = "rotate"', "auto = true", "angle_deg = 20.0", "axis = [0, 0, 1]"],
            "13: formation.change[0].axis = [0, 0, 1]: an automatic rotation turns about the vertical",
        ),
        (
            ['kind = "rotate"', "auto = true", "angle_deg = -20.0"],
            "12: formation.change[0].angle_deg = -20.0: must be > 0: with auto it is the largest angle in either",
        ),
        (
            ['kind = "shrink"', "auto = true", "scale = 1.0"],
            "12: formation.change[0].scale = 1.0: must be < 1: with auto it is the smallest size",
        ),
        (
            ['kind = "shrink"', "at_s = 5.0", "scale = 0.5", "weight = 0.1"],
            "13: formation.change[0].weight = 0.1: is the cost of auto = true. Remove it",
        ),
        (
            ['kind = "shrink"', 'auto = "yes"', "scale = 0.5"],
            '11: formation.change[0].auto = "yes": must be true or false (the planner chooses the time and the amount)',
        ),
        (
            ['kind = "shrink"', "at = 5.0", "scale = 0.5"],
            "11: formation.change[0].at: unknown key; the nearest known one is at_s",
        ),
        (
            ['kind = "shrink"', "at_s = 5.0", "scale = 0.5", 'name = "squeeze"'],
            "13: formation.change[0].name: unknown key here; it belongs to [[formation.shape]]",
        ),
        (
            ['kind = "reshape"', 'to = "gird"', "at_s = 5.0"],
            '11: formation.change[0].to = "gird": is the name of no shape. Write "grid"',
        ),
        (
            ['kind = "reshape"', 'to = "wedge"', "at_s = 5.0"],
            '11: formation.change[0].to = "wedge": is the name of no shape; [[formation.shape]] tables give names, and '
            'there are "start", "grid"',
        ),
    ],
)  # fmt: skip
def test_one_mistake_in_a_change(told: Told, lines: list[str], says: str) -> None:
    sentences = told(change(*lines))
    assert sentences[0].startswith(says)
    assert len(sentences) == 1 or "unknown key" in says  # without its key, the change lacks a time as well


@pytest.mark.parametrize(
    ("shape", "says"),
    [
        ('name = "a"', "5: formation.shape[0]: has no places. Give generator and spacing_m, or offsets_m"),
        (
            'name = "start"\ngenerator = "grid"\nspacing_m = 2.0',
            '6: formation.shape[0].name = "start": is the name of the shape at t = 0. Give this shape another name',
        ),
        (
            'name = "a"\ngenerator = "grid"',
            '5: formation.shape[0].spacing_m: missing; generator = "grid" needs the distance between neighbours, m',
        ),
        (
            'name = "a"\ngenerator = "square"\nspacing_m = 2.0',
            '7: formation.shape[0].generator = "square": must be one of "triangle", "line", "column", "vee", "grid"',
        ),
        (
            'name = "a"\nspacing_m = 2.0\noffsets_m = [[0, 0, 0], [1, 0, 0]]',
            "7: formation.shape[0].spacing_m = 2.0: has no effect on offsets_m. Remove it",
        ),
        (
            'name = "a"\nheading_deg = 45.0\noffsets_m = [[0, 0, 0], [1, 0, 0]]',
            "7: formation.shape[0].heading_deg = 45.0: has no effect on offsets_m. Remove it",
        ),
        (
            'name = "a"\nspacing_m = 2.0\ngenerator = "line"\noffsets_m = [[0, 0, 0], [1, 0, 0]]',
            '9: formation.shape[0].offsets_m = [[0, 0, 0], [1, 0, 0]]: generator = "line" defines the places already',
        ),
        (
            'name = "a"\noffsets_m = [[0, 0, 0], [1, 0]]',
            "7: formation.shape[0].offsets_m[1] = [1, 0]: has too few values; it must be a list of 3",
        ),
        (
            'name = "a"\ngenerator = "line"\nspacing_m = 2.0\ntopology = "leader"',
            "9: formation.shape[0].topology: unknown key here; it belongs to [formation]",
        ),
        (
            'name = "a"\ngenerator = "line"\nspacing_m = 2.0\nscale = 0.5',
            "9: formation.shape[0].scale: unknown key here; it belongs to [[formation.change]]",
        ),
    ],
)
def test_one_mistake_in_a_shape(told: Told, shape: str, says: str) -> None:
    (sentence,) = told('[formation]\nleader = 1\ncount = 2\nstart_shape = "a"\n[[formation.shape]]\n' + shape)
    assert sentence.startswith(says)


@pytest.mark.parametrize(
    ("formation", "says"),
    [
        ("leader = 1", ["1: formation: has no vehicles. Give [[formation.vehicle]] tables, or count and start_shape"]),
        (
            "leader = 1\ncount = 6\n" + GRID,
            ["1: formation.start_shape: missing; count needs the name of a [[formation.shape]] to start in"],
        ),
        (
            'leader = 7\ncount = 6\nstart_shape = "grid"\n' + GRID,
            ["2: formation.leader = 7: is not the sysid of a vehicle; there are 1, 2, 3, 4, 5, 6"],
        ),
        (
            'leader = 1001\ncount = 1000\nstart_shape = "grid"\n' + GRID,
            ["2: formation.leader = 1001: is not the sysid of a vehicle; there are 1 to 1000"],
        ),
        (
            'leader = 1\ncount = 6.5\nstart_shape = "grid"\n' + GRID,
            ["3: formation.count = 6.5: must be a whole number from 1 to 10000"],
        ),
        (
            'leader = 1\ncount = 6\nstart_shape = "start"\n' + GRID,
            ['4: formation.start_shape = "start": is the name of no shape; [[formation.shape]] tables give names'],
        ),
        (
            'leader = 1\ncount = 6\nstart_shape = "grid"',
            ['4: formation.start_shape = "grid": is the name of no shape; [[formation.shape]] tables give names, and '
             "there are none yet"],
        ),
        (
            'leader = 1\nstart_shape = "grid"\nvehicle = [{sysid = 1, position_m = [2.0, 1.0, 3.0]}]\n' + GRID,
            ['3: formation.start_shape = "grid": belongs to count'],
        ),
        (
            'leader = 1\ncount = 6\nstart_shape = "grid"\n[formation.shape]\nname = "grid"',
            ["5: formation.shape: must be an array of tables. Write [[formation.shape]]"],
        ),
        (
            'leader = 1\ncount = 6\nstart_shape = "grid"\n' + GRID + "\n" + GRID,
            ['10: formation.shape[1].name = "grid": is the name of shape[0] already. Give another one'],
        ),
        (
            "leader = 1\nvehicle = [" + ", ".join(["{sysid = 1, position_m = [2.0, 1.0, 3.0]}"] * 255) + "]",
            ["3: formation.vehicle = [{sysid = 1, position_m = [2.0, 1.0, 3.0]}, {sysid = 1, position_m = [2.0, 1...."
             ": must be a list of at most 254, each a table with sysid, position_m"],
        ),
    ],
)  # fmt: skip
def test_mistakes_of_the_whole_formation(told: Told, formation: str, says: list[str]) -> None:
    sentences = told(f"[formation]\n{formation}")
    assert len(sentences) == len(says)
    for sentence, start in zip(sentences, says, strict=True):
        assert sentence.startswith(start)


def test_what_shapes_and_changes_disagree_about_is_told_all_at_once(told: Told) -> None:
    sentences = told("""
[formation]
leader = 9
count = 6
start_shape = "gird"
frame = "course"
vehicle = [{sysid = 1, position_m = [0.0, 0.0, 3.0]}, {sysid = 1, position_m = [0.0, 0.0, 3.0]}]
[[formation.shape]]
name = "grid"
offsets_m = [[0, 0, 0], [1, 0, 0]]
[[formation.change]]
kind = "shrink"
scale = 0.5
at_s = 300.0
[[formation.change]]
kind = "shrink"
scale = 0.5
gate_m = [[0.0, 1.0], [1.0, 0.0]]
[[formation.change]]
kind = "reshape"
to = "gird"
at_s = 100.0
[[formation.change]]
kind = "shrink"
scale = 0.5
auto = true
[[formation.change]]
kind = "rotate"
angle_deg = 30
auto = true
[[formation.change]]
kind = "shrink"
scale = 0.7
auto = true
""")
    assert sentences == [
        "2: formation.leader = 9: is not the sysid of a vehicle; there are 1, 2, 3, 4, 5, 6",
        "3: formation.count = 6: there are 2 [[formation.vehicle]] tables already. Keep one of the two",
        '4: formation.start_shape = "gird": is the name of no shape. Write "grid"',
        "6: formation.vehicle[1].sysid = 1: is the sysid of vehicle[0] already. Give each vehicle its own",
        "9: formation.shape[0].offsets_m = [[0, 0, 0], [1, 0, 0]]: has 2 places for 6 vehicles. Give one for each, "
        "leader included",
        '20: formation.change[2].to = "gird": is the name of no shape. Write "grid"',
        "21: formation.change[2].at_s = 100.0: is before change[0], which begins at 300 s. Give changes in order "
        "of time",
        '29: formation.change[4].auto = true: with frame = "course" the heading follows the course. Give at_s or '
        "gate_m, or remove it",
        '33: formation.change[5].auto = true: change[3] with kind = "shrink" is automatic already. Keep one',
    ]


def test_times_are_compared_with_the_latest_before(told: Told) -> None:
    def at(time: float) -> str:
        return f'[[formation.change]]\nkind = "rotate"\nangle_deg = 5.0\nat_s = {time}'

    (sentence,) = told("\n".join([FLEET, GRID, at(10.0), at(30.0), at(30.0), at(20.0)]))
    assert sentence.startswith("24: formation.change[3].at_s = 20.0: is before change[2], which begins at 30 s")


def test_the_words_of_every_key_at_fault_are_in_pythons_error_too() -> None:
    from pydantic import ValidationError

    from gcs.scenario.schema.scenario import ChangeTable

    with pytest.raises(ValidationError, match=r"weight: is the cost of auto = true. Remove it"):
        ChangeTable.model_validate({"kind": "shrink", "scale": 0.5, "at_s": 1.0, "weight": 1.0})


def test_an_unknown_autopilot_of_a_vehicle(told: Told) -> None:
    fleet = '[formation]\n[[formation.vehicle]]\nsysid = 1\nposition_m = [2.0, 1.0, 3.0]\nautopilot = "betaflight"'
    (sentence,) = told(fleet)
    assert sentence.startswith('5: formation.vehicle[0].autopilot = "betaflight": must be one of "ardupilot", "px4"')
