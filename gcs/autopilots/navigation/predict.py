"""When a vehicle is where: a navigator flown to its end, without a vehicle.

Knows: moments, and what it means to pass a waypoint. Does not know: any autopilot.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import takewhile

import numpy as np

from gcs.autopilots.navigation.navigator import Navigator, NavigatorOrders
from gcs.errors import VerificationError
from gcs.physics.quadrotor import Array

NEAR_M = 2.0  # where it stops, a vehicle has arrived this close by: both autopilots' radius
_PATIENCE = 10.0  # times what the speeds ask for, and this many seconds for each waypoint


@dataclass(frozen=True)
class Prediction:
    """A flight from the start (time 0) to the completion of the last waypoint."""

    t_s: Array  # (M,)
    position_ned_m: Array  # (M, 3)
    velocity_ned_mps: Array  # (M, 3)
    passed_s: Array  # (N,) when the vehicle is nearest to each waypoint, or at last near where it stops
    completed_s: Array  # (N,) when the autopilot goes on to the next


def predict(navigator: Navigator, orders: NavigatorOrders) -> Prediction:
    """Fly the orders.

    Raises `VerificationError` where a waypoint is not completed in ten times the time that the speeds ask for.
    """
    legs_m = np.linalg.norm(np.diff(_points(orders), axis=0), axis=1)
    asked_s = float(np.sum(legs_m / orders.speeds_mps) + sum(orders.holds_s))
    limit_s = _PATIENCE * (asked_s + orders.count)
    rows, completed = [], []
    for moment in takewhile(lambda moment: moment.t_s < limit_s, navigator.fly(orders)):
        rows.append((moment.t_s, *moment.position_ned_m, *moment.velocity_ned_mps))
        if moment.completed is not None:
            completed.append(moment.t_s)
            if moment.completed + 1 == orders.count:
                break
    if len(completed) < orders.count:
        raise VerificationError(
            f"The model of the autopilot does not get past waypoint {len(completed) + 1} of {orders.count}"
            f" in {limit_s:.0f} s.",
            hint="ask for higher speeds, or for waypoints that are farther apart",
        )
    flown = np.array(rows)
    ends = np.array(completed)
    passed = passing_times(flown[:, 0], flown[:, 1:4], orders, ends)
    return Prediction(flown[:, 0], flown[:, 1:4], flown[:, 4:], passed, ends)


def passing_times(t_s: Array, position_ned_m: Array, orders: NavigatorOrders, completed_s: Array) -> Array:
    """When a flight, sampled at (M,) as positions (M, 3), passed each waypoint (N,), which were completed at (N,).

    Passing is being nearest, between the completion of the waypoint before and of the one after; where the vehicle
    stops it is coming within NEAR_M.
    """
    times = []
    for k, waypoint in enumerate(orders.waypoints_ned_m):
        begin = completed_s[k - 1] if k else 0.0
        end = completed_s[min(k + 1, orders.count - 1)]
        window = np.flatnonzero((t_s >= begin) & (t_s <= end))
        distance = np.linalg.norm(position_ned_m[window] - waypoint, axis=1)
        near = np.flatnonzero(distance <= NEAR_M)
        at = near[0] if orders.stops_at(k) and len(near) else distance.argmin()
        times.append(t_s[window[at]])
    return np.array(times)


def _points(orders: NavigatorOrders) -> Array:
    return np.array([orders.start_ned_m, *orders.waypoints_ned_m])
