"""Pace: absolute, with a limit to what is made up for."""

from __future__ import annotations

import math

import pytest

from sim_bridge.sim.world import CATCH_UP_S, Pace


def test_pace_is_absolute_and_forgives_a_stall():
    pace = Pace(1.0)
    assert pace.wait_s(0.0, 100.0, 2.0) == 0.0
    assert pace.wait_s(1.0, 100.2, 2.0) == pytest.approx(0.3)
    assert pace.wait_s(1.0, 100.5 + 0.5 * CATCH_UP_S, 2.0) == 0.0  # late, to be made up for
    assert pace.wait_s(1.1, 100.5 + 0.5 * CATCH_UP_S, 2.0) == pytest.approx(0.05 - 0.5 * CATCH_UP_S)
    assert pace.wait_s(1.1, 200.0, 2.0) == 0.0  # a stall: starts anew
    assert pace.wait_s(1.3, 200.0, 2.0) == pytest.approx(0.1)
    assert pace.wait_s(9.0, 200.0, math.inf) == 0.0
