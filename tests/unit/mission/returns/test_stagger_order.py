"""The order of return altitudes does not depend on the last bits of a plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gcs.mission.returns.rtl_altitudes import SEARCHED_MAX, stagger_order
from gcs.mission.returns.rtl_cases import Returning, ReturnSpeeds, ReturnTo, return_cases
from gcs.plan.trajectory.plan import Plan

SPEEDS = ReturnSpeeds(climb_mps=2.0, cruise_mps=3.5, sink_mps=2.0, wait_s=5.0)
SEPARATION_M, NOISE = 0.4, 1e-12


def noisy(case: Returning, seed: int) -> Returning:
    """The same returns with other last bits."""
    chance = np.random.default_rng(seed)

    def moved(places: np.ndarray) -> np.ndarray:
        return places * (1.0 + NOISE * chance.uniform(-1.0, 1.0, places.shape))

    return replace(case, from_ned_m=moved(case.from_ned_m), to_ned_m=moved(case.to_ned_m))


def orders(cases: list[Returning], levels_m: np.ndarray) -> set[tuple[int, ...]]:
    """The orders found for eight sets of last bits."""
    return {
        tuple(stagger_order([noisy(case, seed) for case in cases], levels_m, SEPARATION_M).tolist())
        for seed in range(8)
    }


def test_last_bits_do_not_choose_among_equally_good_orders(plan_of: Callable[[str], Plan]) -> None:
    """Two pads of Simulation 1 are 0.5 m apart, which limits many orders alike."""
    plan = plan_of("simulation1/scenario.toml")
    cases = return_cases(plan, plan.autopilots, SPEEDS, 8.0)
    homes_m = -plan.pads_ned_m[:, 2]
    levels_m = np.ceil(17.0 + 2.0 * np.arange(len(homes_m))[:, None] - homes_m)
    assert len(orders(cases, levels_m)) == 1


@pytest.mark.parametrize("rear", [0, 1])
def test_beyond_enough_separations_no_order_is_better(rear: int) -> None:
    """The rear vehicle passes under the one ahead, which still climbs, or over it: both are far enough apart."""
    starts = np.array([[0.0, 0.0, -10.0], [10.0, 0.0, -10.0]])[[rear, 1 - rear]][:, None]
    ends = starts * np.array([1.0, 1.0, 0.0]) + np.array([100.0, 0.0, 0.0])
    case = Returning(ReturnTo.HOME, np.zeros(1), starts, ends, np.zeros((2, 1)), SPEEDS)
    levels_m = np.array([[12.0, 12.0], [20.0, 20.0]])
    assert stagger_order([case], levels_m, SEPARATION_M).tolist() == [0, 1]
    near = stagger_order([case], levels_m, 100.0)  # here every metre counts
    assert near.tolist() == ([1, 0] if rear == 0 else [0, 1])


@pytest.mark.parametrize("vehicles", [9, pytest.param(SEARCHED_MAX, marks=pytest.mark.slow)])
def test_many_vehicles_far_apart_keep_their_own_order(plan_of: Callable[[str], Plan], vehicles: int) -> None:
    """Beyond `ENOUGH` separations no order is better than another."""
    plan = plan_of("simulation1/scenario.toml")
    case = return_cases(plan, plan.autopilots, SPEEDS, 60.0)[0]
    apart_m = 30.0 * np.arange(vehicles)[:, None, None] * np.array([0.6, 0.8, 0.0])
    fleet = replace(
        case,
        from_ned_m=case.from_ned_m[:1] + apart_m,
        to_ned_m=case.to_ned_m[:1] + apart_m * np.array([1.0, 1.1, 1.0]),
        datum_m=np.repeat(case.datum_m[:1], vehicles, axis=0),
        waits_s=None,
    )
    levels_m = np.repeat(20.0 + 2.0 * np.arange(vehicles)[:, None], vehicles, axis=1)
    assert orders([fleet], levels_m) == {tuple(range(vehicles))}
