"""A simulation to turn and zoom in a browser: ground, tracks, formation, in one file that needs no network.

Knows: plotly. Does not know: where tracks come from.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import plotly.graph_objects as go

from gcs.physics.quadrotor import Array
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.terrain import ground_height_m
from tools.pictures.scenery import colour

_GRID = 151
_EVERY = 4
_CHARACTERS = 1  # decimals of a metre that are kept
_UP = 0.25  # heights are drawn so much higher than wide


def write_page(plan: Plan, t_s: Array, tracks_ned_m: Array, path: Path) -> None:
    """Write one HTML file of tracks (V, N, 3) at t_s (N,)."""
    limits = plan.scenario.limits
    north, east = np.linspace(*limits.north_m, _GRID), np.linspace(*limits.east_m, _GRID)
    smooth = plan.scenario.terrain.model_copy(update={"ripple": None})
    ground = ground_height_m(smooth, *np.meshgrid(north, east, indexing="ij"))
    figure = go.Figure(
        go.Surface(
            x=east.round(_CHARACTERS).tolist(),
            y=north.round(_CHARACTERS).tolist(),
            z=ground.round(_CHARACTERS).tolist(),
            colorscale="Earth",
            colorbar={"title": {"text": "ground, m"}},
            opacity=0.9,
            name="ground",
        )
    )
    times = [f"t = {t:.0f} s" for t in t_s[::_EVERY]]
    for row, (sysid, track) in enumerate(zip(plan.sysids, tracks_ned_m, strict=True)):
        some = track[::_EVERY].round(2)
        figure.add_trace(
            go.Scatter3d(
                x=some[:, 1].tolist(),
                y=some[:, 0].tolist(),
                z=(-some[:, 2]).tolist(),
                text=times,
                mode="lines",
                line={"color": colour(row), "width": 4},
                name=f"vehicle {sysid}",
            )
        )
    figure.update_layout(
        title=plan.scenario.title,
        scene={
            "xaxis_title": "east, m",
            "yaxis_title": "north, m",
            "zaxis_title": "height, m",
            "aspectmode": "manual",
            "aspectratio": {"x": 1.0, "y": 1.0, "z": _UP},
        },
        legend={"x": 0.0, "y": 1.0},
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.write_html(path, include_plotlyjs=True, full_html=True, div_id=path.stem)
