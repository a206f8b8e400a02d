"""Definition 1: what counts as being in formation, and that vehicles which follow the graph get there."""

from __future__ import annotations

from graphlib import TopologicalSorter

import numpy as np
import pytest

from gcs.physics.quadrotor import Array
from gcs.plan.formation.changes.transforms import rotation
from gcs.plan.formation.error import formation_error_m, formation_errors_m
from gcs.plan.formation.graph import information_graph
from gcs.plan.formation.shape import joined, rigid, stretched
from gcs.scenario.formations import places_up_m

PLACES = places_up_m("triangle", 10, 4.0)
GAIN = 0.8  # 1/s
STEP_S = 0.02


def test_a_formation_that_is_elsewhere_as_a_whole_has_no_error() -> None:
    path = np.random.default_rng(1).normal(size=(1, 7, 3)) * 100.0
    offsets = np.repeat(PLACES[:, None], 7, axis=1)
    np.testing.assert_allclose(formation_error_m(path + offsets, offsets), 0.0, atol=1e-12)


def test_one_out_of_place_moves_the_centre_by_his_share() -> None:
    offsets = np.repeat(PLACES[:, None], 3, axis=1)
    positions = offsets.copy()
    positions[4, 1, 2] += 5.0
    errors = formation_errors_m(positions, offsets)
    np.testing.assert_allclose(errors[:, [0, 2]], 0.0, atol=1e-12)
    np.testing.assert_allclose(errors[4, 1], 4.5)
    np.testing.assert_allclose(np.delete(errors[:, 1], 4), 0.5)
    np.testing.assert_allclose(formation_error_m(positions, offsets), [0.0, 4.5, 0.0], atol=1e-12)


def flown(topology: str, start: Array, offsets: Array, leader_path: Array) -> Array:
    """Positions (V, N, 3) of followers that steer by the mean of what their sources tell, and of nobody else."""
    graph = information_graph(topology, PLACES, 0)  # type: ignore[arg-type]
    order = [row for row in TopologicalSorter(dict(enumerate(graph.sources))).static_order() if graph.sources[row]]
    seen = np.empty_like(offsets)  # xi - h: the same for all where Eq. 4 holds
    seen[:, 0] = start - offsets[:, 0]
    seen[0] = leader_path
    rate = np.zeros_like(seen)
    rate[0, :-1] = np.diff(leader_path, axis=0) / STEP_S
    for n in range(offsets.shape[1] - 1):
        for row in order:
            sources = list(graph.sources[row])
            rate[row, n] = rate[sources, n].mean(axis=0) - GAIN * (seen[row, n] - seen[sources, n].mean(axis=0))
            seen[row, n + 1] = seen[row, n] + STEP_S * rate[row, n]
    return seen + offsets


@pytest.mark.parametrize("topology", ["voronoi", "leader"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_whoever_follows_the_graph_achieves_the_formation_from_anywhere(topology: str, seed: int) -> None:
    """Eq. 4, while the formation turns and the leader flies a curve that nobody else knows."""
    turn = stretched(rotation(PLACES, np.array([0.0, 0.0, 1.0]), 2.0), 5.0, 15.0)
    shape = joined([rigid(PLACES, 0.0, 5.0), turn, rigid(turn.at(15.0), 15.0, 30.0)])
    t_s = np.arange(0.0, 30.0, STEP_S)
    leader_path = np.column_stack([3.0 * t_s, 20.0 * np.sin(0.2 * t_s), -10.0 - 0.1 * t_s])
    start = np.random.default_rng(seed).normal(size=PLACES.shape) * 30.0
    positions = flown(topology, start, shape.offsets(t_s), leader_path)
    error = formation_error_m(positions, shape.offsets(t_s))
    assert error[0] > 20.0
    assert error[-1] < 1e-4
    # Each hop from the leader adds a power of t to the decay exp(-GAIN t), no more.
    hops = 3 if topology == "voronoi" else 1
    envelope = error[0] * (1.0 + GAIN * t_s) ** (hops - 1) * np.exp(-GAIN * (1.0 - 0.01) * t_s)
    assert np.all(error <= 3.0 * envelope + 1e-9)
