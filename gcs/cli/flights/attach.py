"""`gcs attach`: take up a flight whose ground station is gone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.console import Screen
from gcs.cli.shared_options import DebugOption, JsonOption, KeyOption, LinkOption
from gcs.errors import UsageError


def attach(
    folder: Annotated[
        Path | None, typer.Argument(metavar="FOLDER", help="The flight's folder.", show_default="the last unfinished")
    ] = None,
    land: Annotated[bool, typer.Option("--land", help="Everybody lands where it is.")] = False,
    home: Annotated[bool, typer.Option("--return", help="Everybody goes home, staggered.")] = False,
    resume: Annotated[bool, typer.Option("--resume", help="Fly the rest of the plan.")] = False,
    link: LinkOption = None,
    signing_key_file: KeyOption = None,
    to: Annotated[Path, typer.Option("--to", help="Where flights leave their folders.")] = Path("flights"),
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Find a flight whose `gcs fly` was killed, show how its vehicles are, and land, return or resume it.

    Without one of the three it only looks. Links are the flight's own unless others are named. Exit
    status 0 once everybody is down, or was shown.

    Examples: gcs attach

    gcs attach --land
    """
    if land + home + resume > 1:
        raise UsageError("--land, --return and --resume exclude each other")
    from gcs.cli.flights.attach_view import AttachRequest, take_up
    from gcs.flight.recording.flight_state import newest_unfinished
    from gcs.flight.sequence.resume import Resume

    what = Resume.LAND if land else Resume.RETURN if home else Resume.RESUME if resume else Resume.SHOW
    return take_up(
        AttachRequest(folder or newest_unfinished(to), what, tuple(link or ()), signing_key_file, Screen(json=json))
    )
