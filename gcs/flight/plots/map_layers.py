"""Common layers of all maps: area, ground, zones, and the wind in the legend."""

from typing import Any

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch, Polygon, Rectangle
from matplotlib.path import Path as Shape
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Affine2D
from shapely.geometry.base import BaseGeometry

from gcs.flight.plots.figure_file import Labels, Look
from gcs.flight.scene.ground_area import Area, ground_grid, moving_s, outlines, route_labels
from gcs.scenario.environment.no_fly import zones
from gcs.scenario.schema.scenario import KeepIn, Scenario
from gcs.types import Array

DART = Shape([(0.0, 1.0), (0.6, -0.8), (0.0, -0.4), (-0.6, -0.8), (0.0, 1.0)])  # points north
_LEVEL_M = 0.1  # a lower relief is level ground
_BANDS = 10
_LARGEST_IN = (6.2, 6.2)  # width and height of a map
BESIDE_IN = 2.6  # its axis and its legend
_BELOW_IN, _COLOURS_IN = 0.85, 0.65  # its title and axis; the colours of heights
ZONE = "#c00000"
ROUTE = "#7b2d8e"
KEEP_IN = "#1b7837"
WIND = "#1f77b4"
ARROW = Shape(
    [(-0.12, -1.0), (0.12, -1.0), (0.12, 0.2), (0.5, 0.2), (0.0, 1.0), (-0.5, 0.2), (-0.12, 0.2), (-0.12, -1.0)]
)


def map_size_in(scenario: Scenario | None, area: Area) -> tuple[float, float]:
    """Return width and height, in inches, of a map that the area fills, with its axes and legend."""
    north_m, east_m = area[1] - area[0]
    inches = min(_LARGEST_IN[0] / east_m, _LARGEST_IN[1] / north_m)
    level = scenario is None or not len(levels_m(ground_grid(scenario, area)[2]))
    return float(inches * east_m) + BESIDE_IN, float(inches * north_m) + _BELOW_IN + (0.0 if level else _COLOURS_IN)


def levels_m(height_m: Array) -> Array:
    """Return round heights at which contour lines stand; none for level ground."""
    if np.ptp(height_m) <= _LEVEL_M:
        return np.empty(0)
    return np.asarray(MaxNLocator(_BANDS).tick_values(float(height_m.min()), float(height_m.max())))


def draw_ground(axes: Axes, scenario: Scenario, area: Area, *, scale: bool = True) -> None:
    """Draw heights of the ground in bands with contour lines, and the edge of the box of Eq. 51."""
    north, east, height = ground_grid(scenario, area)
    levels = levels_m(height)
    if len(levels):
        bands = axes.contourf(east, north, height, levels=levels, cmap="YlOrBr", alpha=0.7)
        axes.contour(east, north, height, levels=levels, colors="saddlebrown", linewidths=0.4, alpha=0.8)
        if scale:
            axes.figure.colorbar(bands, ax=axes, label="ground height, m", location="bottom", shrink=0.8, aspect=35)
    limits = scenario.limits
    corner, size = (limits.east_m[0], limits.north_m[0]), (np.ptp(limits.east_m), np.ptp(limits.north_m))
    box = Rectangle(corner, *size, fill=False, ec="0.45", ls=(0, (6, 4)), lw=0.9)
    if not _hidden(area, limits.north_m, limits.east_m):
        box.set_label("limits of the scenario")
    axes.add_patch(box)


def draw_zones(axes: Axes, scenario: Scenario, span_s: tuple[float, float]) -> None:
    """Draw the area of a survey, edges of keep-in areas, and no-fly zones.

    A moving zone is drawn where it is at both ends of a span, with its way.
    """
    if scenario.survey is not None:
        fill(axes, scenario.survey.area, fill=False, ec="black", lw=1.4, zorder=2.5, label="survey area")
        holes = shapely.union_all([hole.area for hole in scenario.survey.hole])
        fill(axes, holes, fc="#7fb2d9", ec="none", alpha=0.6, zorder=1.4, label="left out of the survey")
    for zone in zones(scenario):
        first, *later = outlines(zone, span_s)
        if isinstance(zone, KeepIn):
            axes.add_patch(Polygon(first[:, ::-1], fill=False, ec=KEEP_IN, lw=1.4, zorder=1.6))
            continue
        axes.add_patch(Polygon(first[:, ::-1], fc=ZONE, ec=ZONE, alpha=0.3, zorder=1.5))
        axes.add_patch(Polygon(first[:, ::-1], fill=False, ec=ZONE, lw=1.0, zorder=1.6))
        for corners in later:
            axes.add_patch(Polygon(corners[:, ::-1], fc=ZONE, ec="none", alpha=0.12, zorder=1.5))
            axes.add_patch(Polygon(corners[:, ::-1], fill=False, ec=ZONE, lw=1.0, ls="--", zorder=1.6))
            end, start = ((float(east), float(north)) for north, east in (corners.mean(axis=0), first.mean(axis=0)))
            arrow = {"arrowstyle": "-|>", "color": ZONE, "lw": 1.0, "shrinkA": 0.0, "shrinkB": 0.0}
            axes.annotate("", end, start, arrowprops=arrow, zorder=1.7, annotation_clip=True)


def fill(axes: Axes, shape: BaseGeometry, **look: Any) -> None:
    """Fill polygons (north, east) with their holes."""
    rings = [
        ring
        for part in shapely.get_parts(shapely.orient_polygons(shape))
        if isinstance(part, shapely.Polygon)
        for ring in (part.exterior, *part.interiors)
    ]
    if rings:
        paths = [Shape(np.array(ring.coords)[:, 1::-1], closed=True) for ring in rings]
        axes.add_patch(PathPatch(Shape.make_compound_path(*paths), **look))


def draw_route(axes: Axes, scenario: Scenario) -> list[Line2D]:
    """Draw the route points, and return their entry for the legend; nothing without a route."""
    if not scenario.route:
        return []
    north_m, east_m, _ = np.array([point.position_m for point in scenario.route]).T
    look: Look = {"ls": "", "marker": "D", "ms": 6, "mfc": "none", "mec": ROUTE, "mew": 1.4, "zorder": 6.5}
    return list(axes.plot(east_m, north_m, label="route point", **look))


def label_route(axes: Axes, labels: Labels, scenario: Scenario) -> None:
    """Write beside each route point how it is called."""
    places = [(point.position_m[1], point.position_m[0]) for point in scenario.route]
    if places:
        labels.avoid_points(axes, places)
    for place, text in zip(places, route_labels(scenario), strict=True):
        labels.place(axes, text.replace("$", r"\$"), place, color=ROUTE, fontweight="bold")


def label_zones(axes: Axes, labels: Labels, scenario: Scenario, span_s: tuple[float, float]) -> None:
    """Write beside a moving zone when it is where."""
    for zone in scenario.no_fly:
        places = outlines(zone, span_s)
        if len(places) > 1:
            for corners, t_s in zip(places, moving_s(zone, span_s), strict=True):
                north, east = corners.mean(axis=0)
                labels.place(axes, f"zone at {t_s:.0f} s", (float(east), float(north)), color=ZONE)


def zone_entry(scenario: Scenario) -> list[Polygon]:
    """Return no-fly zones and keep-in areas for a legend; nothing where there are none."""
    zone = Polygon([(0.0, 0.0)], fc=ZONE, ec=ZONE, alpha=0.3, label="no-fly zone")
    area = Polygon([(0.0, 0.0)], fill=False, ec=KEEP_IN, lw=1.4, label="keep-in area")
    return [zone] * bool(scenario.no_fly) + [area] * bool(scenario.keep_in)


def layer_entries(axes: Axes, scenario: Scenario) -> list[Artist]:
    """Return zones, limits and wind for the legend of a map that has them."""
    named = [patch for patch in axes.patches if (label := str(patch.get_label())) and not label.startswith("_")]
    return [*zone_entry(scenario), *named, *wind_entry(scenario)]


def wind_entry(scenario: Scenario, *, in_space: bool = False) -> list[Line2D]:
    """Return the wind for a legend: an arrow where the air goes, north up, and its speed; nothing without wind.

    A view in space has an arrow of its own; the entry is a line then.
    """
    wind = scenario.wind
    if wind is None or wind.speed_mps == 0.0:
        return []
    arrow = ARROW.transformed(Affine2D().rotate_deg(180.0 - wind.from_deg))
    text = f"wind {wind.speed_mps:g} m/s from {wind.from_deg:g}°"
    if in_space:
        return [Line2D([], [], color=WIND, lw=2.0, label=text)]
    return [Line2D([], [], ls="", marker=arrow, ms=17, mfc=WIND, mec="none", label=text)]


def _hidden(area: Area, north_m: tuple[float, float], east_m: tuple[float, float]) -> bool:
    inside = [low < edge < high for low, high, edges in zip(*area, (north_m, east_m), strict=True) for edge in edges]
    return not any(inside)
