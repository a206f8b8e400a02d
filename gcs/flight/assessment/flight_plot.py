"""The pictures of a flight: in 3D over terrain (Fig. 8), as a map (Fig. 9), the formation (Fig. 11)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt

from gcs.flight.assessment.pictures.figure_file import head, save, settle
from gcs.flight.assessment.pictures.flight_map import FlightMap
from gcs.flight.assessment.pictures.formation_view import draw_formation
from gcs.flight.assessment.pictures.label_places import Labels
from gcs.flight.assessment.pictures.map_layers import map_size_in
from gcs.flight.assessment.pictures.tracks_view import draw_tracks
from gcs.physics.quadrotor import POSITION, Array
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario

_SHOWN = 4  # formations at most


def draw_all(plan: Plan, t_s: Array, tracks_ned_m: Array, folder: Path) -> list[Path]:
    """Write tracks.png, map.png and formation.png of tracks (V, N, 3) flown at plan times (N,); return their paths."""
    scenario, sysids = plan.scenario, plan.sysids
    planned = plan.states(np.clip(t_s, plan.t_start_s, np.nextafter(plan.t_end_s, plan.t_start_s)))[..., POSITION]
    pictures = {
        "tracks.png": draw_tracks(scenario, sysids, t_s, tracks_ned_m, plan.moves),
        "map.png": draw_map(scenario, sysids, t_s, tracks_ned_m, planned),
        "formation.png": draw_formation(scenario, sysids, t_s, tracks_ned_m, shown_s(plan)),
    }
    for name, figure in pictures.items():
        save(figure, folder / name)
    return [folder / name for name in pictures]


def shown_s(plan: Plan) -> tuple[float, ...]:
    """Return the instants at which the formation is shown: begin, end, and the ends of changes between them."""
    ends_s = [move.end_s for move in plan.moves if 0.0 < move.end_s < plan.flight_s][: _SHOWN - 2]
    return (0.0, *ends_s, plan.flight_s) if ends_s else ()


def draw_map(
    scenario: Scenario, sysids: tuple[int, ...], t_s: Array, tracks_ned_m: Array, planned_ned_m: Array | None = None
) -> Any:
    """Return the map of tracks (V, N, 3) at plan times (N,), and of what was planned beneath them."""
    chart = FlightMap(scenario, sysids, t_s, tracks_ned_m, planned_ned_m)
    width_in, height_in = map_size_in(scenario, chart.area)
    figure, axes = plt.subplots(figsize=(width_in, height_in), layout="constrained")
    chart.draw(axes)
    head(
        axes, f"{scenario.name}: {'map' if planned_ned_m is None else 'flown (coloured) and planned (grey)'}", width_in
    )
    settle(figure)
    chart.label(axes, Labels(figure))
    return figure
