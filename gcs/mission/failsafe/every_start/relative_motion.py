"""How near two vehicles come that return at one altitude, by what differs between them alone.

At equal shares of their ways, the vector between two vehicles is on the segment from that between their starts to that
between their ends. The one with the longer way has done a smaller share: it is behind by the difference of the ways, at
most. A vehicle that climbs longer is behind by what the other one cruises meanwhile. So the vector between them stays
within a triangle, moved along a segment. A formation that stands on its pads as it flies stays as it is: then the
triangle is a point, whatever the leader does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs.physics.quadrotor import Array

_CHORD = 1.42  # a chord of an angle below 90 degrees, as a share of its sine, at most
_TINY = 1e-12


@dataclass(frozen=True)
class Between:
    """M pairs of vehicles, or of groups of them, and how wrong each value may be; all lengths are level, in m."""

    begin: Array  # (M, 2) from the first start to the second one
    change: Array  # (M, 2) what the ends' vector differs from it
    begin_off: Array  # (M,)
    change_off: Array
    ends_off: Array  # of begin + change
    ways: tuple[Array, Array]  # (M, 2) from the start to the end of the first and of the second one
    ways_off: tuple[Array, Array]
    late: Array  # (M,) what the first one cruises while the second one still climbs
    late_off: Array


def least_level_m(pairs: Between) -> Array:
    """A level distance (M,) that no pair comes below."""
    length = [np.linalg.norm(way, axis=1) for way in pairs.ways]
    along = pairs.ways[1] / np.maximum(length[1], _TINY)[:, None]
    turned = np.where(pairs.ways_off[1] < length[1], _CHORD * pairs.ways_off[1] / np.maximum(length[1], _TINY), 2.0)
    turned = np.minimum(turned, 2.0)
    moved = pairs.ways_off[0] + pairs.ways_off[1]
    both = length[0] + length[1]
    mean = (pairs.ways[0] + pairs.ways[1]) / np.maximum(both, _TINY)[:, None]
    mean_off = np.where(moved < both, 2.0 * moved / np.maximum(both - moved, _TINY), 2.0)
    size = np.linalg.norm(pairs.change, axis=1)
    longer = np.sum(pairs.change * mean, axis=1)
    longer_off = pairs.change_off + size * np.minimum(mean_off, 2.0)
    end = pairs.begin + pairs.change
    behind = end - longer[:, None] * along
    behind_off = pairs.ends_off + longer_off + np.abs(longer) * turned
    late = -pairs.late[:, None] * along
    late_off = pairs.late_off + np.abs(pairs.late) * turned
    ends_off = np.maximum(pairs.begin_off, pairs.ends_off)
    corners = np.stack([pairs.begin, end, behind], axis=1)
    aimed = _outside_m(corners, late) - np.maximum(ends_off, behind_off)
    # Without a direction: any, by the largest difference of both ways.
    blind = _outside_m(corners[:, [0, 1, 1]], late) - (ends_off + size + pairs.change_off)
    return np.asarray(np.maximum(np.maximum(aimed, blind) - late_off, 0.0))


def _outside_m(corners: Array, shift: Array) -> Array:
    """The distance (M,) from 0 to triangles (M, 3, 2) that are moved by any share of a shift (M, 2); 0 inside."""
    edges = np.roll(corners, 1, axis=1) - corners
    normals = np.concatenate([edges, shift[:, None]], axis=1)[..., ::-1] * [1.0, -1.0]
    aims = np.concatenate([corners, corners + shift[:, None], normals, -normals], axis=1)
    aims = aims / np.maximum(np.linalg.norm(aims, axis=2), _TINY)[..., None]
    behind = np.minimum(np.einsum("mad,md->ma", aims, shift), 0.0)
    inner = np.einsum("mad,mcd->mac", aims, corners).min(axis=2) + behind
    return np.asarray(np.maximum(inner.max(axis=1), 0.0))
