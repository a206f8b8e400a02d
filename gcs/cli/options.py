"""Arguments and options that commands share, so that they read the same everywhere.

Knows: names and help texts. Does not know: what commands do with them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

MissionArgument = Annotated[
    Path,
    typer.Argument(metavar="MISSION", help="Mission folder, scenario file or plan (.skein).", show_default=False),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout and nothing else there.")]
# `gcs.cli.main.run` reads it from the arguments, since those may be what is wrong; it is declared for --help.
DebugOption = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]
UnverifiedOption = Annotated[bool, typer.Option("--unverified", help="Use a plan although it does not hold.")]
UntimedOption = Annotated[
    bool,
    typer.Option(
        "--untimed",
        help="Missions ask for the plan's own speeds, which autopilots do not keep, instead of corrected ones.",
    ),
]
