"""The picture of a survey: its area, what the vehicles see of it, and what they miss."""

from pathlib import Path

import numpy as np
import shapely
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from gcs.errors import UsageError
from gcs.flight.plots import map_layers
from gcs.flight.plots.figure_file import BESIDE, Labels, Look, colours, head, save, settle
from gcs.flight.plots.flight_map import vehicle_entries
from gcs.flight.scene.ground_area import area_of
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.coverage import Coverage, coverage

_SEEN: Look = {"fc": "#2ca02c", "ec": "none", "alpha": 0.18}
_LEFT: Look = {"fc": "#ff00ff", "ec": "#a000a0", "alpha": 0.75}
_NAMED = 6  # places that are not covered and get a label


def save_coverage(plan: Plan, path: Path) -> None:
    """Draw the coverage of a plan's survey in the format of the file's ending. Raises UsageError."""
    found = coverage(plan)
    if found is None:
        raise UsageError(f"{plan.scenario.name} has no [survey].", hint="make one with gcs new NAME --survey AREA")
    save(draw_coverage(plan, found), path)


def draw_coverage(plan: Plan, found: Coverage) -> Figure:
    """Return the map of a survey."""
    scenario, span_s = plan.scenario, (0.0, plan.flight_s)
    places = shapely.get_coordinates([found.tracks, found.area])
    low, high = area = area_of(scenario, np.column_stack([places, np.zeros(len(places))]))
    width_in, height_in = map_layers.map_size_in(scenario, area)
    figure, axes = plt.subplots(figsize=(width_in, height_in), layout="constrained")
    map_layers.draw_ground(axes, scenario, area)
    map_layers.draw_zones(axes, scenario, span_s)
    map_layers.fill(axes, found.covered, **_SEEN)
    map_layers.fill(axes, found.uncovered, zorder=3, **_LEFT)
    for colour, track in zip(colours(plan.sysids), found.tracks.geoms, strict=True):
        north_m, east_m = shapely.get_coordinates(track).T
        axes.plot(east_m, north_m, color=colour, lw=1.0)
    axes.set(xlabel="east, m", ylabel="north, m", aspect="equal", xlim=(low[1], high[1]), ylim=(low[0], high[0]))
    handles = [
        *vehicle_entries(plan.sysids),
        Patch(**_SEEN, label=f"seen, swath {found.swath_m:g} m"),
        Patch(**_LEFT, label="not covered"),
        *map_layers.layer_entries(axes, scenario),
    ]
    axes.legend(handles=handles, **BESIDE)
    percent = int(1e3 * found.share) / 10.0
    head(
        axes,
        f"{scenario.name}: {percent:g} % of {found.area.area / 1e4:.2f} ha covered",
        width_in - map_layers.BESIDE_IN,
    )
    settle(figure)
    labels = Labels(figure)
    for gap in found.gaps()[:_NAMED]:
        labels.place(axes, f"{gap.area_m2:.3g} m²", (gap.east_m, gap.north_m))
    map_layers.label_zones(axes, labels, scenario, span_s)
    return figure
