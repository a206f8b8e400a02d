"""Parts of several pictures: colours, the ground from above, a formation on it.

Flights of these missions go north, and pages are wider than high: maps have north to the right and east down.
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial.distance import pdist, squareform

from gcs.scenario.environment.no_fly import outline
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array

COLOURS = ("#d62728", "#1f77b4", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf", "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22")
LIMIT = "#b00000"  # what a limit is drawn in
ASIDE = "#777777"
_GRID = 201
_BANDS = 9
_DPI = 110


def save(figure: Figure, path: Path) -> Path:
    """Write a picture."""
    figure.savefig(path, dpi=_DPI)
    return path


def colour(row: int) -> str:
    """A vehicle's colour, by its row."""
    return COLOURS[row % len(COLOURS)]


def chain_lines(places_ned_m: Array) -> tuple[Array, Array]:
    """Every vehicle joined to one beside it, with as little line as can be: north and east (3 E,) with gaps."""
    tree = minimum_spanning_tree(squareform(pdist(places_ned_m))).tocoo()
    lines = np.full((tree.nnz, 3, 2), np.nan)
    lines[:, 0], lines[:, 1] = places_ned_m[tree.row, :2], places_ned_m[tree.col, :2]
    north, east = lines.reshape(-1, 2).T
    return north, east


def draw_ground(axes: Any, scenario: Scenario) -> Any:
    """Heights in bands, no-fly zones, and where the ground is too high to be passed under the ceiling."""
    limits = scenario.limits
    lines = (np.linspace(*limits.north_m, _GRID), np.linspace(*limits.east_m, _GRID))
    north, east = np.meshgrid(*lines, indexing="ij")
    ground = ground_height_m(scenario.terrain, north, east)
    bands = axes.contourf(north, east, ground, levels=_BANDS, cmap="YlOrBr", alpha=0.75)
    passable_m = limits.height_m[1] - limits.clearance_min_m
    if ground.max() > passable_m:
        axes.contour(north, east, ground, levels=[passable_m], colors=LIMIT, linewidths=1.2)
        axes.plot([], [], color=LIMIT, lw=1.2, label=f"ground above {passable_m:g} m: too high under the ceiling")
    for number, zone in enumerate(scenario.no_fly):
        label = "no-fly zones" if number == 0 else None
        axes.add_patch(Polygon(np.array(outline(zone).exterior.coords), color=LIMIT, alpha=0.3, label=label))
    for area in scenario.keep_in:
        axes.add_patch(Polygon(area.polygon_m, fill=False, ec="#1b7837", lw=1.4, label="keep-in area"))
    axes.set(xlim=limits.north_m, ylim=limits.east_m[::-1], aspect="equal", xlabel="north, m", ylabel="east, m")
    return bands
