"""The generated parts of docs: the reference pages, and the tables of other pages that are made from the code.

./tools/run python tools/reference.py
"""

import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gcs.cli.command_app import command_of
from gcs.cli.command_table import PANELS
from gcs.flight.contingency.detection import DETECTED
from gcs.flight.contingency.policy import ALL, MEANING, Row, State
from gcs.flight.contingency.policy_rows import KEEPS, POLICY
from gcs.flight.recording.tlog import FRAMES_MAX
from gcs.link.protocols.command import COMMAND
from gcs.link.protocols.machine import Table, Transition
from gcs.link.protocols.mission import rules as mission_rules
from gcs.link.protocols.mission.file_upload import FILE_UPLOAD
from gcs.link.protocols.mission.item_rewrite import REWRITE
from gcs.link.protocols.mission.receiver import RECEIVER
from gcs.link.protocols.mission.sender import SENDER
from gcs.link.protocols.mission.verified_upload import UPLOAD
from gcs.mission.drawings import xml_drawing
from gcs.mission.drawings.route_formats import ROUTE_FORMATS
from gcs.mission.formats.plan_items import ITEMS_MAX
from gcs.mission.formats.registry import FLEET, FORMATS, Content, Format
from gcs.mission.formats.vendor_quirks import QuirkKind
from gcs.plan.plan_file import ARRAYS
from gcs.scenario.schema.formation_table import Generator
from gcs.scenario.schema.heightmap import PIXELS_MAX
from gcs.scenario.schema.vehicle_types import scenario_schema
from gcs.scenario.values.formations import places_up_m
from gcs.util.atomic_write import atomic_write
from gcs.util.bounded_file import FILE_KINDS, JSON_VALUES_MAX, in_mib
from gcs.util.bounded_parquet import ROWS_MAX
from gcs.util.bounded_xml import XML_ELEMENTS_MAX
from tools.api_reference import api_reference
from tools.house import house
from tools.markdown import table

DOCS = Path(__file__).resolve().parent.parent / "docs"
MADE = re.compile(r"(^<!-- made by tools/reference\.py [^\n]*-->\n).*?(^<!-- end -->$|\Z)", re.M | re.S)
HIDDEN = {("Terrain", "relief")}  # passed between programs, never written by hand
TRANSITIONS = ("state", "event", "if", "next state", "sends", "rule")
RULES = ("incident", "in state", "if", "new state", "order", "rule")
Schema = dict[str, Any]


def scenario_reference() -> str:
    """Every key of a scenario file."""
    schema = scenario_schema()
    return "\n".join(["## Keys before the first table\n", *_section(schema, schema, "Scenario", "")])


def _section(schema: Schema, definition: Schema, name: str, path: str) -> list[str]:
    """One table and those below it."""
    rows = []
    below: list[str] = []
    for key, value in definition["properties"].items():
        if (name, key) in HIDDEN:
            continue
        forms = [name for form in definition.get("oneOf", ()) for name in form["required"]]
        required = key in (*definition.get("required", ()), *forms)
        what = value.get("description", "")
        target, many = _definition(value)
        if target is not None:
            inner = f"{path}.{key}".lstrip(".")
            heading = f"`[[{inner}]]`" if many else f"`[{inner}]`"
            below += [f"## {heading}\n", f"{schema['$defs'][target].get('description', '')}\n"]
            below += _section(schema, schema["$defs"][target], target, inner)
            if inner == "formation.shape":
                below.append(TEXT + "\n\n".join(f"```text\n{_side_by_side(row)}\n```" for row in SHAPES) + "\n")
            if not path:
                continue
            what = f"see {heading}"
        shown = f"**`{key}`**" if required else f"`{key}`"
        rows.append((shown, what, _values(value), _default(value, required)))
    return [table(("key", "what", "values", "if left out"), rows), *below]


def _definition(value: Schema) -> tuple[str | None, bool]:
    """Name of the table that a key holds, and whether there may be many of it."""
    if "$ref" in value:
        return value["$ref"].rpartition("/")[2], False
    if "$ref" in value.get("items", {}):
        return value["items"]["$ref"].rpartition("/")[2], True
    for choice in value.get("anyOf", ()):
        if "$ref" in choice:
            return choice["$ref"].rpartition("/")[2], False
    return None, False


def _values(value: Schema) -> str:
    """What may stand there, in a few words."""
    if "const" in value:
        return f"`{value['const']}`"
    if "enum" in value:
        return ", ".join(f'`"{one}"`' for one in value["enum"])
    if "anyOf" in value:
        return " or ".join(_values(one) for one in value["anyOf"] if one.get("type") != "null")
    if "$ref" in value or "$ref" in value.get("items", {}):
        return "table" if "$ref" in value else "tables"
    kind = value.get("type")
    if kind == "array":
        parts = value.get("prefixItems")
        if parts is None:
            return "list of " + _plural(_values(value["items"])).removeprefix("of ")
        texts = [_values(part) for part in parts]
        return f"{len(texts)} {_plural(texts[0])}" if len(set(texts)) == 1 else f"[{'; '.join(texts)}]"
    if kind in ("number", "integer"):
        return _range(value, "number" if kind == "number" else "whole number")
    return {"boolean": "`true`, `false`", "string": "text"}.get(str(kind), str(kind))


def _plural(text: str) -> str:
    """Of what `_values` says about one."""
    return text.replace("number", "numbers", 1) if text.startswith("number") else f"of [{text}]"


def _range(value: Schema, noun: str) -> str:
    low, above = value.get("minimum"), value.get("exclusiveMinimum")
    high, below = value.get("maximum"), value.get("exclusiveMaximum")
    words = [f"> {above:g}"] if above is not None else []
    words += [f"< {below:g}"] if below is not None else []
    if low is not None and high is not None:
        words.append(f"{low:g} to {high:g}")
    else:
        words += [f"at least {low:g}"] if low is not None else []
        words += [f"at most {high:g}"] if high is not None else []
    return " ".join([noun, ", ".join(words)]).strip()


def _default(value: Schema, required: bool) -> str:
    if required or "default" not in value or value["default"] is None:
        return ""
    default = value["default"]
    if isinstance(default, bool):
        return "`true`" if default else "`false`"
    if isinstance(default, str):
        return f'`"{default}"`'
    return "none" if default in ([], {}) or isinstance(default, dict) else f"`{default}`"


EVERYWHERE = ("debug", "json", "help")  # options of every command


def commands_reference() -> str:
    """Every command, by panel."""
    group: Any = command_of()
    parts: list[str] = []
    for panel in PANELS.values():
        commands = [command for command in group.commands.values() if command.rich_help_panel == panel]
        parts.append(f"## {panel}\n")
        parts += [_command(command) for command in commands]
    return "\n".join(parts)


def _command(command: Any) -> str:
    """One command: what it does, its arguments and options, its examples."""
    text, examples = split_help(inspect.cleandoc(command.help))
    arguments = [p for p in command.params if not p.opts[0].startswith("-")]
    options = [p for p in command.params if p.opts[0].startswith("-")]
    usage = " ".join([f"gcs {command.name}", *(p.metavar for p in arguments if p.metavar)])
    rows = [_option_row(p) for p in (*arguments, *options) if p.name not in EVERYWHERE]
    parts = [f"### `{usage}`", text]
    if rows:
        parts.append(table(("argument, option", "what", "if left out"), rows).rstrip())
    if not any(p.name == "json" for p in options):
        parts.append("It has no `--json`.")
    if examples:
        parts.append("```text\n" + "\n".join(examples) + "\n```")
    return "\n\n".join(parts) + "\n"


def split_help(help_text: str) -> tuple[str, list[str]]:
    """The description and the example lines of a docstring."""
    text, _, examples = help_text.partition("Example")
    lines = examples.removeprefix("s").removeprefix(":").splitlines()
    return text.strip(), [line.strip() for line in lines if line.strip()]


def _option_row(parameter: Any) -> tuple[str, str, str]:
    is_option = parameter.opts[0].startswith("-")
    name = ", ".join(parameter.opts) if is_option else parameter.metavar
    if is_option and not parameter.is_flag:
        name += f" {parameter.metavar or parameter.opts[0].strip('-').replace('-', '_').upper()}"
    return f"**`{name}`**" if parameter.required else f"`{name}`", parameter.help, _option_default(parameter)


def _option_default(parameter: Any) -> str:
    """The default as `--help` shows it; nothing for flags and for options without one."""
    if isinstance(parameter.show_default, str):
        return parameter.show_default
    if parameter.required or parameter.default in (None, False) or not parameter.show_default:
        return ""
    default = parameter.default
    return f"`{' '.join(map(str, default)) if isinstance(default, tuple) else default}`"


def policy_tables() -> str:
    """The contingency policy: its states, the incidents and the rules."""
    states = table(("state", "the vehicle"), ((state, MEANING[state]) for state in State))
    incidents = table(("incident", "detected by"), DETECTED.items())
    return "\n".join([states, incidents, table(RULES, (_rule(row) for row in POLICY if row.rule != KEEPS))])


def _rule(row: Row) -> tuple[str, ...]:
    states = "any" if row.states == ALL else ", ".join(state for state in State if state in row.states)
    return str(row.trigger), states, row.when.words, row.after or "", row.action or "", row.rule


MACHINES: dict[str, Table[Any]] = {
    "MissionSender": SENDER,
    "MissionReceiver": RECEIVER,
    "VerifiedUpload": UPLOAD,
    "FileUpload": FILE_UPLOAD,
    "ItemRewrite": REWRITE,
    "CommandSender": COMMAND,
}


def protocol_tables() -> tuple[str, ...]:
    """The transitions of each protocol machine, and the rules that their last column names."""
    parts = []
    for name, machine in MACHINES.items():
        parts.append(f"### {name}\n\n{table(TRANSITIONS, map(_transition, machine.rows))}")
    return "\n".join(parts), f"{mission_rules.__doc__}".partition("Rules\n")[2]


def _transition(row: Transition[Any]) -> tuple[str, ...]:
    states = ", ".join(state.name for state in row.states)
    return states, row.event, row.when.words if row.when else "", row.to.name if row.to else "", row.sends, row.rule


FILE_LIMITS = f"""
- JSON has at most {JSON_VALUES_MAX:,} values.
- A mission has at most {ITEMS_MAX:,} items.
- A drawn KMZ unpacks to at most {in_mib(xml_drawing.UNPACKED_MAX_BYTES)}. Drawn XML has at most {XML_ELEMENTS_MAX:,}
  elements, and no document type.
- Parquet has at most {ROWS_MAX:,} rows.
- An elevation model has at most {PIXELS_MAX:,} pixels where the scenario is, and blocks of at most 256 MiB.
- `gcs replay` takes at most {FRAMES_MAX:,} frames; `gcs report` takes any number.
"""


def formats_reference() -> tuple[str, ...]:
    """The tables of formats.md, in their order."""
    sizes = ((kind.name, in_mib(kind.largest_bytes)) for kind in FILE_KINDS)
    arrays = (
        (f"`{name}`", f"`{kind.dtype}`", str(kind.dimensions), in_mib(kind.largest_bytes))
        for name, kind in ARRAYS.items()
    )
    routes = ((" ".join(f"`{suffix}`" for suffix in row.suffixes), row.route) for row in ROUTE_FORMATS)
    contents = (
        (f"`{content.name}`", "each vehicle" if content.per_vehicle else "the formation", f"`{content}`")
        for content in Content
    )
    return (
        table(("name", "files", "what it is for", "content"), map(_format, FORMATS)),
        table(("files", "their route"), routes),
        "".join(f"- {kind}\n" for kind in QuirkKind),
        table(("file", "largest size"), sizes) + FILE_LIMITS,
        table(("array", "type", "dimensions", "largest size"), arrays),
        table(("content", "one file for", "type"), contents),
    )


def _format(row: Format) -> tuple[str, ...]:
    name = f"**`{row.name}`**" if row.default else f"`{row.name}`"
    stem = "uavN" if row.content.per_vehicle else FLEET
    files = " or ".join(f"`{stem}{suffix}`" for suffix in row.suffixes)
    return name, files, row.purpose, f"`{row.content.name}`"


SHAPES: tuple[tuple[tuple[Generator, int], ...], ...] = (
    (("line", 4), ("line", 5), ("column", 4)),
    (("vee", 5), ("triangle", 6), ("grid", 5), ("circle", 6)),
)
_ALONG, _ACROSS = 2, 5  # lines and characters of one spacing
_APART = 6  # characters between drawings

TEXT = """A generator makes places for any number of vehicles. The leader has the first place, the others follow in the
order of their system ids; the drawings have vehicle 1 as the leader. Their front is up: north, or `heading_deg`.

- `line`: abreast. Vehicles 2, 3, 4, ... stand by turns to the right and to the left of the leader. A line of an odd
  number is centred on the leader; an even one has one vehicle more on the right.
- `column`: one behind the other, in order.
- `vee`: two arms that fall back at 45 degrees, by turns on the right and on the left.
- `triangle`: rows of 1, 2, 3, ... behind the leader, each filled from left to right.
- `grid`: rows of equal length, as square as possible; each row is filled from its middle.
- `circle`: the leader in front, the others clockwise.
- `sphere`: the leader is the lowest.

"""


def drawing(generator: Generator, count: int) -> list[str]:
    """The lines of one drawing: vehicles by number, north up."""
    north, east, _ = places_up_m(generator, count, 1.0).T
    lines, columns = (north.max() - north) * _ALONG, (east - east.min()) * _ACROSS
    drawn = [[" "] * (round(columns.max()) + 1) for _ in range(round(lines.max()) + 1)]
    for number, (line, column) in enumerate(zip(lines, columns, strict=True), start=1):
        drawn[round(line)][round(column)] = str(number)
    return ["".join(line) for line in drawn]


def _side_by_side(row: tuple[tuple[Generator, int], ...]) -> str:
    blocks = [[f"{generator}, {count}", "", *drawing(generator, count)] for generator, count in row]
    height = max(map(len, blocks))
    lines = []
    for index in range(height):
        parts = []
        for block in blocks:
            width = max(map(len, block)) + _APART
            parts.append((block[index] if index < len(block) else "").ljust(width))
        lines.append("".join(parts).rstrip())
    return "\n".join(lines)


MAKERS: dict[str, Callable[[], str | tuple[str, ...]]] = {
    "scenario.md": scenario_reference,
    "api.md": api_reference,
    "commands.md": commands_reference,
    "formats.md": formats_reference,
    "flying.md": policy_tables,
    "links.md": protocol_tables,
    "design.md": house,
}


def page(name: str) -> str:
    """A page of docs with what stands after its marks, up to `<!-- end -->` or to its end, made anew."""
    text = (DOCS / name).read_text(encoding="utf-8")
    made = MAKERS[name]()
    parts = iter((made,) if isinstance(made, str) else made)
    text = MADE.sub(lambda mark: f"{mark[1]}\n{next(parts)}" + (f"\n{mark[2]}" if mark[2] else ""), text)
    if next(parts, None) is not None:
        raise ValueError(f"docs/{name} lacks a mark: <!-- made by tools/reference.py from ...; change that -->")
    return text


if __name__ == "__main__":
    for name in MAKERS:
        atomic_write(DOCS / name, page(name))
        print(DOCS / name)
