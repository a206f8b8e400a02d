"""Emulated time and a ground station that is late: waited for, given up, and waited for again."""

from __future__ import annotations

from sim_bridge.sim.world import REMIND_S, TIMEOUT_S, Lockstep

LATE_S = 100.0 + TIMEOUT_S


def test_who_knows_how_it_goes_on_waits_for_nothing():
    assert Lockstep().wait_s({}, 100.0) == 0.0


def test_patience_ends_once_and_for_all_who_wait():
    patience = Lockstep()
    assert 0.0 < patience.wait_s({0: 5.0, 2: 5.0}, 100.0) < 2.0 * REMIND_S
    assert patience.wait_s({0: 5.0, 2: 5.0}, LATE_S - 0.01) > 0.0
    assert patience.wait_s({0: 5.0, 2: 5.0}, LATE_S) == 0.0
    assert patience.wait_s({0: 5.0, 2: 5.0}, LATE_S + 0.01) == 0.0


def test_one_that_was_given_up_is_waited_for_as_soon_as_anything_newer_comes():
    patience = Lockstep()
    patience.wait_s({0: 5.0, 1: 5.0}, 100.0)
    assert patience.wait_s({0: 5.0, 1: 5.0}, LATE_S) == 0.0
    assert patience.wait_s({0: 5.0, 1: 5.2}, LATE_S + 0.1) > 0.0  # still late, but it goes on
    assert patience.wait_s({0: 5.0}, LATE_S + 0.2) == 0.0
    assert patience.wait_s({0: 5.0, 1: 5.4}, LATE_S + 0.3) > 0.0
    assert patience.wait_s({0: 5.0, 1: 5.4}, LATE_S + 0.3 + TIMEOUT_S - 0.01) > 0.0  # the whole of it again
    assert patience.wait_s({0: 5.0, 1: 5.4}, LATE_S + 0.3 + TIMEOUT_S) == 0.0


def test_the_ground_station_is_reminded_while_it_is_waited_for():
    patience = Lockstep()
    assert not patience.reminds(100.0)
    patience.wait_s({0: 5.0}, 100.0)
    assert not patience.reminds(100.0 + 0.9 * REMIND_S)
    assert patience.reminds(100.0 + REMIND_S)
    assert not patience.reminds(100.0 + 1.5 * REMIND_S)
    assert patience.reminds(100.0 + 2.0 * REMIND_S)
    patience.wait_s({}, 100.0 + 2.5 * REMIND_S)
    assert not patience.reminds(200.0)
