"""Tracks over the real ground: 3D (Figs. 8, 15, 21), from above (Figs. 9, 16, 22), and the formation (Fig. 11).

Knows: the drawings of a flight, and how a second set of tracks is laid beside.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from gcs.flight.assessment.flight_plot import draw_map
from gcs.flight.assessment.pictures.formation_view import draw_formation
from gcs.flight.assessment.pictures.tracks_view import draw_tracks
from gcs.physics.quadrotor import POSITION, Array
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from tools.paper.drawing import save
from tools.paper.run import Run

_STEP_S = 0.25


def tracks_of(plan: Plan) -> tuple[Array, Array]:
    """Instants (N,) of the mission, and the positions of all vehicles (V, N, 3)."""
    t_s = np.append(np.arange(0.0, plan.flight_s, _STEP_S), np.nextafter(plan.flight_s, 0.0))
    return t_s, plan.states(t_s)[..., POSITION]


def in_space(run: Run, scenario: Scenario, sysids: tuple[int, ...], t_s: Array, tracks: Array, name: str) -> None:
    """3D, with a stretch close up."""
    _save(run, draw_tracks(scenario, sysids, t_s, tracks), name)


def from_above(
    run: Run,
    scenario: Scenario,
    sysids: tuple[int, ...],
    t_s: Array,
    tracks: Array,
    name: str,
    beside: Array | None = None,
) -> None:
    """Plan view; `beside` is one more track (N, 3), dashed."""
    figure = draw_map(scenario, sysids, t_s, tracks)
    if beside is not None:
        axes = figure.axes[0]
        axes.plot(beside[:, 1], beside[:, 0], "k--", lw=1.2, label="our leader")
        axes.add_artist(axes.get_legend())
        axes.legend(handles=axes.lines[-1:], fontsize=8, loc="lower right")
    _save(run, figure, name)


def formation(run: Run, plan: Plan, t_s: Array, tracks: Array, name: str) -> None:
    """The six at four instants."""
    _save(run, draw_formation(plan.scenario, plan.sysids, t_s, tracks), name)


def _save(run: Run, figure: Any, name: str) -> None:
    assert isinstance(figure, Figure)
    save(figure, run, name)
    plt.close(figure)
