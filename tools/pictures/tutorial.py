"""The pictures of docs/tutorial.md: what its own commands draw, and the exported missions on a map."""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from tools.pictures.scenery import LIMIT, colour, save

_BLOCK = re.compile(r"^```sh\n(?P<code>.*?)^```$", re.M | re.S)
_SETUP = "./tools/run "
_NAV_WAYPOINT, _NAV_LAND, _NAV_TAKEOFF = 16, 21, 22


def write_pictures(document: Path, folder: Path) -> Iterator[Path]:
    """Type the commands of the document in an empty folder and keep what they draw."""
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    with tempfile.TemporaryDirectory() as name:
        there = Path(name)
        for block in commands(document.read_text(encoding="utf-8")):
            subprocess.run(["sh", "-euc", block], cwd=there, env=environment, check=True)
        flight = max((there / "flights").iterdir())
        yield save(draw_exported(there / "out"), folder / "exported.png")
        for drawn in (*sorted(there.glob("plans/*.png")), flight / "map.png"):
            kept = folder / ("flown.png" if drawn.name == "map.png" else drawn.name)
            shutil.copy(drawn, kept)
            yield kept


def commands(text: str) -> list[str]:
    """The sh blocks of a document, without the set-up that stands before each command."""
    return [match["code"].replace(_SETUP, "") for match in _BLOCK.finditer(text)]


def draw_exported(folder: Path) -> Figure:
    """Waypoints of all `.plan` files, the fence of the first with its exclusions, and rally points."""
    figure = Figure(figsize=(4.6, 6.0), layout="constrained")
    axes: Any = figure.add_subplot()
    files = sorted(folder.glob("*.plan"))
    for row, file in enumerate(files):
        plan = json.loads(file.read_text(encoding="utf-8"))
        track = waypoints_deg(plan)
        axes.plot(track[:, 1], track[:, 0], ".-", color=colour(row), lw=1.0, ms=5, label=file.name)
        rally = np.array(plan["rallyPoints"]["points"]).reshape(-1, 3)
        axes.plot(rally[:, 1], rally[:, 0], "^", color=colour(row), mec="black", ms=7, zorder=4)
        if row == 0:
            _draw_fence(axes, plan["geoFence"], float(track[0, 0]))
    axes.plot([], [], "k^", ms=7, label="rally point")
    axes.plot([], [], color="black", lw=1.2, label="fence of uav1.plan")
    axes.set(xlabel="longitude, deg", ylabel="latitude, deg", title="exported missions")
    axes.set_aspect(1.0 / np.cos(np.radians(axes.get_ylim()[0])))
    axes.ticklabel_format(useOffset=False)
    axes.tick_params(axis="x", rotation=45)
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    return figure


def waypoints_deg(plan: dict[str, Any]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Latitudes and longitudes (N, 2) of takeoff, waypoints and landing of a `.plan` file."""
    places = (_NAV_TAKEOFF, _NAV_WAYPOINT, _NAV_LAND)
    return np.array([item["params"][4:6] for item in plan["mission"]["items"] if item["command"] in places])


def _draw_fence(axes: Any, fence: dict[str, Any], latitude_deg: float) -> None:
    """The polygon that vehicles must stay in, and the circles that they must stay out of."""
    for polygon in fence["polygons"]:
        inside = polygon["inclusion"]
        look: dict[str, Any] = {"fill": False, "ec": "black", "lw": 1.2} if inside else {"color": LIMIT, "alpha": 0.3}
        axes.add_patch(Polygon(np.array(polygon["polygon"])[:, ::-1], **look))
    for circle in fence["circles"]:
        latitude, longitude = circle["circle"]["center"]
        radius_deg = circle["circle"]["radius"] / 111_200.0
        turn = np.linspace(0.0, 2.0 * np.pi, 49)
        rim = np.column_stack(
            [
                longitude + radius_deg * np.cos(turn) / np.cos(np.radians(latitude_deg)),
                latitude + radius_deg * np.sin(turn),
            ]
        )
        axes.add_patch(Polygon(rim, color=LIMIT, alpha=0.3))
