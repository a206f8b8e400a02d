"""The predicted flight of one vehicle's mission: its navigator model, run until the last waypoint is completed."""

from dataclasses import dataclass

import numpy as np

from gcs.autopilots.waypoint_models.navigator import Navigator, NavigatorOrders
from gcs.errors import VerificationError
from gcs.types import Array

NEAR_M = 2.0  # a vehicle that stops at a waypoint has arrived within this distance: the radius of both autopilots
_TIMEOUT_FACTOR = 10.0  # of the time that the speeds require, with one second more for each waypoint


@dataclass(frozen=True)
class Prediction:
    """A flight from the start (time 0) to the completion of the last waypoint."""

    t_s: Array  # (M,)
    position_ned_m: Array  # (M, 3)
    velocity_ned_mps: Array  # (M, 3)
    passed_s: Array  # (N,) time of the least distance to each waypoint, or of arrival where it stops
    completed_s: Array  # (N,) time at which the autopilot changes to the next leg
    obeyed: Array  # (N,) speed of the cruise of each leg over the speed set for it, at its end
    doubtful: bool = False  # whether other `Navigator.reactions` may fly it otherwise


def predict(navigator: Navigator, orders: NavigatorOrders) -> Prediction:
    """Return the predicted flight.

    Raises `VerificationError` if a waypoint is not completed in ten times the time that the speeds require.
    """
    legs_m = np.linalg.norm(np.diff([orders.start_ned_m, *orders.waypoints_ned_m], axis=0), axis=1)
    required_s = float(np.sum(legs_m / orders.speeds_mps) + sum(orders.holds_s))
    limit_s = _TIMEOUT_FACTOR * (required_s + orders.count)
    rows, completed, obeyed, doubtful = [], [], [], False
    for state in navigator.fly(orders):
        if state.t_s >= limit_s:
            break
        rows.append((state.t_s, *state.position_ned_m, *state.velocity_ned_mps))
        if state.completed is not None:
            completed.append(state.t_s)
            obeyed.append(state.obeyed)
            doubtful = state.doubtful
            if state.completed + 1 == orders.count:
                break
    if len(completed) < orders.count:
        raise VerificationError(
            f"The model of the autopilot does not complete waypoint {len(completed) + 1} of {orders.count}"
            f" within {limit_s:.0f} s.",
            hint="raise the speeds, or set the waypoints farther apart",
        )
    flown = np.array(rows)
    ends = np.array(completed)
    passed = passing_times(flown[:, 0], flown[:, 1:4], orders, ends)
    return Prediction(flown[:, 0], flown[:, 1:4], flown[:, 4:], passed, ends, np.array(obeyed), doubtful)


def passing_times(t_s: Array, position_ned_m: Array, orders: NavigatorOrders, completed_s: Array) -> Array:
    """Return the times (N,) at which a flight passed its waypoints.

    The flight has positions (M, 3) at times (M,), and completed its waypoints at `completed_s` (N,). A waypoint is
    passed at the least distance between the completion of the one before and of the one after. Where the vehicle stops,
    it is passed on arrival within NEAR_M.
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
