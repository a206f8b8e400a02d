"""The automatic changes of a solved plan: departures of the coordinates from rest, as moves."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PPoly

from gcs.physics.quadrotor import Array
from gcs.plan.formation.changes.timeline import Move
from gcs.plan.formation.coordinates import Coordinate, composed
from gcs.plan.formation.separation import least_gap
from gcs.plan.formation.shape import Shape

_EVERY_S = 0.1
_NOTICEABLE = 0.05  # share of a coordinate's unit: smaller departures are not listed
_KINDS = {"scale": "shrink", "heading": "rotate", "blend": "reshape"}


def automatic_moves(
    base: Shape, target: Array, coordinates: tuple[Coordinate, ...], values: PPoly, change_speed_mps: float
) -> tuple[Move, ...]:
    """One move for every span over which a coordinate is away from rest."""
    times = np.append(np.arange(values.x[0], values.x[-1], _EVERY_S), values.x[-1])
    at = values(times)
    moves = []
    for number, coordinate in enumerate(coordinates):
        if coordinate.free_end:
            continue
        away = np.abs(at[:, number] - coordinate.rest) / coordinate.unit
        edges = np.flatnonzero(np.diff(np.concatenate([[False], away > _NOTICEABLE, [False]]).astype(int)))
        for first, last in zip(edges[::2], edges[1::2] - 1, strict=True):
            furthest = first + int(away[first : last + 1].argmax())
            alone = PPoly(values.c[:, :, number : number + 1], values.x)
            shape = composed(base, target, [coordinate.name], alone)
            there = shape.at(float(times[furthest]))
            travel_m = float(np.linalg.norm(there - base.at(float(times[furthest])), axis=1).max())
            moves.append(
                Move(
                    kind=_KINDS[coordinate.name],
                    name=_words(coordinate, float(at[furthest, number])),
                    trigger="auto",
                    start_s=float(times[first]),
                    end_s=float(times[last]),
                    paper_time_s=2.0 * travel_m / change_speed_mps,
                    limited_by="cost",
                    way="there and back",
                    least_gap_m=least_gap(there)[0] if len(there) > 1 else np.inf,
                )
            )
    return tuple(moves)


def _words(coordinate: Coordinate, value: float) -> str:
    if coordinate.name == "scale":
        return f"shrink to {value:.2f}"
    if coordinate.name == "heading":
        return f"rotate {np.degrees(value):.0f} deg"
    return f"reshape, {100 * value:.0f} % done"
