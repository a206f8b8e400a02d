"""Loads a mission folder or file as a `Scenario`, or raises one error that lists all its mistakes by line."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from gcs.errors import ScenarioError
from gcs.scenario.schema.fields import Part
from gcs.scenario.schema.mistake import Mistake, Mistaken, dotted, nearest, value_at
from gcs.scenario.schema.scenario import AT_START, Scenario
from gcs.scenario.schema.toml_lines import Key, Table, key_lines, line_of
from gcs.scenario.schema.vehicle_types import KEY, VehicleFile, preset_file, presets, vehicle_file, with_vehicle
from gcs.scenario.sources.bundled_missions import FILE_NAME, bundled_mission, bundled_names
from gcs.scenario.sources.geozone_tables import as_entry, with_geozones
from gcs.scenario.validation.cross_table import check
from gcs.scenario.validation.ground_heights import (
    above_ground,
    in_ground_keys,
    sound_above_ground,
    with_room_for_heights,
    without_ground_heights,
)
from gcs.scenario.validation.schema_words import from_pydantic
from gcs.scenario.validation.slips import UNIT, Meant, as_meant
from gcs.scenario.validation.to_metres import in_degree_keys, in_metres
from gcs.scenario.validation.vehicle_rules import RULES
from gcs.scenario.values.si import ground_needed, local_origin, with_changes_of_route
from gcs.util.bounded_file import SCENARIO_JSON, SCENARIO_TOML, SHEETS, read_file, read_json

_PARTS_MAX = 64  # of a dotted key: tomllib takes the square of their number
_LONG_KEY = re.compile(rf"""(?<![\w"'-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{_PARTS_MAX}}}""")
_SLIPS_MAX = 20  # corrected in one file
_TEXT_MAX, _LINE_MAX = 200_000, 2_000  # characters of what a person wrote
_PLACE = re.compile(r" \(at (?:line (\d+), column \d+|end of document)\)$")
_TWICE = re.compile(r"Cannot declare \((.*?),?\) twice")
_TEXT_OR_REMARK = re.compile(r"""("(?:[^"\\\n]|\\.)*"|'[^'\n]*'|#[^\n]*)""")
_VALUE, _AFTER = r"(?<=[=\[,])(\s*)", r"(?=\s*(?:[,}\]\0]|$))"
_TRUTH, _TRUE = "{} is not a value of TOML", "write %s, in lower case, without quotes"
_BARE = rf"{_VALUE}(?!(?:true|false|inf|nan)\b)([A-Za-z][\w-]*){_AFTER}"
_SLIPS = [  # what is looked for in a line, what was meant, and a sentence where the value does not show that
    (r"^(\s*)([\w.-]+)\s*:\s+(?=\S)", r"\1\2 = ", "a colon stands after {}", "write {} = ..."),
    (rf"(?<![\w.:])()([-+]?[0-9][0-9_]*(?:\.[0-9]+)?\s*(?:{UNIT})|[0-9]+:[0-9]+)(?![\w/²^:-])", r'\1"\2"', "", ""),
    (r"^(\s*[\w.-]+\s*=\s*)([-+]?[0-9]+,[0-9]+)(?=\s*(?:\0|$))", r'\1"\2"', "", ""),
    (rf"{_VALUE}(True|TRUE|[Yy]es){_AFTER}", r"\1true", _TRUTH, _TRUE % "true"),
    (rf"{_VALUE}(False|FALSE|[Nn]o){_AFTER}", r"\1false", _TRUTH, _TRUE % "false"),
    (_BARE, r'\1"\2"', "the text {} stands without quotes", 'write "{}"'),
]
_WORDS = {  # what tomllib says, as this program says it
    "Cannot overwrite a value": ("this key stands twice in its table", "keep one of the two"),
    "Unclosed array": ("a list is not closed", "give the missing ]"),
    "Unclosed inline table": ("a table in one line is not closed", "give the missing }"),
    "Invalid value": ("no value of TOML stands here", "give a number, true, false, text in quotes or a list"),
    "Unterminated string": ("text is not closed", "give the missing quote"),
    "Expected '=' after a key in a key/value pair": ("a key has no value", "write key = value"),
    "Expected newline or end of document after a statement": ("something stands after the value", "remove it"),
}


def load_scenario(path: Path | str) -> Scenario:
    """The scenario in a mission folder or scenario file, or of a bundled mission by its bare name (`simulation1`).

    A folder or file of that name in the working directory comes first.

    Raises ScenarioError with one line for each mistake: file, line, key, value and what is allowed.
    """
    file = scenario_file(Path(path))
    text = _read(file)
    meant = _meant(file, text, Scenario, (KEY,))
    converted = in_metres(with_room_for_heights(meant.data))
    data, mistakes, elsewhere = converted.data, [*meant.mistakes], None
    mistakes += [one for one in converted.mistakes if not meant.follows(one)]
    meant = replace(meant, guessed=meant.guessed | converted.spoilt)
    try:
        types, of_type = _possible_types(data, file.parent)
        mistakes += of_type
    except ScenarioError as error:
        types, elsewhere = _stand_ins(), error
    certain = converted.certain
    judged = [_judged(with_vehicle(data, kind) if kind is not None else data, file.parent, certain) for kind in types]
    scenario, found = judged[0]
    # Where the type is unknown, only what holds for every type is a mistake.
    mistakes += [
        in_degree_keys(one, converted)
        for one in found
        if not meant.follows(one) and all(one in others for _, others in judged)
    ]
    if mistakes or elsewhere is not None or scenario is None:
        raise _error_report(file, mistakes, meant, elsewhere)
    return with_changes_of_route(scenario)


def with_keys(scenario: Scenario, **tables: Any) -> Scenario:
    """The scenario with other values of some keys, checked as a file is: `with_keys(s, time={"flight_s": 90.0})`.

    A table keeps the keys that are not named; lists and other values are replaced as a whole. Raises ScenarioError
    with every mistake.
    """

    def merged(old: Any, new: Any) -> Any:
        if not isinstance(new, dict) or not isinstance(old, dict):
            return new
        return old | {key: merged(old.get(key), value) for key, value in new.items()}

    every = with_room_for_heights(merged(without_ground_heights(scenario.model_dump()), tables))
    changed, mistakes = _judged(every, Path(), set())
    if mistakes or changed is None:
        raise _error_report(Path(f"scenario {scenario.name}, changed"), mistakes)
    return with_changes_of_route(changed)


def vehicle_type(vehicle: str | Path) -> VehicleFile:
    """A preset by its name, else the type of a vehicle file. Raises ScenarioError for a file with mistakes."""
    return _preset(str(vehicle)) if str(vehicle) in presets() else load_vehicle(Path(vehicle))


@cache
def _preset(name: str) -> VehicleFile:
    return load_vehicle(preset_file(name))


def load_vehicle(file: Path) -> VehicleFile:
    """The vehicle type of a file, checked by the rules of physics. Raises ScenarioError like `load_scenario`."""
    text = _read(file)
    meant = _meant(file, text, VehicleFile)
    mistakes = list(meant.mistakes)
    try:
        kind = VehicleFile.model_validate(meant.data)
        alone = Scenario.model_construct(None, vehicle=kind.vehicle, limits=kind.limits)
        mistakes += RULES.violated(alone, ("vehicle", "limits"))
    except ValidationError as error:
        mistakes += [one for one in from_pydantic(error, VehicleFile) if not meant.follows(one)]
    if mistakes:
        raise _error_report(file, mistakes, meant)
    return kind


def _possible_types(data: Table, folder: Path) -> tuple[list[VehicleFile | None], list[Mistake]]:
    """The type that a scenario names, or None for its own [vehicle]; all presets where its type is a mistake, and that.

    Raises ScenarioError with the mistakes of the vehicle's file.
    """
    known, wanted = presets(), data.get(KEY)
    if KEY not in data and "vehicle" in data:
        return [None], []
    if isinstance(wanted, str) and _is_file(file := vehicle_file(wanted, folder)):
        return [load_vehicle(file)], []
    if KEY not in data:
        names = ", ".join(f'"{name}"' for name in known)
        text = f"missing, and there is no table [vehicle]; it must be one of {names}, or the path of a vehicle file"
        step = f'add {KEY} = "{known[-1]}" above the first table'
    else:
        text, near = "must be text: the name of a vehicle type", None
        if isinstance(wanted, str):
            text, near = "is neither a vehicle type nor a file", nearest(wanted, known)
        step = f'write {KEY} = "{near}"' if near else f"name a preset ({', '.join(known)}), or a file"
        step += "; a path is relative to the scenario's folder"
    return _stand_ins(), [Mistake((KEY,), text, wanted, remedy=step)]


def _is_file(file: Path) -> bool:
    try:
        return file.is_file()
    except (OSError, ValueError):  # a name that is too long; a NUL byte
        return False


def _stand_ins() -> list[VehicleFile | None]:
    """The types with which a scenario is checked whose own type is unknown."""
    return [vehicle_type(name) for name in presets()]


def _judged(data: Table, folder: Path, certain: set[Key]) -> tuple[Scenario | None, list[Mistake]]:
    """The scenario of these tables, and its mistakes. `certain` keys were converted to metres."""
    data = {name: value for name, value in data.items() if name != KEY}
    if data.get("end") == AT_START and isinstance(start := data.get("start"), dict):
        data["end"] = {name: value for name, value in start.items() if name != "velocity_mps"}
    try:
        scenario = Scenario.model_validate(data)
    except ValidationError as error:
        sound = sound_above_ground(_sound_tables(data))
        return None, [*from_pydantic(error), *check(Scenario.model_construct(**sound), sound, certain)]
    scenario, lacking = _with_relief(scenario, folder)
    if not lacking:
        scenario, lacking = above_ground(scenario)
    rows = list(range(len(scenario.no_fly)))
    if not lacking:
        scenario, lacking, rows = with_geozones(scenario, folder)
    found = lacking or [in_ground_keys(one, scenario) for one in check(scenario, certain=certain)]
    return scenario, [as_entry(one, data, rows) for one in found]


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


def _meant(file: Path, text: str, model: type[Part], also: tuple[str, ...] = ()) -> Meant:
    """The tables of a TOML file, or of a JSON file that a program wrote, with the slips in them."""
    slips: list[Mistake] = []
    try:
        if file.suffix == ".json":
            data = read_json(text)
        else:
            data, text, slips = _read_toml(text)
    except tomllib.TOMLDecodeError as error:
        reason = _PLACE.sub("", str(error))
        words, step = _WORDS.get(reason, (reason, ""))
        if found := _TWICE.fullmatch(reason):
            name = re.sub(r"\W*, \W*", ".", found[1]).strip("'\" ")
            words, step = f"table [{name}] stands twice", "keep one, with the keys of both"
        mistake = Mistake((), f"not TOML: {words}", remedy=step, line=_line_at(text, error))
        raise _error_report(file, [mistake]) from None
    except json.JSONDecodeError as error:
        raise ScenarioError(f"{file}:{error.lineno}: not JSON: {error.msg}", hint="correct the line") from None
    except ValueError as error:  # a number of thousands of digits, for example
        raise ScenarioError(f"{file}: cannot be read: {error}", hint="correct the file") from None
    if not isinstance(data, dict):
        raise ScenarioError(f"{file}: holds {type(data).__name__}, not tables", hint="name a scenario")
    meant = as_meant(data, model, also) if file.suffix != ".json" else Meant(data)
    return replace(meant, text=text, mistakes=[*slips, *meant.mistakes])


def _read_toml(text: str) -> tuple[Table, str, list[Mistake]]:
    """The tables of a text, the text that was read, and the slips in it.

    Raises tomllib.TOMLDecodeError where it is not plain what was meant.
    """
    mistakes: list[Mistake] = []
    for _ in range(_SLIPS_MAX):
        try:
            return _from_toml(text), text, mistakes
        except tomllib.TOMLDecodeError as error:
            lines = text.split("\n")
            number = min(_line_at(text, error), len(lines))
            mended, found = _mended(lines[number - 1], number)
            if mended == lines[number - 1] or len(text) > _TEXT_MAX:
                raise
            mistakes += found
            lines[number - 1] = mended
            text = "\n".join(lines)
    return _from_toml(text), text, mistakes


def _line_at(text: str, error: tomllib.TOMLDecodeError) -> int:
    place = _PLACE.search(str(error))
    return int(place[1]) if place and place[1] else max(len(text.splitlines()), 1)


def _mended(line: str, number: int) -> tuple[str, list[Mistake]]:
    """A line as it was meant, and what was wrong with it where the value does not show that itself."""
    mistakes: list[Mistake] = []
    if len(line) > _LINE_MAX:
        return line, mistakes
    pieces = _TEXT_OR_REMARK.split(line)
    code = "".join(piece if n % 2 == 0 else f"\0{n}\0" for n, piece in enumerate(pieces))
    for pattern, right, text, step in _SLIPS:
        slips = [found[2] for found in re.finditer(pattern, code)] if text else []
        mistakes += [Mistake((), text.format(one), remedy=step.format(one), line=number) for one in slips]
        code = re.sub(pattern, right, code)
    return re.sub(r"\0(\d+)\0", lambda mark: pieces[int(mark[1])], code), mistakes


def _from_toml(text: str) -> Table:
    """The tables of a TOML text. Raises ValueError, also for what would take `tomllib` minutes."""
    if found := _LONG_KEY.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise ValueError(f"line {line}: a key of more than {_PARTS_MAX} parts")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("lists or tables are nested too deeply") from None


def scenario_file(path: Path) -> Path:
    """The scenario file of a folder, path or bundled mission. Raises ScenarioError, with the missions found nearby."""
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
    if bundled := bundled_mission(path):
        return bundled
    raise ScenarioError(f"there is no mission at {path}", hint=_missions_near(path))


def _missions_near(path: Path) -> str:
    places = (path, path.parent, Path("missions"))
    found = dict.fromkeys(file.parent for place in places for file in sorted(place.glob(f"*/{FILE_NAME}")))
    bundled = f"one that comes with Skein: {', '.join(bundled_names())}"
    if not found:
        return f"name a folder with a {FILE_NAME}, a scenario file, or {bundled}"
    return f"missions nearby: {', '.join(str(folder) for folder in found)}"


def _read(file: Path) -> str:
    kind = SCENARIO_JSON if file.suffix == ".json" else SCENARIO_TOML
    if file.suffix.lower() in SHEETS:
        text = f"{file}: is a sheet, not a scenario"
        raise ScenarioError(text, hint="save it as CSV, and make a scenario of it: gcs new NAME --positions FILE.csv")
    try:
        return read_file(file, kind, error=ScenarioError, hint="check the path and its permissions").decode()
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise ScenarioError(f"{file}:{line}: not UTF-8 text", hint="save the file as UTF-8") from None


def _sound_tables(data: Table) -> Table:
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
    if any(zone.file is not None for zone in sound.get("no_fly", ())):
        del sound["no_fly"]  # its zones are read once all tables are valid
    return sound


def _error_report(
    file: Path, mistakes: Sequence[Mistake], meant: Meant | None = None, elsewhere: ScenarioError | None = None
) -> Mistaken:
    """The error that tells every mistake of a file, after those of another file (its vehicle's)."""
    lines = {} if meant is None or file.suffix == ".json" else key_lines(meant.text)

    def line(one: Mistake) -> int:
        return one.line or line_of(lines, meant.in_file(one.key) if meant else one.key) or 0

    def sentence(one: Mistake, text: str) -> str:
        place = f"{file}:{line(one)}" if line(one) else str(file)
        is_absent = one.value is not None and meant is not None and value_at(meant.data, one.key) is None
        return f"{place}: {one.place}{' (not in this file)' * is_absent}: {text}" if one.key else f"{place}: {text}"

    alike: dict[tuple[int, Key, str], dict[str, Mistake]] = {}  # rows of one list with the same mistake
    for one in sorted(mistakes, key=lambda one: (line(one), str(one))):
        table = one.key[:-1] if one.key and isinstance(one.key[-1], int) else one.key
        alike.setdefault((line(one), table, one.whole), {})[str(one)] = one
    placed, listed = [], []
    for one, *others in (rows.values() for rows in alike.values()):
        placed.append(one)
        text = one.text if len(alike) == 1 and elsewhere is None else one.whole
        listed.append(sentence(one, text) + (f" (and {len(others)} more in this list)" if others else ""))
    if len(listed) > 1:
        listed.insert(0, f"{file} has {len(placed)} mistakes")
    if elsewhere is not None:
        return Mistaken("\n".join((elsewhere.message, *listed)), hint=elsewhere.hint, mistakes=placed)
    steps = [
        one.step or (f"change {dotted(one.key)}" if one.key else "correct the line; the file is TOML 1.0")
        for one in placed
    ]
    number = "both" if len(placed) == 2 else f"all {len(placed)}"
    hint = steps[0] if len({*steps}) == 1 else f"correct {number}; the first: {steps[0]}"
    return Mistaken("\n".join(listed), hint=hint, reason="\n".join(map(str, placed)), mistakes=placed)
