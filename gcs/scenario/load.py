"""From a mission folder or file to a `Scenario`, or to one error that lists everything wrong with it.

Knows: files, TOML and JSON, the order in which mistakes are told. Does not know: what the keys mean.
"""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from gcs.errors import ScenarioError
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.si import ground_needed, local_origin
from gcs.scenario.validation.cross_table import check
from gcs.scenario.validation.mistakes import Mistake, from_pydantic
from gcs.scenario.validation.toml_lines import key_lines, line_of
from gcs.scenario.validation.vehicle_rules import RULES
from gcs.scenario.vehicle_types import KEY, VehicleFile, presets, vehicle_file, with_vehicle

FILE_NAME = "scenario.toml"


def load_scenario(path: Path | str) -> Scenario:
    """The scenario in a mission folder or scenario file.

    Raises ScenarioError: one line for each mistake with file, line, key, value and what is allowed.
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
    """A vehicle file, checked for physical sense. Raises ScenarioError like `load_scenario`."""
    if not file.is_file():
        known = ", ".join(presets())
        raise ScenarioError(
            f"there is no vehicle type {file.name}: no file {file}",
            hint=f"presets are {known}; the path of a vehicle file is taken from the scenario's folder",
        )
    text = _read(file)
    try:
        kind = VehicleFile.model_validate(_parsed(file, text))
    except ValidationError as error:
        raise _all_at_once(file, text, from_pydantic(error, VehicleFile)) from None
    alone = Scenario.model_construct(None, vehicle=kind.vehicle, limits=kind.limits)
    if mistakes := RULES.broken(alone, ("vehicle", "limits")):
        raise _all_at_once(file, text, mistakes)
    return kind


def _with_relief(scenario: Scenario, folder: Path) -> tuple[Scenario, list[Mistake]]:
    """The scenario with the heights of its elevation model, or why there are none."""
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
    """TOML, as people write it; or JSON, as programs hand a scenario on."""
    try:
        if file.suffix == ".json":
            data: dict[str, Any] = json.loads(text)
            return data
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(_syntax(file, text, error), hint="mend the line; the file is TOML 1.0") from None
    except json.JSONDecodeError as error:
        raise ScenarioError(f"{file}:{error.lineno}: not JSON: {error.msg}", hint="mend the line") from None


def scenario_file(path: Path) -> Path:
    """The scenario file that a folder or file names. Raises ScenarioError with the missions found nearby."""
    if path.is_dir():
        if (path / FILE_NAME).is_file():
            return path / FILE_NAME
        raise ScenarioError(f"{path} has no {FILE_NAME}", hint=_missions_near(path))
    if path.exists():
        return path
    raise ScenarioError(f"there is no mission at {path}", hint=_missions_near(path))


def _missions_near(path: Path) -> str:
    places = (path, path.parent, Path("missions"))
    found = dict.fromkeys(file.parent for place in places for file in sorted(place.glob(f"*/{FILE_NAME}")))
    if not found:
        return f"name a folder that holds a {FILE_NAME}, or such a file"
    return f"missions nearby: {', '.join(str(folder) for folder in found)}"


def _read(file: Path) -> str:
    try:
        return file.read_bytes().decode()
    except OSError as error:
        raise ScenarioError(f"cannot read {file}: {error.strerror}", hint="check the path and its rights") from None
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise ScenarioError(f"{file}:{line}: not UTF-8 text", hint="save the file as UTF-8") from None


def _syntax(file: Path, text: str, error: tomllib.TOMLDecodeError) -> str:
    what = str(error)
    place = re.search(r" \(at (?:line (\d+), column \d+|end of document)\)$", what)
    line = place[1] if place and place[1] else len(text.splitlines())
    return f"{file}:{line}: not TOML: {what[: place.start()] if place else what}"


def _sound_tables(data: dict[str, Any]) -> dict[str, Any]:
    """The tables that are valid in themselves, with the defaults of those left out."""
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
    told = [f"{file}:{line}: {sentence}" if line else f"{file}: {sentence}" for line, sentence in placed]
    if len(told) > 1:
        told.insert(0, f"{file} has {len(mistakes)} mistakes")
    return ScenarioError("\n".join(told), hint="`gcs schema` prints every key with its unit and range")
