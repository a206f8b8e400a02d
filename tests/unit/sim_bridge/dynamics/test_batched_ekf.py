"""filterpy's filter over stacks is as many of filterpy's filters."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter

from sim_bridge.dynamics.batched_ekf import BatchedEkf, Stack

VEHICLES, STATES = 5, 7


def covariances(rng):
    root = rng.standard_normal((VEHICLES, STATES, STATES))
    return root @ root.transpose(0, 2, 1) + np.eye(STATES)


@pytest.mark.parametrize("sensors", [1, 3])
def test_every_vehicle_has_what_a_filter_of_its_own_would_have(sensors):
    rng = np.random.default_rng(1)
    fleet, singles = BatchedEkf(VEHICLES, STATES), [ExtendedKalmanFilter(STATES, sensors) for _ in range(VEHICLES)]
    start, noise = covariances(rng), 0.1 * np.eye(STATES)
    fleet.P = Stack.of(start.copy())
    for single, p in zip(singles, start, strict=True):
        single.P, single.Q = p, noise
    h, r = rng.standard_normal((sensors, STATES)), np.diag(rng.uniform(0.5, 2.0, sensors))
    for k in range(6):
        means, transition = rng.standard_normal((VEHICLES, STATES)), rng.standard_normal((VEHICLES, STATES, STATES))
        who = rng.random(VEHICLES) < (1.0, 0.6, 0.0)[k % 3]
        measured = rng.standard_normal((VEHICLES, sensors))
        fleet.carry_on(means, transition, noise)
        expected_spread = fleet.spread(h)
        fleet.correct(who, measured, h, r)
        for i, single in enumerate(singles):
            single.F = transition[i]
            single.predict()
            single.x = means[i]
            assert np.allclose(expected_spread[i], np.diag(h @ single.P @ h.T))
            if who[i]:
                single.update(measured[i], lambda x: h, lambda x: h @ x, r)
            assert np.allclose(fleet.means[i], single.x)
            assert np.allclose(fleet.P[i], single.P)
            assert np.allclose(fleet.variances[i], np.diag(single.P))


def test_a_vehicle_is_not_touched_by_its_neighbours():
    """Bit by bit: the estimate of a vehicle does not depend on other vehicles, or on their measurements."""
    rng = np.random.default_rng(2)
    p, f, h = covariances(rng), rng.standard_normal((VEHICLES, STATES, STATES)), np.eye(2, STATES)
    found = []
    for rows in (range(VEHICLES), range(1), (0, 3)):
        fleet = BatchedEkf(len(rows), STATES)
        fleet.P = Stack.of(p[list(rows)].copy())
        fleet.carry_on(np.ones((len(rows), STATES)), f[list(rows)], np.eye(STATES))
        who = np.ones(len(rows), dtype=bool)
        who[1:] = len(rows) != 2
        fleet.correct(who, np.zeros((len(rows), 2)), h, np.eye(2))
        found.append((fleet.means[0].tobytes(), np.asarray(fleet.P[0]).tobytes()))
    assert len(set(found)) == 1
