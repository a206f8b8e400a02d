"""Run the autopilot's navigator model and turn its states into polynomial path pieces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gcs.autopilots.navigation.navigator import Navigator, NavigatorOrders, NavigatorState, vector
from gcs.physics.quadrotor import Array
from sim_bridge.autopilot.guidance.motion_primitives import bridge
from sim_bridge.autopilot.guidance.piece import DERIVATIVES, Piece

_PIECE_S = 0.2


@dataclass(frozen=True)
class NavigatorPath:
    """One piece, and the waypoints completed within it: index and time."""

    piece: Piece
    completed: tuple[tuple[int, float], ...]


def follow(start_s: float, flat: Array, navigator: Navigator, orders: NavigatorOrders) -> Iterator[NavigatorPath]:
    """Generate the pieces of a navigator from a motion `flat` (DERIVATIVES, 4), without end; yaw is constant."""
    steps = round(_PIECE_S / navigator.step_s)
    yaw_rad = flat[0, 3]
    begin_s, begin = start_s, flat.copy()
    begin[1:, 3] = 0.0
    completed: list[tuple[int, float]] = []
    for count, moment in enumerate(navigator.fly(orders), start=1):
        if moment.completed is not None:
            completed.append((moment.completed, start_s + moment.t_s))
        if count % steps:
            continue
        end_s, end = start_s + moment.t_s, _flat(moment, yaw_rad)
        yield NavigatorPath(bridge(begin_s, begin, end_s, end), tuple(completed))
        begin_s, begin, completed = end_s, end, []


def motion(flat: Array) -> NavigatorState:
    """Return the motion `flat` (DERIVATIVES, 4) as the initial state of a navigator."""
    position, velocity, acceleration = (vector(*flat[k, :3]) for k in range(3))
    return NavigatorState(0.0, position, velocity, acceleration)


def _flat(moment: NavigatorState, yaw_rad: float) -> Array:
    flat = np.zeros((DERIVATIVES, 4))
    flat[:3, :3] = moment.position_ned_m, moment.velocity_ned_mps, moment.acceleration_ned_mps2
    flat[0, 3] = yaw_rad
    return flat
