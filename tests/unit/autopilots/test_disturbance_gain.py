"""The gain of the autopilots' loops, against its closed form and against the worst disturbance flown."""

from __future__ import annotations

import math

import pytest

from gcs.autopilots.waypoint_models.calibration import ARDUPILOT, PX4
from gcs.autopilots.waypoint_models.disturbance_gain import disturbance_gain_s2
from gcs.autopilots.waypoint_models.navigator import NavigatorState, vector
from gcs.autopilots.waypoint_models.tracking import Follower, Following, Loop

ZERO = vector(0.0, 0.0, 0.0)


def test_a_loop_of_second_order_has_its_closed_form() -> None:
    plain = Loop(1.0, 2.0, 0.0, 0.0, False)
    squared, share = 2.0, 1.0 / math.sqrt(2.0)
    angle = math.pi * share / (2.0 * math.sqrt(1.0 - share**2))
    expected = 1.0 / (squared * math.tanh(angle))
    assert disturbance_gain_s2(Following(plain, plain, 1e-4, 0.0), 0.0) == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("navigator", [ARDUPILOT, PX4])
def test_no_push_moves_the_follower_farther(navigator: object) -> None:
    following = navigator.following  # type: ignore[attr-defined]
    still = Following(following.horizontal, following.vertical, following.lag_s, 0.15)
    gain_s2, step_s, push_mps2 = disturbance_gain_s2(still, 0.15), 0.01, 1.0
    worst = 0.0
    for period_s in (1.0, 2.0, 3.0, 4.0, 6.0, 9.0, 30.0):
        follower = Follower(still, NavigatorState(0.0, ZERO, ZERO, ZERO, None))
        for number in range(6000):
            follower.step(ZERO, ZERO, ZERO, step_s)
            sign = 1.0 if (number * step_s) % period_s < 0.5 * period_s else -1.0
            follower.velocity[0] += sign * push_mps2 * step_s
            worst = max(worst, abs(follower.position[0]))
    assert 0.6 * gain_s2 < worst <= 1.02 * gain_s2
