"""The information graph G of §2.2 (Eq. 3): whose state each vehicle needs."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import Delaunay

from gcs.types import Array

# Thinner than this share of its length, a formation counts as flat in that direction.
_FLAT = 1e-6

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


def information_graph(topology: Literal["voronoi", "leader"], offsets_ned_m: Array, leader: int) -> InformationGraph:
    """The graph of a scenario's `topology` for offsets (V, 3)."""
    return voronoi(offsets_ned_m, leader) if topology == "voronoi" else leader_star(len(offsets_ned_m), leader)


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
