"""Load a mission folder or file as a `Scenario`, or raise one error that lists all its mistakes by line."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from gcs.errors import ScenarioError
from gcs.reading.bounded_file import SCENARIO_JSON, SCENARIO_TOML, read_file
from gcs.reading.bounded_json import read_json
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.si import ground_needed, local_origin
from gcs.scenario.validation.cross_table import check
from gcs.scenario.validation.mistakes import Mistake, from_pydantic, toml
from gcs.scenario.validation.toml_lines import key_lines, line_of
from gcs.scenario.validation.vehicle_rules import RULES
from gcs.scenario.vehicle_types import KEY, VehicleFile, presets, vehicle_file, with_vehicle

FILE_NAME = "scenario.toml"
_PARTS_MAX = 64  # of a dotted key: tomllib takes the square of their number
_LONG_KEY = re.compile(rf"""(?<![\w"'-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{_PARTS_MAX}}}""")


def load_scenario(path: Path | str) -> Scenario:
    """The scenario in a mission folder or scenario file.

    Raises ScenarioError with one line for each mistake: file, line, key, value and what is allowed.
    """
    file = scenario_file(Path(path))
    text = _read(file)
    data = _parsed(file, text)
    if isinstance(wanted := data.get(KEY), str):
        data = with_vehicle(data, load_vehicle(vehicle_file(wanted, file.parent)))
    mistakes: list[Mistake] = []
    try:
        scenario = Scenario.model_validate(data)
        scenario, lacking = _with_relief(scenario, file.parent)
        mistakes += lacking or check(scenario)
    except ValidationError as error:
        mistakes += from_pydantic(error)
        sound = _sound_tables(data)
        mistakes += check(Scenario.model_construct(**sound), sound)
    if mistakes:
        raise _all_at_once(file, text, mistakes)
    return scenario


def load_vehicle(file: Path) -> VehicleFile:
    """The vehicle type of a file, checked by the rules of physics. Raises ScenarioError like `load_scenario`."""
    try:
        is_there = file.is_file()
    except OSError:  # a name that is too long
        raise ScenarioError(f"vehicle_type = {toml(str(file))} is not a path", hint="name a preset or a file") from None
    if not is_there:
        known = ", ".join(presets())
        raise ScenarioError(
            f"there is no vehicle type {file.name}: no file {file}",
            hint=f"presets are {known}; a path is relative to the scenario's folder",
        )
    text = _read(file)
    try:
        kind = VehicleFile.model_validate(_parsed(file, text))
    except ValidationError as error:
        raise _all_at_once(file, text, from_pydantic(error, VehicleFile)) from None
    alone = Scenario.model_construct(None, vehicle=kind.vehicle, limits=kind.limits)
    if mistakes := RULES.violated(alone, ("vehicle", "limits")):
        raise _all_at_once(file, text, mistakes)
    return kind


def _with_relief(scenario: Scenario, folder: Path) -> tuple[Scenario, list[Mistake]]:
    """The scenario with the heights of its elevation model, or the mistake of the model."""
    terrain = scenario.terrain
    if terrain.dem is None or terrain.relief is not None:
        return scenario, []
    from gcs.scenario.environment.dem import DemError, read_dem  # noqa: PLC0415 (GDAL takes long to load, and few need it)

    origin = local_origin(scenario)
    try:
        relief = read_dem(folder / terrain.dem.file, origin, ground_needed(scenario), terrain.dem.unit)
    except DemError as problem:
        return scenario, [Mistake(("terrain", "dem", "file"), str(problem), terrain.dem.file)]
    return scenario.model_copy(update={"terrain": terrain.model_copy(update={"relief": relief})}), []


def _parsed(file: Path, text: str) -> dict[str, Any]:
    """The content of a TOML file, or of a JSON file that a program wrote."""
    try:
        data = read_json(text) if file.suffix == ".json" else _from_toml(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(_syntax(file, text, error), hint="correct the line; the file is TOML 1.0") from None
    except json.JSONDecodeError as error:
        raise ScenarioError(f"{file}:{error.lineno}: not JSON: {error.msg}", hint="correct the line") from None
    except ValueError as error:  # a number of thousands of digits, for example
        raise ScenarioError(f"{file}: cannot be read: {error}", hint="correct the file") from None
    if not isinstance(data, dict):
        raise ScenarioError(f"{file}: holds {type(data).__name__}, not tables", hint="name a scenario")
    return data


def _from_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text. Raises ValueError, also for what would take `tomllib` minutes."""
    if found := _LONG_KEY.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise ValueError(f"line {line}: a key of more than {_PARTS_MAX} parts")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("lists or tables are nested too deeply") from None


def scenario_file(path: Path) -> Path:
    """The scenario file of a folder or path. Raises ScenarioError, with the missions found nearby."""
    try:
        is_folder, is_there = path.is_dir(), path.exists()
    except (OSError, ValueError):  # a name that is too long; a NUL byte
        raise ScenarioError(f"{str(path)!r} is not a path", hint="name a mission folder") from None
    if is_folder:
        if (path / FILE_NAME).is_file():
            return path / FILE_NAME
        raise ScenarioError(f"{path} has no {FILE_NAME}", hint=_missions_near(path))
    if is_there:
        return path
    raise ScenarioError(f"there is no mission at {path}", hint=_missions_near(path))


def _missions_near(path: Path) -> str:
    places = (path, path.parent, Path("missions"))
    found = dict.fromkeys(file.parent for place in places for file in sorted(place.glob(f"*/{FILE_NAME}")))
    if not found:
        return f"name a folder with a {FILE_NAME}, or a scenario file"
    return f"missions nearby: {', '.join(str(folder) for folder in found)}"


def _read(file: Path) -> str:
    kind = SCENARIO_JSON if file.suffix == ".json" else SCENARIO_TOML
    try:
        return read_file(file, kind, error=ScenarioError, hint="check the path and its permissions").decode()
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise ScenarioError(f"{file}:{line}: not UTF-8 text", hint="save the file as UTF-8") from None


def _syntax(file: Path, text: str, error: tomllib.TOMLDecodeError) -> str:
    what = str(error)
    place = re.search(r" \(at (?:line (\d+), column \d+|end of document)\)$", what)
    line = place[1] if place and place[1] else len(text.splitlines())
    return f"{file}:{line}: not TOML: {what[: place.start()] if place else what}"


def _sound_tables(data: dict[str, Any]) -> dict[str, Any]:
    """The tables that are valid in themselves, and the defaults of tables left out."""
    sound = {}
    for name, field in Scenario.model_fields.items():
        if name not in data:
            if not field.is_required():
                sound[name] = field.default
            continue
        try:
            sound[name] = TypeAdapter[Any](field.annotation or Any).validate_python(data[name])
        except ValidationError:
            continue
    return sound


def _all_at_once(file: Path, text: str, mistakes: list[Mistake]) -> ScenarioError:
    lines = {} if file.suffix == ".json" else key_lines(text)
    placed = sorted(((line_of(lines, mistake.key) or 0), str(mistake)) for mistake in mistakes)
    listed = [f"{file}:{line}: {sentence}" if line else f"{file}: {sentence}" for line, sentence in placed]
    if len(listed) > 1:
        listed.insert(0, f"{file} has {len(mistakes)} mistakes")
    return ScenarioError("\n".join(listed), hint="`gcs schema` prints every key with its unit and range")
