"""Followers that listen to each other: one shape in the end, no growing swing along a chain, and broken links."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from gcs.flight.execution import leader_follower
from gcs.flight.execution.leader_follower import (
    LINK_MAX_S,
    REPORT_MAX_S,
    FollowerState,
    FormationFollowing,
    ReportedDeviation,
    SentSetpoints,
)
from gcs.flight.monitoring.monitor import VehicleView
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.formation_table import Topology
from gcs.types import Array
from tests.unit.flight.execution import closed_loop
from tests.unit.flight.execution.closed_loop import FollowerResponse, Link, follow
from tests.unit.flight.execution.test_leader_follower import QUICK, SLOW, recorded

BOUNDS_M: dict[Topology, float] = {"leader": 0.5, "chain": 1.1, "tree": 1.1, "voronoi": 1.1}
CHAIN = (1, 2, 4, 3, 6, 5)  # system ids of the field's vehicles from the leader on


def listening(plan: Plan, topology: Topology) -> Plan:
    formation = plan.scenario.formation.model_copy(update={"topology": topology})
    return replace(plan, scenario=plan.scenario.model_copy(update={"formation": formation}))


@pytest.fixture
def field(plan_of: Callable[[str], Plan]) -> Plan:
    return plan_of("field/scenario.toml")


def along(plan: Plan, off: Array) -> Array:
    """Of followers in the plan's order, in that of the chain."""
    return off[[sysid - 2 for sysid in CHAIN[1:]]]


class CopiedFromTheLeader(FormationFollowing):
    """What followers want when each listens to the leader alone."""

    def _wanted(self, t_s: float) -> tuple[Array, Array]:
        led = self._reported[self._leader].at(self.plan, t_s)
        own = [one.tracking_error(self._t0_unix_s + t_s) for one in self._followers]
        off, rate = (led[n] - np.array([error[n] for error in own]) for n in (0, 1))
        size = np.linalg.norm(off, axis=1, keepdims=True)
        share = 1.0 - leader_follower.IGNORED_M / np.maximum(size, leader_follower.IGNORED_M)
        return share * off, share * rate


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_in_a_star_followers_listen_to_the_leader_alone_to_the_last_bit(
    field: Plan, autopilot: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    star = recorded(listening(field, "leader"), autopilot)
    monkeypatch.setattr(closed_loop, "FormationFollowing", CopiedFromTheLeader)
    copied = recorded(listening(field, "chain"), autopilot)
    assert np.array_equal(star.moved_m, copied.moved_m)
    assert np.abs(star.moved_m).max() > 0.2


@pytest.mark.slow
@pytest.mark.parametrize("topology", ["leader", "chain", "tree", "voronoi"])
@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_recorded_vehicles_keep_the_shape_whomever_they_listen_to(
    field: Plan, autopilot: str, topology: Topology
) -> None:
    flown = recorded(listening(field, topology), autopilot)
    assert flown.shape_m(0.0, 15.0) < BOUNDS_M[topology]


SWING_T_S = np.arange(0.0, 90.0, 0.1)


@pytest.mark.long
@pytest.mark.parametrize("link", [Link(0.05), Link(0.5), Link(0.5, loss=0.4)], ids=["good", "late", "late and lossy"])
@pytest.mark.parametrize("response", [QUICK, SLOW], ids=["quick", "slow"])
@pytest.mark.parametrize("period_s", [8.0, 14.0, 25.0])
def test_a_swing_of_the_leader_shrinks_along_the_chain(
    field: Plan, period_s: float, response: FollowerResponse, link: Link
) -> None:
    t_s, w = SWING_T_S, 2.0 * math.pi / period_s
    led = np.zeros((len(t_s), 6))
    led[:, 0], led[:, 3] = 3.0 * np.sin(w * t_s), 3.0 * w * np.cos(w * t_s)
    flown = follow(listening(field, "chain"), t_s, led, np.zeros((5, len(t_s), 6)), response, link)
    settled = flown.t_s > 30.0
    swing = [np.ptp(one[settled, 0]) for one in (flown.leader_m, *along(field, flown.followers_m))]
    assert swing[1] < swing[0]
    assert all(after <= before for before, after in pairwise(swing))
    assert swing[-1] < 0.8 * swing[0]


def gains(response: FollowerResponse, delay_s: float, rate: float) -> Array:
    """|deviation of a follower / that of whom it listens to| at many frequencies; the vehicle's lag is compensated."""
    s = 1j * np.logspace(-2.5, 1.5, 2000)
    w, b = leader_follower.BANDWIDTH_RADPS, response.bandwidth_radps
    soft = 1.0 / (1.0 + leader_follower.SOFT_S * s) ** 2
    wanted = (w * w + 2.0 * w * rate * s) * soft / (s * s + (w * w + 2.0 * w * s) * soft)
    push = 2.0 * response.damping * b * s
    answer = (b * b + push + response.share * s * s) / (s * s + push + b * b) * np.exp(-response.delay_s * s)
    told = (1.0 + delay_s * s) * np.exp(-delay_s * s)
    return np.abs(answer * wanted * told / (1.0 + wanted * told * (answer - 1.0)))


@pytest.mark.parametrize("response", [QUICK, SLOW], ids=["quick", "slow"])
@pytest.mark.parametrize("delay_s", [0.05, 0.25, 0.6])
def test_no_frequency_is_amplified_where_deviations_are_passed_on(response: FollowerResponse, delay_s: float) -> None:
    assert gains(response, delay_s, leader_follower.RELAYED_RATE).max() < 1.0
    assert gains(response, delay_s, 1.0).max() > 1.3


@pytest.mark.long
@pytest.mark.parametrize("topology", ["leader", "chain", "tree", "voronoi"])
def test_any_initial_deviations_end_in_the_shape(field: Plan, topology: Topology) -> None:
    """Definition 1: the leader stays 3 m off, the followers begin anywhere; each is ignored up to 0.1 m per hop."""
    t_s = np.arange(0.0, 90.0, 0.1)
    led, own = np.zeros((len(t_s), 6)), np.zeros((5, len(t_s), 6))
    led[:, 0], own[:, :, :3] = 3.0, np.random.default_rng(4).uniform(-1.5, 1.5, (5, 1, 3))
    flown = follow(listening(field, topology), t_s, led, own)
    assert flown.shape_m(0.0, 5.0) > 2.0
    hops = {"leader": 1, "chain": 5}.get(topology, 2)
    assert flown.shape_m(75.0, 90.0) < 2.0 * hops * leader_follower.IGNORED_M + 0.05


def reporting(plan: Plan, topology: Topology) -> tuple[FormationFollowing, dict[int, VehicleView], Callable[..., None]]:
    """A fleet, its reports, and how to report: places of the plan at a time, moved north by `off_m`."""
    plan = listening(plan, topology)
    views = {sysid: VehicleView(sysid) for sysid in plan.sysids}
    following = FormationFollowing(plan, 0.0, {i: FollowerState(views[i], SentSetpoints()) for i in plan.sysids[1:]})
    following.lead(views[1])

    def report(t_s: float, *but: int, off_m: dict[int, float] | None = None) -> None:
        states = plan.states(np.array([t_s]))[:, 0]
        for row, sysid in enumerate(plan.sysids):
            if sysid not in but:
                view = views[sysid]
                view.position_ned_m = states[row, POSITION] + [(off_m or {}).get(sysid, 0.0), 0.0, 0.0]
                view.velocity_ned_mps, view.unix_s = states[row, VELOCITY], t_s

    return following, views, report


def test_listeners_of_a_silent_vehicle_take_over_whom_it_listened_to(field: Plan) -> None:
    following, _, report = reporting(field, "chain")
    sysids = field.sysids
    report(20.0)
    assert following.heed(sysids, 20.1) == []
    assert following.graph.sources == ((), (0,), (3,), (1,), (5,), (2,))
    report(20.0 + LINK_MAX_S, 4)
    assert following.heed(sysids, 20.0 + LINK_MAX_S) == []
    (change,) = following.heed(sysids, 20.2 + LINK_MAX_S)
    assert (change.sysid, change.what) == (4, "is not listened to any more")
    assert change.rule == "its last report is 2.2 s old; vehicle 3 listens to vehicle 2"
    assert following.graph.sources == ((), (0,), (1,), (1,), (5,), (2,))
    report(30.0, 4)
    assert following.heed(sysids, 30.0) == []
    report(40.0)
    assert following.heed(sysids, 40.0 + REPORT_MAX_S + 0.1) == []  # not young enough
    report(42.0)
    (change,) = following.heed(sysids, 42.1)
    assert (change.sysid, change.what, change.rule) == (4, "is listened to again", "by vehicle 3")
    assert following.graph.sources[2] == (3,)


def test_a_vehicle_that_leaves_pulls_nobody_along(field: Plan) -> None:
    """Vehicle 4 returns, 30 m off; those behind it stay where they are."""
    following, _, report = reporting(field, "chain")
    report(20.0)
    following.heed(field.sysids, 20.0)
    for t_s in np.arange(20.0, 40.0, 0.1):
        report(float(t_s), off_m={4: 30.0})
        following.heed([1, 2, 3, 5, 6], float(t_s))
        following.advance(float(t_s))
    assert np.abs(following.position_m).max() == 0.0
    following.heed(field.sysids, 40.0)
    following.advance(45.0)
    assert np.abs(following.position_m).max() > 5.0


def test_a_star_is_not_rerouted_and_the_next_leader_gets_its_own_graph(field: Plan) -> None:
    following, _, report = reporting(field, "leader")
    report(20.0)
    assert following.heed([1, 2], 30.0) == []
    assert following.graph.sources == ((), (0,), (0,), (0,), (0,), (0,))

    following, views, report = reporting(field, "chain")
    report(20.0)
    following.heed(field.sysids, 20.0)
    following.lead(views[2])
    report(20.1)
    following.heed([2, 3, 4, 5, 6], 20.1)
    assert following.graph.sources[1] == ()
    assert not any(0 in sources for sources in following.graph.sources)
    assert np.linalg.matrix_power(following.graph.weights, 6)[:, 1] == pytest.approx(1.0)


def test_the_graph_follows_the_shape(plan_of: Callable[[str], Plan]) -> None:
    """It is that of a shape which differs little from the one flown, and it is not made anew for less."""
    following, _, report = reporting(plan_of("changes/scenario.toml"), "chain")
    plan, seen = following.plan, []
    report(plan.t_start_s)
    for t_s in np.arange(plan.t_start_s, plan.t_end_s, 0.5):
        following.advance(float(t_s))
        seen.append(following.graph)
    changes = sum(before != after for before, after in pairwise(seen[1:]))
    assert 1 <= changes <= 10
    assert seen[-1] == plan.information_graph(plan.t_end_s - 1.0)
    assert seen[-1] != plan.information_graph(0.0)


def test_a_deviation_is_that_of_the_own_place(field: Plan) -> None:
    _, views, report = reporting(field, "chain")
    report(50.0, off_m={3: 2.0})
    for sysid, north_m in ((3, 2.0), (4, 0.0)):
        off, _ = ReportedDeviation(views[sysid], sysid - 1, 0.0).at(field, 50.0)
        assert off == pytest.approx([north_m, 0.0, 0.0], abs=1e-9)
