"""Values that a scenario file may not have: each is named with what it must be, and with what was meant perhaps."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from gcs.scenario.schema.mistake import KeyChange, Mistake, nearest
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.schema.toml_lines import Key
from gcs.scenario.validation.schema_words import from_pydantic
from tests.unit.scenario.variants import Data, with_tables

SCHEMA = re.compile(r"must be (?!an array of).*?(?=: is it|: swapped|\. [A-Z]|$)")  # its words are tested elsewhere


def found(data: Data) -> list[str]:
    with pytest.raises(ValidationError) as caught:
        Scenario.model_validate(data)
    return [SCHEMA.sub("must be ...", str(mistake)) for mistake in from_pydantic(caught.value)]


def zone(**keys: Any) -> Data:
    return {"no_fly": [{"north_m": 100.0, "east_m": 100.0, "radius_m": 5.0, **keys}]}


@pytest.fixture(scope="module")
def data(repo_root: Path) -> Data:
    return tomllib.loads((repo_root / "missions" / "simulation1" / "scenario.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("tables", "told"),
    [
        (
            {"vehicle": {"mass_kg": -0.5}},
            "vehicle.mass_kg = -0.5: must be .... Write mass_kg = 0.5",
        ),
        (
            {"vehicle": {"mass_kg": -1e13}},
            "vehicle.mass_kg = -10000000000000.0: must be ...",
        ),
        (
            {"vehicle": {"mass_kg": "0.5"}},
            'vehicle.mass_kg = "0.5": must be ...',
        ),
        (
            {"vehicle": {"mass_kg": 0}},
            "vehicle.mass_kg = 0: must be ...",
        ),
        (  # a key of another table
            {"vehicle": {"flight_s": 5.0}},
            "vehicle.flight_s: unknown key here; it belongs to [time]. Move it to [time]",
        ),
        (
            {"vehicle": {"qqqq": 5.0}},
            "vehicle.qqqq: unknown key; known ones are name, mass_kg, arm_m, inertia_kgm2, thrust_coeff_Ns2, "
            "moment_coeff_Nms2, drag_Nspm, drag_moment_Nms, gravity_mps2, rotor_max_radps, power. Remove vehicle.qqqq; "
            "`gcs schema` prints every key with its unit and range",
        ),
        (
            {"limits": {"thrust_N": [-1.0, 5.2]}},
            "limits.thrust_N[0] = -1.0: must be .... Write 1",
        ),
        (
            {"limits": {"thrust_N": [5.2]}},
            "limits.thrust_N = [5.2]: has too few values; it must be ...",
        ),
        (
            {"limits": {"clearance_min_m": None}},
            "limits.clearance_min_m: must be ...",
        ),
        (
            {"origin": {"lat_deg": 473977420}},
            "origin.lat_deg = 473977420: must be ...: is it degrees times 10 million? Write lat_deg = 47.397742",
        ),
        (
            {"origin": {"lat_deg": -473977420}},
            "origin.lat_deg = -473977420: must be ...: is it degrees times 10 million? Write lat_deg = -47.397742",
        ),
        (
            {"origin": {"lon_deg": 1800000000}},
            "origin.lon_deg = 1800000000: must be ...: is it degrees times 10 million? Write lon_deg = 180",
        ),
        (
            {"origin": {"lon_deg": 1800000001}},
            "origin.lon_deg = 1800000001: must be ...",
        ),
        (
            {"origin": {"lat_deg": 120.5}},
            "origin.lat_deg = 120.5: must be ...: swapped latitude and longitude? Exchange lat_deg and lon_deg",
        ),
        (
            {"origin": {"lat_deg": -180.0}},
            "origin.lat_deg = -180.0: must be ...: swapped latitude and longitude? Exchange lat_deg and lon_deg",
        ),
        (
            {"origin": {"lat_deg": 181.0}},
            "origin.lat_deg = 181.0: must be ...",
        ),
        (
            {"origin": {"lat_deg": 90.5, "lon_deg": 190.0}},
            "origin.lat_deg = 90.5: must be ...: swapped latitude and longitude? Exchange lat_deg and lon_deg\n"
            "origin.lon_deg = 190.0: must be ...",
        ),
        (
            zone(north_m=473977420),
            "no_fly[0].north_m = 473977420: must be ...: is it degrees times 10 million? Write metres; 473977420 "
            "would be 47.398 degrees",
        ),
        (
            zone(east_m=-85455940),
            "no_fly[0].east_m = -85455940: must be ...: is it degrees times 10 million? Write metres; -85455940 "
            "would be -8.546 degrees",
        ),
        (
            zone(north_m=1800000001),
            "no_fly[0].north_m = 1800000001: must be ...",
        ),
        (
            zone(north_m=473977420.5),
            "no_fly[0].north_m = 473977420.5: must be ...",
        ),
        (
            {"mission": {"autopilot": "ardupilott"}},
            'mission.autopilot = "ardupilott": must be .... Write autopilot = "ardupilot"',
        ),
        (
            {"mission": {"autopilot": "qqqq"}},
            'mission.autopilot = "qqqq": must be ...',
        ),
        (
            {"no_fly": {"north_m": 100.0, "east_m": 100.0, "radius_m": 5.0}},
            "no_fly: must be an array of tables. Write [[no_fly]]",
        ),
        (
            {"start": {"position_m": None}},
            "start.position_m: must be ...",
        ),
        (
            {"time": {"flight_s": True}},
            "time.flight_s = true: must be ...",
        ),
    ],
)
def test_a_wrong_value_is_named_with_what_is_right(data: Data, tables: Data, told: str) -> None:
    assert "\n".join(found(with_tables(data, **tables))) == told


@pytest.mark.parametrize("missing", ["mass_kg", "position_m", "vehicle"])
def test_what_is_missing_is_told_with_what_to_add(data: Data, missing: str) -> None:
    lacking = {name: table for name, table in data.items() if name != missing}
    for table in ("vehicle", "start"):
        if table in lacking:
            lacking[table] = {key: value for key, value in lacking[table].items() if key != missing}
    (text,) = found(lacking)
    assert (
        text
        == {
            "mass_kg": "vehicle.mass_kg: missing; it must be .... Add vehicle.mass_kg",
            "position_m": "start.position_m: missing; give position_m or position_deg. Add start.position_m = "
            "[north, east, height], in m, or position_deg",
            "vehicle": "vehicle: missing; it must be .... Add a table [vehicle]",
        }[missing]
    )


@pytest.mark.parametrize(
    ("name", "known", "meant"),
    [
        ("mass", ("massive", "mass_kg"), "mass_kg"),
        ("MASS-KG", ("mass_kg",), "mass_kg"),
        ("flight_m", ("flight_s", "light_s"), "flight_s"),
        ("qqqq", ("mass_kg",), None),
    ],
)
def test_the_nearest_name_is_the_same_with_a_unit_or_one_alike(
    name: str, known: tuple[str, ...], meant: str | None
) -> None:
    assert nearest(name, known) == meant


@pytest.mark.parametrize(
    ("text", "remedy", "changes", "step", "whole"),
    [
        ("too high", "set it to 5", [], "set it to 5", "too high. Set it to 5"),
        ("too high", "set {}", [(("a", "b_m"), 5.0)], "set a.b_m to 5", "too high. Set a.b_m to 5"),
        ("no", "set {}", [(("a_deg",), [1.00000004, 2])], "set a_deg to [1, 2]", "no. Set a_deg to [1, 2]"),
        ("is it in feet?", "write {m}", [], "write {m}", "is it in feet? Write {m}"),
        ("too high", "", [], "", "too high"),
    ],
)
def test_a_mistake_is_a_problem_and_a_step(
    text: str, remedy: str, changes: list[tuple[Key, float]], step: str, whole: str
) -> None:
    mistake = Mistake(("a", 0, "b"), text, 4.0, remedy, tuple(KeyChange(*one) for one in changes))
    assert (mistake.step, mistake.whole) == (step, whole)
    assert (str(mistake), mistake.line) == (f"a[0].b = 4.0: {whole}", None)
    assert Mistake(("a",), "x").place == "a"
