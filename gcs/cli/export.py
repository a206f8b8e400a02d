"""`gcs export`: a plan becomes files for other ground stations."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.console import BEGAN_S, Screen
from gcs.cli.options import DebugOption, JsonOption, MissionArgument, UnverifiedOption


def export(
    mission: MissionArgument,
    to: Annotated[Path, typer.Option("--to", help="Folder to write; an older export in it is replaced whole.")],
    smooth: Annotated[
        float | None,
        typer.Option("--smooth", metavar="METRES", help="Smooth the setpoints with a B-spline this near to the plan."),
    ] = None,
    unverified: UnverifiedOption = False,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Write .waypoints and .plan of every vehicle, and the timed setpoints of all.

    Example: gcs export missions/simulation1 --to out
    """
    screen = Screen(json=json)
    from gcs.cli.planning import Stopwatch, plan_for
    from gcs.mission.export import export as write

    watch = Stopwatch(BEGAN_S)
    watch.lap("start")
    plan, _ = plan_for(mission, screen, watch, unverified=unverified)
    index = write(plan, to, smooth_m=smooth)
    watch.lap("export")
    for name in index.sha256:
        screen.say(f"  {to / name}")
    screen.say(
        f"{index.waypoints} waypoints per vehicle; the polyline stays within {index.deviation.path_m:.3f} m of the "
        f"plan, and within {index.deviation.time_m:.3f} m at equal time"
    )
    if index.smoothing is not None:
        screen.say(
            f"smoothed setpoints keep the plan's limits within 1 %, at most {index.smoothing.deviation_m:.3f} m and "
            f"{index.smoothing.yaw_deviation_deg:.2f} degrees of yaw from the plan, at least "
            f"{index.smoothing.clearance_min_m:.3f} m above ground (knots every {index.smoothing.knots_every_s:g} s)"
        )
    screen.say(f"time: {watch}")
    screen.result(
        {
            "folder": to,
            "files": index.sha256,
            "plan_hash": index.plan_hash,
            "waypoints": index.waypoints,
            "smoothing": None if index.smoothing is None else asdict(index.smoothing),
        }
    )
    return 0
