"""Information flows from the leader to everyone and never in a circle, however the formation lies."""

from __future__ import annotations

from graphlib import TopologicalSorter
from itertools import combinations
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gcs.plan.formation.graph import InformationGraph, information_graph, leader_star, voronoi
from gcs.scenario.schema.formation_table import Topology
from gcs.scenario.schema.scenario import Generator
from gcs.scenario.values.formations import places_up_m
from gcs.types import Array

TILT = Rotation.from_euler("xyz", [0.3, -0.7, 1.1])
GENERATORS: tuple[Generator, ...] = ("triangle", "line", "column", "vee", "grid", "circle", "sphere")
RANDOM = np.random.default_rng(12)


def check(graph: InformationGraph, count: int, leader: int) -> None:
    """Everyone but the leader needs somebody, and following sources ends at the leader."""
    assert len(graph.sources) == count
    assert [row for row in range(count) if not graph.sources[row]] == [leader]
    order = list(TopologicalSorter(dict(enumerate(graph.sources))).static_order())  # raises on a circle
    assert order[0] == leader


@pytest.mark.parametrize("generator", GENERATORS)
@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 12, 200])
def test_every_shape_has_a_graph_rooted_at_its_leader(generator: Generator, count: int) -> None:
    places = places_up_m(generator, count, 3.0)
    for leader in {0, count // 2, count - 1}:
        check(voronoi(places, leader), count, leader)
        check(voronoi(TILT.apply(places) + 50.0, leader), count, leader)


@pytest.mark.parametrize(
    "places",
    [
        np.zeros((4, 3)),
        np.repeat(RANDOM.normal(size=(5, 3)), 2, axis=0),
        np.column_stack([RANDOM.normal(size=(30, 2)), np.zeros(30)]),
        np.column_stack([RANDOM.normal(size=(30, 2)), 1e-9 * RANDOM.normal(size=30)]),
        RANDOM.normal(size=(60, 3)) * [100.0, 1.0, 0.01],
        RANDOM.integers(0, 3, size=(40, 3)).astype(float),
    ],
    ids=["all in one place", "pairs in one place", "in a plane", "nearly in a plane", "flat", "on a lattice"],
)
def test_awkward_places(places: Array) -> None:
    check(voronoi(places, 3), len(places), 3)


def test_on_a_line_everyone_listens_to_the_next_towards_the_leader() -> None:
    graph = voronoi(TILT.apply(places_up_m("column", 6, 2.0)), 2)
    assert graph.sources == ((1,), (2,), (), (2,), (3,), (4,))
    assert graph.edges.tolist() == [[0, 1], [1, 2], [3, 2], [4, 3], [5, 4]]


def test_in_a_triangle_of_six_the_middle_of_the_last_row_listens_to_both_before_it() -> None:
    graph = voronoi(places_up_m("triangle", 6, 5.0), 0)
    assert graph.sources == ((), (0,), (0,), (1,), (1, 2), (2,))


def cells_touch(places: Array, i: int, j: int) -> bool:
    """Whether some point on the line midway between two is nearer to them than to anybody else; closed form."""
    middle, between = (places[i] + places[j]) / 2.0, places[j] - places[i]
    border = np.array([-between[1], between[0]])
    others = np.delete(places, [i, j], axis=0)
    # |middle + t border - p_k|^2 >= |middle + t border - p_i|^2 is linear in t.
    slope = 2.0 * (others - places[i]) @ border
    room = (others**2).sum(axis=1) - (places[i] ** 2).sum() - 2.0 * (others - places[i]) @ middle
    above = np.max(room[slope < 0.0] / slope[slope < 0.0], initial=-np.inf)
    below = np.min(room[slope > 0.0] / slope[slope > 0.0], initial=np.inf)
    return bool(above < below)


def test_neighbours_are_those_whose_cells_touch() -> None:
    places = RANDOM.uniform(0, 10, size=(25, 2))
    graph = voronoi(np.column_stack([places, np.zeros(25)]), 0)
    touching = [(i, j) for i, j in combinations(range(25), 2) if cells_touch(places, i, j)]
    hops = {0: 0}
    while len(hops) < 25:
        hops |= {b: hops[a] + 1 for pair in touching for a, b in (pair, pair[::-1]) if a in hops and b not in hops}
    wanted = {pair for pair in touching if hops[pair[0]] != hops[pair[1]]}
    assert {(min(a, b), max(a, b)) for a, b in graph.edges.tolist()} == wanted
    assert all(hops[near] == hops[far] - 1 for far, near in graph.edges.tolist())


def test_the_leaders_graph_is_a_star() -> None:
    graph = information_graph("leader", np.zeros((4, 3)), 1)
    assert graph.sources == ((1,), (), (1,), (1,))
    assert graph == leader_star(4, 1)
    assert len(leader_star(1, 0).edges) == 0
    places = places_up_m("grid", 9, 2.0)
    assert information_graph("voronoi", places, 4) == voronoi(places, 4)


TOPOLOGIES: tuple[Topology, ...] = get_args(Topology)
# On a lattice many places are equal, in line, or in one plane.
LATTICE = st.lists(st.tuples(*[st.integers(-2, 2)] * 3), min_size=2, max_size=12).map(lambda of: np.array(of, float))


def check_weights(graph: InformationGraph, count: int, leader: int) -> None:
    """Rows sum to 1, the leader uses its own state alone, and everybody's state becomes the leader's (Definition 1)."""
    np.testing.assert_allclose(graph.weights.sum(axis=1), 1.0)
    assert (graph.weights >= 0.0).all()
    settled = np.linalg.matrix_power(graph.weights, count)
    np.testing.assert_allclose(settled[:, leader], 1.0)


@given(places=LATTICE, data=st.data(), topology=st.sampled_from(TOPOLOGIES))
def test_any_loss_leaves_a_graph_that_leads_to_the_leader(
    places: Array, data: st.DataObject, topology: Topology
) -> None:
    count = len(places)
    leader = data.draw(st.integers(0, count - 1))
    gone = data.draw(st.sets(st.integers(0, count - 1)))
    graph = information_graph(topology, places, leader)
    check(graph, count, leader)
    check_weights(graph, count, leader)
    left = graph.without(gone)
    check(left, count, leader)
    check_weights(left, count, leader)
    assert not {source for sources in left.sources for source in sources} & (gone - {leader})
    untouched = [row for row in range(count) if not set(graph.sources[row]) & gone]
    assert all(left.sources[row] == graph.sources[row] for row in untouched)
    assert graph.without(()) == graph


def test_listeners_take_over_whom_the_lost_one_listened_to() -> None:
    graph = InformationGraph(((), (0,), (1,), (1, 2), (3,)))
    assert graph.without({1}).sources == ((), (0,), (0,), (0, 2), (3,))
    assert graph.without({1, 2, 3}).sources == ((), (0,), (0,), (0,), (0,))
    assert graph.without({0}) == graph  # another leader needs another graph


def test_a_chain_goes_from_each_to_the_nearest_left_and_a_tree_to_the_nearest_neighbour() -> None:
    places = places_up_m("triangle", 6, 5.0)
    line = information_graph("chain", places, 0)
    assert line.sources == ((), (0,), (1,), (4,), (2,), (3,))
    assert max(sum(row in sources for sources in line.sources) for row in range(6)) == 1
    assert information_graph("tree", places, 0).sources == ((), (0,), (0,), (1,), (1,), (2,))
    assert line.relays
    assert not leader_star(6, 0).relays
    column = TILT.apply(places_up_m("column", 6, 2.0))
    trees = [information_graph(topology, column, 0) for topology in ("chain", "tree", "voronoi")]
    assert trees[0] == trees[1] == trees[2]
