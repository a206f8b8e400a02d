"""Orders that change the plan of a formation in flight: one stream that goes on, refusals, late planners, braking.

The planner is the real one, in this process; its answers come after virtual time.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.errors import FlightError
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.contingency.policy import State
from gcs.flight.execution.plan_orders import NEW_PLAN, PlanOrders
from gcs.flight.monitoring.progress import AskedOrder
from gcs.flight.setup.plan_worker import PlanWorker
from gcs.mission.returns.rtl_altitudes import ReturnPlan, plan_returns
from gcs.plan.plan_changer import ZONES_MAX, Avoid, FlyHome, GoOn, GoTo, Hold, PlanOrder, Scale, Slower
from gcs.plan.replanning.replanner import Replanner
from gcs.plan.trajectory.plan import Plan
from tests.point_fleet import EPOCH_S, PointFleet, flown


class Planner:
    """Answers as the planner's process does, after so much virtual time."""

    def __init__(self, built: Replanner, takes_s: float = 0.3) -> None:
        self.worker, self.takes_s = PlanWorker(built.plan, None), takes_s
        self.worker._changer._replanner = built
        self.made: list[float] = []

    async def call(self, method: str, *args: Any) -> Any:
        if method == "rehearse":
            return {False: 0.3, True: 0.3}
        if method == "change":
            self.made.append(args[1])
            await asyncio.sleep(self.takes_s)
        return getattr(self.worker, method)(*args)

    async def close(self) -> None:
        pass


@pytest.fixture(scope="module")
def built(hop: Plan) -> Replanner:
    return Replanner(hop, spare_disks=ZONES_MAX)


@pytest.fixture(scope="module")
def returns(hop: Plan) -> ReturnPlan:
    return plan_returns(hop, (Autopilot.ARDUPILOT,) * 3)


def ahead(plan: Plan, t_s: float = 18.0, radius_m: float = 3.0) -> Avoid:
    north_m, east_m, _ = plan.leader_trajectory.state(t_s)[:3].tolist()
    return Avoid(north_m, east_m + 1.0, radius_m)


def told(
    planner: Planner,
    returns: ReturnPlan,
    story: Callable[[PointFleet, PlanOrders], Awaitable[None]],
) -> PointFleet:
    async def run(fleet: PointFleet) -> None:
        inner = fleet.executor

        def follow(new: Plan) -> None:
            fleet.monitor.follow(new)
            inner.follow(new)

        orders = PlanOrders(inner._fleet, inner, None, fleet.events.append, follow)
        orders._worker = planner  # type: ignore[assignment]
        beside = asyncio.ensure_future(orders.run())
        await asyncio.sleep(0.5)
        await story(fleet, orders)
        beside.cancel()

    return flown(planner.worker._changer.flown, returns, run, options=FlightOptions(), t_s=3.0)


def test_all_vehicles_change_to_the_new_plan_at_one_instant_without_a_jump(
    hop: Plan, built: Replanner, returns: ReturnPlan
) -> None:
    zone = ahead(hop)

    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        assert orders.ask(zone, "a test") == hop.sysids
        assert "a new plan is flown" in await orders.answer()
        await asyncio.sleep(17.0)

    fleet = told(Planner(built), returns, story)
    (change,) = fleet.told(NEW_PLAN)
    assert change.data is not None
    begins_s = change.data["begins_t_s"]
    t0_s, plan = fleet.monitor.t0_s, fleet.monitor.plan
    assert fleet.streamer.scheduler is not None
    grid = np.array(fleet.streamer.scheduler.grid.t_s)
    for row, point in enumerate(fleet.points.values()):
        at_s = np.array([EPOCH_S + host_s - t0_s for host_s, _ in point.setpoints])
        sent = np.array([motion for _, motion in point.setpoints])
        assert np.diff(at_s).max() < 0.25, "no gap"
        grid_s = grid[np.searchsorted(grid, at_s + 2e-3) - 1]
        assert (at_s - grid_s).max() < 0.06
        for one, part in ((hop, grid_s < begins_s), (plan, grid_s >= begins_s)):
            wanted = one.states(grid_s[part])[row, :, :6]
            np.testing.assert_allclose(sent[part], wanted, atol=2e-5)
        away_m = np.hypot(sent[:, 0] - zone.north_m, sent[:, 1] - zone.east_m) - zone.radius_m
        assert away_m.min() > 0.0
    assert not fleet.told("ordered to"), "nobody left the formation"
    assert set(fleet.executor.policy.states.values()) == {State.FLYING}


def test_a_late_planner_is_asked_again_and_then_refused(hop: Plan, built: Replanner, returns: ReturnPlan) -> None:
    planner = Planner(built, takes_s=2.0)

    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        orders.ask(ahead(hop), "a test")
        await asyncio.sleep(0.5)
        with pytest.raises(FlightError, match="still being asked"):
            orders.ask(Scale(1.2), "a test")
        assert "a new plan is flown" in await orders.answer()

    told(planner, returns, story)
    assert len(planner.made) == 2, "the second attempt knew how long the first took"
    assert planner.made[1] > planner.made[0] + 1.0


def test_a_formation_that_holds_keeps_its_plan(hop: Plan, built: Replanner, returns: ReturnPlan) -> None:
    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        fleet.executor.ask(AskedOrder.HOLD, (), "a test")
        with pytest.raises(FlightError, match="the plan waits") as refused:
            orders.ask(ahead(hop), "a test")
        assert refused.value.hint == "order continue, return or land"

    fleet = told(Planner(built), returns, story)
    assert not fleet.told(NEW_PLAN)
    assert fleet.told("keep their plan")


def test_the_formation_brakes_as_one_before_a_zone_that_no_plan_leads_round(
    hop: Plan, built: Replanner, returns: ReturnPlan
) -> None:
    """In its shape, by a verified plan: it stays in formation, and takes the next order."""
    zone = ahead(hop, 29.5, 10.0)

    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        orders.ask(zone, "a test")
        with pytest.raises(FlightError, match="all brake at"):
            await orders.answer()
        await asyncio.sleep(24.0)
        assert np.linalg.norm([point.velocity_ned_mps for point in fleet.points.values()]) < 0.1
        orders.ask(FlyHome(), "a test")
        assert "a new plan is flown" in await orders.answer()

    fleet = told(Planner(built), returns, story)
    braked, home = fleet.told(NEW_PLAN)
    assert "brake together before the zone, asked by this program" in braked.rule
    assert "fly home together" in home.rule
    assert set(fleet.executor.policy.states.values()) == {State.FLYING}
    for point in fleet.points.values():
        sent = np.array([motion for _, motion in point.setpoints])
        assert np.hypot(sent[:, 0] - zone.north_m, sent[:, 1] - zone.east_m).min() > zone.radius_m


@pytest.mark.parametrize("rehearsed_s", [6.0, 14.0], ids=["a plan before it brakes", "a plan from its hover"])
def test_where_planning_may_take_too_long_the_brake_is_made_first(
    hop: Plan, built: Replanner, returns: ReturnPlan, rehearsed_s: float
) -> None:
    zone, planner = ahead(hop), Planner(built)
    made = planner.call

    async def call(method: str, *args: Any) -> Any:
        return {False: rehearsed_s, True: 0.3} if method == "rehearse" else await made(method, *args)

    planner.call = call  # type: ignore[method-assign]

    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        orders.ask(zone, "a test")
        assert "avoid 3 m" in await orders.answer()
        await asyncio.sleep(45.0)

    fleet = told(planner, returns, story)
    assert [change.rule.split(",")[0] for change in fleet.told(NEW_PLAN)] == [
        "brake together before the zone",
        str(zone).split(",")[0],
    ]
    assert set(fleet.executor.policy.states.values()) == {State.FLYING}
    ends = fleet.monitor.plan.states(np.array([fleet.monitor.plan.landing_s - 0.1]))[:, 0, :2]
    np.testing.assert_allclose(ends, hop.states(np.array([hop.landing_s - 0.1]))[:, 0, :2], atol=0.01)
    for point in fleet.points.values():
        sent = np.array([motion for _, motion in point.setpoints])
        assert np.hypot(sent[:, 0] - zone.north_m, sent[:, 1] - zone.east_m).min() > zone.radius_m


def test_each_vehicle_brakes_by_itself_where_the_formation_cannot(
    hop: Plan, built: Replanner, returns: ReturnPlan
) -> None:
    zone, planner = ahead(hop, 29.5, 10.0), Planner(built)
    made = planner.call

    async def call(method: str, *args: Any) -> Any:
        if method == "change" and isinstance(args[0], Hold):
            raise FlightError("no plan.", hint="")
        return await made(method, *args)

    planner.call = call  # type: ignore[method-assign]

    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        orders.ask(zone, "a test")
        with pytest.raises(FlightError, match="all brake at"):
            await orders.answer()
        await asyncio.sleep(24.0)
        with pytest.raises(FlightError, match="enters the new no-fly zone"):
            fleet.executor.ask(AskedOrder.CONTINUE, (), "a test")
        with pytest.raises(FlightError, match="the plan waits") as refused:
            orders.ask(GoOn(), "a test")
        assert refused.value.hint == "order return or land"

    fleet = told(planner, returns, story)
    assert set(fleet.executor.policy.states.values()) == {State.WAITING}
    for point in fleet.points.values():
        assert np.hypot(point.position_ned_m[0] - zone.north_m, point.position_ned_m[1] - zone.east_m) > zone.radius_m


def test_orders_one_after_another_are_one_stream_without_a_jump(
    hop: Plan, built: Replanner, returns: ReturnPlan
) -> None:
    """Slower, at its own speed again, to a hover, elsewhere, and back to the plan."""
    steps: tuple[tuple[PlanOrder, float], ...] = (
        *((Slower(0.6), 4.0), (GoOn(), 3.0), (Hold(), 9.0), (GoTo(20.0, 15.0, 10.0), 25.0)),
        (GoOn(), 5.0),
    )

    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        for order, then_s in steps:
            orders.ask(order, "a test")
            assert "a new plan is flown" in await orders.answer()
            await asyncio.sleep(then_s)

    fleet = told(Planner(built), returns, story)
    assert [change.rule.split(", asked by")[0] for change in fleet.told(NEW_PLAN)] == [str(order) for order, _ in steps]
    assert set(fleet.executor.policy.states.values()) == {State.FLYING}
    assert fleet.streamer.scheduler is not None
    for row, point in enumerate(fleet.points.values()):
        at_s = np.array([EPOCH_S + host_s - fleet.monitor.t0_s for host_s, _ in point.setpoints])
        sent = np.array([motion for _, motion in point.setpoints])
        assert np.diff(at_s).max() < 0.25, "no gap"
        grid = np.array(fleet.streamer.scheduler.grid.t_s)
        grid_s = grid[np.searchsorted(grid, at_s + 2e-3) - 1]
        np.testing.assert_allclose(sent, fleet.monitor.plan.states(grid_s)[row, :, :6], atol=2e-5)
        assert np.abs(np.diff(sent[:, 3:6], axis=0)).max() < 0.8, "at most 3 m/s² between two setpoints at 4 Hz"


def test_an_order_that_nothing_answers_leaves_the_plan(hop: Plan, built: Replanner, returns: ReturnPlan) -> None:
    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        orders.ask(GoOn(), "a test")
        with pytest.raises(FlightError, match="flies its plan"):
            await orders.answer()

    assert not told(Planner(built), returns, story).told(NEW_PLAN)
