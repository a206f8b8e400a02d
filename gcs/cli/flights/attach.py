"""`gcs attach`: resume control of a flight whose ground station ended."""

from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.shared import shared_options as shared
from gcs.cli.shared.console import Screen
from gcs.errors import UsageError


def attach(
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="FOLDER",
            help="Folder of the flight.",
            show_default="the newest unfinished one",
            autocompletion=shared.flights,
        ),
    ] = None,
    land: Annotated[bool, shared.option("Land every vehicle where it is.", "--land")] = False,
    home: Annotated[bool, shared.option("Return all vehicles (RTL) at staggered altitudes.", "--return")] = False,
    resume: Annotated[bool, shared.option("Fly the remaining plan.", "--resume")] = False,
    link: shared.LinkOption = None,
    signing_key_file: shared.KeyOption = None,
    also_to: shared.AlsoToOption = None,
    to: Annotated[Path, shared.option("Folder that holds the folders of flights.")] = Path("flights"),
    json: shared.JsonOption = False,
    debug: shared.DebugOption = False,
) -> int:
    """Find a flight whose `gcs fly` was killed, show its vehicles, and land, return or resume it.

    Without --land, --return or --resume it only shows the vehicles. The default links are those of the flight. Exit
    status 0 when all vehicles have landed, or were shown.

    Examples: gcs attach

    gcs attach --land
    """
    if land + home + resume > 1:
        raise UsageError("--land, --return and --resume exclude each other", hint="give one of them")
    from gcs.cli.flights.attach_view import AttachRequest, take_up
    from gcs.flight.execution.resume import Resume
    from gcs.flight.recording.flight_state import newest_unfinished

    what = Resume.LAND if land else Resume.RETURN if home else Resume.RESUME if resume else Resume.SHOW
    screen = Screen(json=json)
    watched_at = shared.watchers(also_to, link)
    found = folder or newest_unfinished(to, screen.warn)
    return take_up(AttachRequest(found, what, tuple(link or ()), signing_key_file, screen, watched_at))
