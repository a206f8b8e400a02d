"""Returns of random fleets: separated from any instant, or none at all; never a vehicle with itself."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.autopilots.traits import Autopilot
from gcs.mission.machine_independent import rounded_down
from gcs.mission.returns.fence_rally import build_safety
from gcs.mission.returns.return_lanes import LEVELS
from gcs.mission.returns.rtl_altitudes import ReturnPlan, _nearest_in_formation, return_warnings
from gcs.mission.returns.rtl_cases import Returning, ReturnSpeeds, ReturnTo, pair_distances, return_cases
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.navigation_error import judged_separation_m
from tests.unit.mission.returns.test_pair_returns import ENDS_S, flown

PAD_M = 10.0  # between the pads of `flown`, on a line


def upright(scenario: Scenario, seed: int, vehicles: int) -> Plan:
    """An upright figure that hovers north of pads. In odd ones vehicles cross, to land on each other's pads."""
    random = np.random.default_rng(seed)
    figure = np.zeros((vehicles, 3))
    figure[:, 1] = random.permutation(PAD_M * 0.3 * np.arange(vehicles))
    figure[:, 2] = -random.integers(0, 8, vehicles) * 3.0
    figure -= figure[0]
    still = PPoly(np.ones((1, 1, 1)), [0.0, ENDS_S])
    leader = np.zeros((1, 1, 3))
    leader[0, 0] = 40.0, 30.0, -30.0
    pads = flown(scenario, leader, np.array([0.0, ENDS_S]), still, figure[None]).pads_ned_m
    places = random.permutation(vehicles)
    home = pads[places] - pads[places[0]] if seed % 2 else figure
    share = PPoly(np.array([[[0.0, 0.0], [0.1, -0.1]], [[1.0, 0.0], [0.0, 1.0]]]), [0.0, ENDS_S - 10.0, ENDS_S])
    over_pad = {"position_m": [*pads[places[0], :2].tolist(), 5.0]}
    return flown(scenario, leader, np.array([0.0, ENDS_S]), share, np.stack([figure, home]), end=over_pad)


def seen_m(plan: Plan, firmware: Autopilot, returns: ReturnPlan) -> float:
    """The least distance of any two vehicles, from instants 0.4 s apart."""
    cases = return_cases(plan, firmware, returns.speeds, 0.4, rally_ned_m=np.array(returns.rally_ned_m))
    found = np.inf
    for case in cases:
        motions = [case.motion(row, altitude_m) for row, altitude_m in enumerate(returns.altitudes_m)]
        for first, second in itertools.combinations(motions, 2):
            found = min(found, float(pair_distances(first, second).min()))
    return found


@pytest.mark.parametrize("firmware", list(Autopilot))
@pytest.mark.parametrize(("seed", "vehicles"), [(1, 3), (2, 5), (3, 5), (5, 16), (6, 16)])
def test_returns_are_separated_or_absent(simulation1: Scenario, seed: int, vehicles: int, firmware: Autopilot) -> None:
    plan = upright(simulation1, seed, vehicles)
    safety = build_safety(plan, firmware)
    returns, required_m = safety.returns, judged_separation_m(plan.scenario)
    for worst in (returns.worst, returns.routed):
        assert worst is not None
        assert worst.sysids[0] < worst.sysids[1]
        assert worst.proved_m is None or rounded_down(worst.proved_m, 3) >= 0.0
    told = " ".join(return_warnings(plan, returns, firmware))
    ends_m = np.concatenate([plan.pads_ned_m[:, None], np.array(returns.rally_ned_m)], axis=1)[..., :2]
    for first, second in itertools.combinations(ends_m, 2):  # whichever end each of them chooses
        away_m = np.linalg.norm(first[:, None] - second[None], axis=-1).min()
        assert away_m >= plan.scenario.limits.separation_min_m - 1e-6
    names = {name for parameters in safety.parameters for name, _ in parameters}
    if returns.separated:
        assert seen_m(plan, firmware, returns) >= required_m - 1e-3
        assert all(safety.rally)
        assert names >= {"RTL_ALT"} or names >= {"RTL_RETURN_ALT"}
    else:
        assert "no vehicle is given a return" in told
        assert not any(safety.rally)
        assert not any(name.startswith("RTL_") for name in names)
        assert names & {"FENCE_ALT_MAX", "GF_MAX_VER_DIST"}


@pytest.mark.parametrize("seed", range(4))
def test_vehicles_at_one_place_are_two_vehicles(simulation1: Scenario, seed: int) -> None:
    """Three of twenty end where others do: the nearest pair are two of them, not one of them with itself."""
    random = np.random.default_rng(seed)
    plan = upright(simulation1, 0, 20)
    start = np.repeat(30.0 * np.arange(20.0)[:, None, None], 3, axis=2) * [1.0, 0.0, 0.0] - [0.0, 0.0, 20.0]
    end = start * [1.0, 0.0, 0.0] + [0.0, 40.0, 0.0]
    together = random.choice(20, 4, replace=False)
    end[together] = end[together[0]]
    case = Returning(ReturnTo.HOME, np.zeros(1), start, end, np.zeros((20, 1)), ReturnSpeeds(2.0, 5.0, 1.5, 5.0))
    found = _nearest_in_formation(plan, case, np.full(20, 30.0))
    assert found.distance_m < 1e-6
    assert found.sysids[0] < found.sysids[1]
    assert set(found.sysids) <= {plan.sysids[row] for row in together}


def test_an_upright_figure_returns_in_lanes(simulation1: Scenario) -> None:
    """Two dozen vehicles that would meet at one altitude have a few, not one for each vehicle."""
    plan = upright(simulation1, 6, 24)
    returns = build_safety(plan, Autopilot.ARDUPILOT).returns
    assert returns.separated
    assert 1 < len(set(returns.altitudes_m)) <= LEVELS
    assert returns.worst is not None
    assert returns.worst.proved_m is not None
    assert returns.worst.proved_m >= judged_separation_m(plan.scenario)
    assert seen_m(plan, Autopilot.ARDUPILOT, returns) >= returns.worst.proved_m
