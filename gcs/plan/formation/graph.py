"""The information graph G of §2.2 (Eq. 3): whose state each vehicle needs."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from graphlib import TopologicalSorter
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import Delaunay

from gcs.scenario.schema.formation_table import Topology
from gcs.types import Array

# Thinner than this share of its length, a formation counts as flat in that direction.
_FLAT = 1e-6
_DECIMALS = 6  # of equal distances the lowest row counts, whatever rounding makes of them

Pairs = NDArray[np.intp]


@dataclass(frozen=True)
class InformationGraph:
    """Rows of the vehicles whose states each vehicle needs: acyclic, and every path ends at the leader."""

    sources: tuple[tuple[int, ...], ...]  # of each of V vehicles; empty for the leader

    @property
    def edges(self) -> Pairs:
        """Edges (E, 2): every vehicle with each of its sources."""
        pairs = [(row, source) for row, sources in enumerate(self.sources) for source in sources]
        return np.array(pairs, dtype=np.intp).reshape(-1, 2)

    @cached_property
    def weights(self) -> Array:
        """Weights (V, V) of the states that each vehicle uses: its sources alike, the leader its own; rows sum to 1."""
        found = np.zeros((len(self.sources), len(self.sources)))
        for row, sources in enumerate(self.sources):
            found[row, list(sources) or row] = 1.0 / max(len(sources), 1)
        return found

    @cached_property
    def relays(self) -> bool:
        """Whether somebody uses the state of a follower."""
        return any(self.sources[source] for sources in self.sources for source in sources)

    def without(self, gone: Collection[int]) -> "InformationGraph":
        """The graph in which nobody uses the states of these rows: who did, uses those that they used.

        The leader, to which every path leads, is used all the same. Where it is gone, another graph is needed.
        """
        found: dict[int, set[int]] = {}
        for row in TopologicalSorter(dict(enumerate(self.sources))).static_order():
            found[row] = set()
            for source in self.sources[row]:
                found[row] |= found[source] if source in gone and found[source] else {source}
        return InformationGraph(tuple(tuple(sorted(found[row])) for row in range(len(self.sources))))


def information_graph(topology: Topology, offsets_ned_m: Array, leader: int) -> InformationGraph:
    """The graph of a scenario's `topology` for offsets (V, 3)."""
    match topology:
        case "leader":
            return leader_star(len(offsets_ned_m), leader)
        case "chain":
            return chain(offsets_ned_m, leader)
        case "tree":
            return tree(offsets_ned_m, leader)
        case "voronoi":
            return voronoi(offsets_ned_m, leader)


def chain(offsets_ned_m: Array, leader: int) -> InformationGraph:
    """The graph in which every vehicle is used by one other at most: the nearest that nobody led to before."""
    sources: list[tuple[int, ...]] = [()] * len(offsets_ned_m)
    last, led = leader, np.zeros(len(offsets_ned_m), dtype=bool)
    led[leader] = True
    while not led.all():
        away_m = np.linalg.norm(offsets_ned_m - offsets_ned_m[last], axis=1).round(_DECIMALS)
        after = int(np.argmin(np.where(led, np.inf, away_m)))
        sources[after] = (last,)
        last = after
        led[after] = True
    return InformationGraph(tuple(sources))


def tree(offsets_ned_m: Array, leader: int) -> InformationGraph:
    """The graph in which every follower needs the nearest of those that it needs in `voronoi`."""

    def nearest(row: int, sources: tuple[int, ...]) -> tuple[int, ...]:
        away_m = np.linalg.norm(offsets_ned_m[list(sources)] - offsets_ned_m[row], axis=1).round(_DECIMALS)
        return (sources[int(np.argmin(away_m))],)

    full = voronoi(offsets_ned_m, leader).sources
    return InformationGraph(tuple(nearest(row, sources) if sources else () for row, sources in enumerate(full)))


def leader_star(count: int, leader: int) -> InformationGraph:
    """The graph in which every follower needs the leader's state."""
    return InformationGraph(tuple(() if row == leader else (leader,) for row in range(count)))


def voronoi(offsets_ned_m: Array, leader: int) -> InformationGraph:
    """The graph in which every follower needs its Voronoi neighbours that are nearer to the leader, in hops.

    In space, in a plane or on a line, as the formation lies. Hops decrease towards the leader, so the graph is
    acyclic.
    """
    count = len(offsets_ned_m)
    pairs = np.array(list(_neighbours(offsets_ned_m)), dtype=np.intp).reshape(-1, 2)
    links = csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    hops = dijkstra(links, directed=False, unweighted=True, indices=leader)
    sources: list[set[int]] = [set() for _ in range(count)]
    for i, j in pairs.tolist():
        if hops[i] != hops[j]:
            far, near = (i, j) if hops[i] > hops[j] else (j, i)
            sources[far].add(near)
    return InformationGraph(tuple(tuple(sorted(of)) for of in sources))


def _neighbours(places: Array) -> Iterator[tuple[int, int]]:
    """Pairs whose Voronoi cells touch: the edges of the Delaunay triangulation, in as many dimensions as there are."""
    seen = places - places.mean(axis=0)
    _, sizes, directions = np.linalg.svd(seen, full_matrices=False)
    rank = int(np.sum(sizes > _FLAT * sizes[0])) if sizes[0] > 0.0 else 0
    if rank < 2:
        order = np.argsort(seen @ directions[0], kind="stable").tolist()
        yield from pairwise(order)
        return
    triangulation = Delaunay(seen @ directions[:rank].T)
    start, of = triangulation.vertex_neighbor_vertices
    for row in range(len(places)):
        yield from ((row, int(other)) for other in of[start[row] : start[row + 1]])
    # A vehicle on another's place, or too nearly on a face, is no corner of any simplex.
    for row, _, nearest in triangulation.coplanar.tolist():
        yield row, nearest
