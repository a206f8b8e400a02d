"""`gcs new`: a scenario to begin with, which plans as it is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.console import Screen
from gcs.cli.shared_options import DebugOption, JsonOption

_HOME = (-35.363262, 149.165237, 584.0)  # where ArduPilot's simulators are at home


def new(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Folder to make; its last part is the name.", show_default=False)
    ],
    at: Annotated[
        tuple[float, float, float],
        typer.Option("--at", metavar="LAT LON ALT", help="Origin: degrees, degrees, m above the sea."),
    ] = _HOME,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Write a scenario with an example of everything, commented, that plans at once.

    Example: gcs new missions/first --at 47.3977 8.5456 488
    """
    screen = Screen(json=json)
    from gcs.errors import UsageError
    from gcs.files import atomic_write
    from gcs.scenario.load import FILE_NAME
    from gcs.scenario.template import scenario_text

    file = folder / FILE_NAME
    if file.exists():
        raise UsageError(f"{file} exists already.", hint="choose another name, or delete it first")
    atomic_write(file, scenario_text(folder, *at))
    screen.say(f"wrote {file}")
    screen.say(f"next: gcs plan {folder}")
    screen.result({"scenario": file})
