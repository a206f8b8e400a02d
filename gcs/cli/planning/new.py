"""`gcs new`: write a first scenario, which plans as it is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.console import Screen
from gcs.cli.shared_options import DebugOption, JsonOption

_ORIGIN = (-35.363262, 149.165237, 584.0)  # the default home of ArduPilot's simulators


def new(
    folder: Annotated[
        Path,
        typer.Argument(metavar="FOLDER", help="Folder to make. Its last part names the scenario.", show_default=False),
    ],
    at: Annotated[
        tuple[float, float, float],
        typer.Option("--at", metavar="LAT LON ALT", help="Origin: degrees, degrees, m above mean sea level."),
    ] = _ORIGIN,
    full: Annotated[bool, typer.Option("--full", help="Write every table, with comments.")] = False,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Write a short scenario that plans at once.

    Examples: gcs new plans/first

    gcs new plans/first --at 47.3977 8.5456 488 --full
    """
    screen = Screen(json=json)
    from gcs.errors import UsageError
    from gcs.files import atomic_write
    from gcs.scenario.load import FILE_NAME
    from gcs.scenario.template import scenario_text

    file = folder / FILE_NAME
    if file.exists():
        raise UsageError(f"{file} exists already.", hint="choose another name, or delete the file first")
    atomic_write(file, scenario_text(folder, *at, full=full))
    screen.say(f"wrote {file}")
    screen.say(f"next: gcs plan {folder}")
    screen.result({"scenario": file})
