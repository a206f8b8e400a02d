"""Curves over plan time, one panel each: speed, and the distances to ground, zones and between vehicles."""

import numpy as np
from matplotlib.axes import Axes

from gcs.flight.plots.figure_file import Look, colours
from gcs.flight.plots.flight_map import PLANNED
from gcs.flight.recording.recording import nearest_m
from gcs.plan.trajectory.distances import zone_distances_m
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array

LIMIT: Look = {"color": "red", "lw": 0.8}
_USUAL = 0.9  # share of instants that the panel of separations shows whole: landed vehicles are far apart
_LEGEND: Look = {"fontsize": 8, "loc": "lower right", "ncols": 3}


def draw_speeds(axes: Axes, sysids: tuple[int, ...], t_s: Array, rates_mps: Array, planned_mps: Array | None) -> None:
    """Draw the speed over ground of every vehicle, from velocities (V, N, 3)."""
    for rate in planned_mps if planned_mps is not None else ():
        axes.plot(t_s, np.linalg.norm(rate, axis=1), **PLANNED)
    for colour, rate in zip(colours(sysids), rates_mps, strict=True):
        axes.plot(t_s, np.linalg.norm(rate, axis=1), color=colour, lw=1.1)
    axes.set(ylabel="speed, m/s", ylim=(0.0, None))


def draw_clearance(axes: Axes, scenario: Scenario, t_s: Array, places_ned_m: Array) -> None:
    """Draw the least height of any vehicle above the ground, and what is required of its distance to the ground.

    Beside a slope the distance is less than the height.
    """
    ground_m = ground_height_m(scenario.terrain, places_ned_m[..., 0], places_ned_m[..., 1])
    axes.plot(t_s, (-places_ned_m[..., 2] - ground_m).min(axis=0), lw=1.2)
    terrain = scenario.terrain
    level = terrain.dem is None and terrain.ripple is None and not terrain.mountains.height_m
    required = "required in flight" if level else "required in flight, in any direction"
    axes.axhline(scenario.limits.clearance_min_m, **LIMIT, label=required)
    axes.set(ylabel="least height\nabove ground, m", ylim=(0.0, None))
    axes.legend(**_LEGEND)


def draw_separation(
    axes: Axes, t_s: Array, places_ned_m: Array, planned_ned_m: Array | None, required_m: float | None
) -> None:
    """Draw the distance of the nearest two vehicles."""
    own = nearest_m(places_ned_m)
    usual_m = float(np.nanquantile(own, _USUAL)) if np.isfinite(own).any() else 1.0
    if planned_ned_m is not None:
        expected = nearest_m(planned_ned_m)
        usual_m = max(usual_m, float(np.nanmax(expected, initial=0.0)))
        axes.plot(t_s, expected, **PLANNED, label="planned")
    axes.plot(t_s, own, lw=1.2, label=None if planned_ned_m is None else "flown")
    if required_m is not None:
        axes.axhline(required_m, **LIMIT, label="required")
        usual_m = max(usual_m, required_m)
    axes.set(ylabel="least\nseparation, m", ylim=(0.0, 1.3 * usual_m))
    if axes.get_legend_handles_labels()[0]:
        axes.legend(**_LEGEND)


def draw_zone_margin(
    axes: Axes, scenario: Scenario, t_s: Array, places_ned_m: Array, planned_ned_m: Array | None
) -> None:
    """Draw the distance of the nearest vehicle to the edge of a no-fly zone; below 0 it is inside."""
    if planned_ned_m is not None:
        axes.plot(t_s, _zone_margin_m(scenario, t_s, planned_ned_m), **PLANNED, label="planned")
    margin_m = _zone_margin_m(scenario, t_s, places_ned_m)
    axes.plot(t_s, margin_m, lw=1.2, label=None if planned_ned_m is None else "flown")
    axes.axhline(0.0, **LIMIT, label="edge of the zone")
    at = int(np.argmin(np.where(np.isnan(margin_m), np.inf, margin_m)))
    axes.plot(t_s[at], margin_m[at], "o", ms=4, color="black", label=f"least: {margin_m[at]:.2f} m at {t_s[at]:.0f} s")
    axes.set(
        ylabel="least distance\nto a zone, m", ylim=(min(0.0, 1.1 * float(margin_m[at])), 1.5 * axes.get_ylim()[1])
    )
    axes.legend(**{**_LEGEND, "loc": "upper right", "ncols": 2})


def _zone_margin_m(scenario: Scenario, t_s: Array, places_ned_m: Array) -> Array:
    """The least distance (N,) of any vehicle of (V, N, 3) to a zone; NaN where no vehicle is known."""
    with np.errstate(invalid="ignore"):
        away_m = zone_distances_m(scenario, t_s, places_ned_m)
    known = np.isfinite(places_ned_m[..., 0])
    least = np.min(np.where(known, away_m, np.inf), axis=0)
    return np.where(np.isfinite(least), least, np.nan)
