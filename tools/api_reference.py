"""docs/api.md, the public Python API, from signatures and docstrings; `tools/reference.py` writes it."""

import dataclasses
import inspect
import re
from collections.abc import Callable, Iterator
from typing import Any

import gcs
from gcs.errors import GcsError
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array
from tools.markdown import rows

CHAPTERS = {
    "Scenario": ("load_scenario", "with_keys", "Scenario", "NoFlyZone"),
    "Plan": (
        "make_plan",
        "MeshRound",
        "ObjectiveTerm",
        "Plan",
        "save_plan",
        "load_plan",
        "cost_terms",
        "CostTerm",
        "Replanner",
        "Avoid",
        "Scale",
        "Reshape",
        "FlyHome",
        "Slower",
        "Hold",
        "GoTo",
        "GoOn",
        "plan_return",
        "prepare_returns",
        "PreparedReturns",
        "PreparedReturn",
        "load_returns",
        "NamedStates",
    ),
    "Verify": ("verify", "Report", "Check", "wind_envelope", "WindEnvelope", "WindBorder"),
    "Prove trajectories": (
        "plan_tracks",
        "prove",
        "TrackLimits",
        "TrackReport",
        "BreakOff",
        "UnsafeSpan",
        "TrackCheck",
        "read_tracks",
        "ReadTracks",
        "PolynomialTrack",
    ),
    "Export": (
        "export",
        "Format",
        "Content",
        "Autopilot",
        "Altitude",
        "ExportIndex",
        "VolumeOrder",
        "build_missions",
        "TimedLegs",
        "VehicleMission",
        "build_stream",
        "SmoothPath",
        "SetpointStream",
    ),
    "Fleet": ("Connection",),
    "Fly": ("fly", "Emulated", "Flown", "Verdict", "Watcher"),
    "Read a flight": ("load_truth", "Truth", "load_record", "FlightReports"),
    "Errors": ("GcsError", "OutOfTime"),
}

_REMARK = re.compile(r"^    (\w+): [^#\n]+?  # (.+)$", re.M)


def api_reference() -> str:
    """Every public name, by chapter."""
    lines: list[str] = []
    for chapter, names in CHAPTERS.items():
        lines.append(f"## {chapter}\n")
        for name in names:
            lines += _entry(name, getattr(gcs, name))
    return "\n".join(lines)


def _entry(name: str, thing: Any) -> Iterator[str]:
    if not inspect.isclass(thing):
        yield f"### `gcs.{name}`\n\n```text\n{_call(name, thing)}\n```\n\n{inspect.getdoc(thing)}\n"
        return
    yield f"### `gcs.{name}`\n\n{inspect.getdoc(thing)}\n"
    if issubclass(thing, (Scenario, GcsError)):  # an error is caught, never made
        return
    if found := [*_fields(thing), *_members(thing)]:
        yield "| | |\n| --- | --- |\n" + rows(found)


def _fields(thing: type) -> Iterator[tuple[str, str]]:
    """What is kept, with its type and, where it may be left out, what it is then."""
    if not dataclasses.is_dataclass(thing):
        return
    said = dict(_REMARK.findall(inspect.getsource(thing)))
    for field in dataclasses.fields(thing):
        if field.name.startswith("_"):
            continue
        default = "" if field.default is dataclasses.MISSING else f" = {_value(field.default)}"
        remark = f"; {said[field.name]}" if field.name in said else ""
        yield f"`{field.name}`", f"`{_type(field.type)}{default}`{remark}"


def _members(thing: type) -> Iterator[tuple[str, str]]:
    """Methods and properties with the first sentence of what they do."""
    for name, member in vars(thing).items():
        if name.startswith("_"):
            continue
        found = member.__func__ if isinstance(member, classmethod | staticmethod) else member
        if isinstance(found, property):
            yield f"`{name}`", _first(found)
        elif inspect.isfunction(found):
            yield f"`{_call(name, found)}`", _first(found)


def _first(thing: object) -> str:
    return " ".join((inspect.getdoc(thing) or "").split("\n\n")[0].split())


def _call(name: str, function: Callable[..., Any]) -> str:
    """How it is called: parameters with types and defaults, and what comes back."""
    words, signature = list[str](), inspect.signature(function)
    for parameter in signature.parameters.values():
        if parameter.name in ("self", "cls"):
            continue
        if parameter.kind is parameter.KEYWORD_ONLY and "*" not in words:
            words.append("*")
        type_ = "" if parameter.annotation is parameter.empty else f": {_type(parameter.annotation)}"
        default = "" if parameter.default is parameter.empty else f" = {_value(parameter.default)}"
        words.append(f"{parameter.name}{type_}{default}")
    returns = "" if signature.return_annotation is signature.empty else f" -> {_type(signature.return_annotation)}"
    return f"{name}({', '.join(words)}){returns}"


def _type(annotation: Any) -> str:
    """A type as it stands in the code, also where it was evaluated."""
    if isinstance(annotation, str):
        return annotation
    text = inspect.formatannotation(annotation).replace(inspect.formatannotation(Array), "Array")
    return re.sub(r"\b(?:\w+\.)+(?=[A-Z])", "", text)


def _value(default: Any) -> str:
    if isinstance(default, str):
        return repr(str(default))
    return repr(default) if default is None or isinstance(default, bool | int | float | tuple) else "..."
