"""The reference pages are what the code makes of them, and tell all that there is."""

from __future__ import annotations

import inspect
import re
import shlex
import sys
from pathlib import Path
from typing import Any

import gcs
from gcs.cli.command_app import command_of
from gcs.scenario.schema.scenario import Scenario
from tools.api_reference import CHAPTERS
from tools.reference import MAKERS, page, scenario_reference, split_help


def test_the_pages_are_up_to_date(repo_root: Path) -> None:
    for name in MAKERS:
        told = (repo_root / "docs" / name).read_text(encoding="utf-8")
        assert told == page(name), f"docs/{name}: run ./tools/run python tools/reference.py"


def test_every_command_has_a_sentence_and_examples_that_its_options_take() -> None:
    group: Any = command_of()
    for name, command in group.commands.items():
        text, examples = split_help(inspect.cleandoc(command.help))
        first = text.split("\n\n")[0]
        assert first.endswith(".") and "\n" not in first, name
        assert examples, name
        for example in examples:
            program, called, *arguments = shlex.split(example.partition(" >")[0])
            assert (program, called) == ("gcs", name)
            command.make_context(name, arguments)  # raises for an unknown option


def test_every_public_name_is_told_once() -> None:
    assert sorted(name for names in CHAPTERS.values() for name in names) == gcs.__all__


def test_a_class_that_a_public_function_takes_is_public() -> None:
    asked = {}
    for function in (inspect.unwrap(getattr(gcs, name)) for name in gcs.__all__ if name.islower()):
        taken = " ".join(str(parameter.annotation) for parameter in inspect.signature(function).parameters.values())
        known = vars(sys.modules[function.__module__])
        asked |= {word: known.get(word) for word in re.findall(r"\w+", taken)}
    ours = {word for word, kind in asked.items() if inspect.isclass(kind) and kind.__module__.startswith("gcs.")}
    assert {"Plan", "Format", "TimedLegs"} <= ours <= set(gcs.__all__)


def test_every_key_is_there_with_its_meaning() -> None:
    rows = [line.split(" | ") for line in scenario_reference().splitlines() if line.startswith(("| **`", "| `"))]
    keys = {row[0].strip("|* `") for row in rows}
    top = {name for name, field in Scenario.model_fields.items() if field.annotation in (str, int)}
    assert top <= keys
    assert {"flight_s", "mass_kg", "polygon_m", "offsets_m", "assignment", "dem", "file", "shear"} <= keys
    assert "relief" not in keys
    assert [row[0] for row in rows if not row[1].strip()] == []
