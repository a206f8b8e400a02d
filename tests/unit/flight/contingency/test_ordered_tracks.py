"""A return ends when its vehicle rests above the end; a vehicle that does not follow gets a new reference."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.flight.contingency.manoeuvres import MotionReference
from gcs.flight.contingency.ordered_tracks import (
    ARRIVES_S,
    LEFT_M,
    NEAR_M,
    RENEWALS_MAX,
    RENEWS_S,
    STILL_MPS,
    WayBack,
)
from gcs.flight.contingency.policy import Action, Order
from gcs.flight.monitor import VehicleView
from gcs.mission.failsafe.routed.routed_motion import PiecewiseMotion

T0_UNIX_S = 1000.0
# From (0, 0) to (20, 0) between 10 s and 30 s of plan time.
TRACK = MotionReference(
    PiecewiseMotion(
        np.array([[0.0, 10.0, 20.0]]),
        np.array([[[0.0, 0.0, -5.0], [10.0, 0.0, -5.0], [20.0, 0.0, -5.0]]]),
        np.array([[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 0.0]]]),
    ),
    10.0,
    0.0,
)


def seen(t_s: float, north_m: float, north_mps: float = 0.0, down_m: float = -5.0) -> VehicleView:
    """A report that came at plan time `t_s`."""
    view = VehicleView(3)
    view.unix_s = T0_UNIX_S + t_s
    view.position_ned_m, view.velocity_ned_mps = np.array([north_m, 0.0, down_m]), np.array([north_mps, 0.0, 0.0])
    return view


@pytest.mark.parametrize(
    ("t_s", "north_m", "north_mps", "arrived"),
    [
        (29.9, 20.0, 0.0, False),  # the reference has not ended
        (30.1, 20.0, 0.0, True),
        (30.1, 20.0 - 1.1 * NEAR_M, 0.0, False),
        (30.1, 20.0, 1.1 * STILL_MPS, False),  # it passes
        (30.1 + ARRIVES_S, 15.0, 1.0, True),  # it had its time
    ],
)
def test_a_return_ends_when_the_vehicle_rests_above_its_end(
    t_s: float, north_m: float, north_mps: float, arrived: bool
) -> None:
    way = WayBack(Order(3, Action.RETURN, ""), TRACK)
    assert way.has_arrived(seen(t_s, north_m, north_mps, down_m=-7.0), t_s) is arrived


@pytest.mark.parametrize(
    ("t_s", "off_m", "renewals", "left"),
    [
        (20.0, 0.9 * LEFT_M, 0, False),
        (20.0, 1.1 * LEFT_M, 0, True),
        (10.0 + 0.9 * RENEWS_S, 1.1 * LEFT_M, 0, False),  # it may still follow
        (20.0, 1.1 * LEFT_M, RENEWALS_MAX, False),
    ],
)
def test_a_vehicle_that_does_not_follow_gets_a_new_reference(
    t_s: float, off_m: float, renewals: int, left: bool
) -> None:
    way = WayBack(Order(3, Action.RETURN, ""), TRACK, renewals)
    assert way.is_left(seen(t_s, TRACK.at(0, t_s)[0] - off_m), T0_UNIX_S, t_s) is left
    late = seen(t_s - 0.5, TRACK.at(0, t_s)[0] - off_m - 0.5 * 1.5, 1.5)  # it flew on since its report
    assert way.is_left(late, T0_UNIX_S, t_s) is left
