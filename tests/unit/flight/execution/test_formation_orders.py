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
from gcs.errors import FlightError, PlanningError
from gcs.flight.contingency.choices import OnLoss
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.contingency.policy import State
from gcs.flight.execution.plan_orders import NEW_PLAN, PlanOrders
from gcs.flight.monitoring.progress import AskedOrder
from gcs.flight.setup.own_process import OwnProcessEnded
from gcs.flight.setup.plan_worker import WAIT_S, PlanWorker
from gcs.mission.returns.rtl_altitudes import ReturnPlan, plan_returns
from gcs.plan.formation_orders import Avoid, FlyHome, GoOn, GoTo, Hold, PlanOrder, Scale, Slower
from gcs.plan.formation_return import plan_return
from gcs.plan.plan_changer import ZONES_MAX
from gcs.plan.prepared_returns import PreparedReturn, PreparedReturns
from gcs.plan.replanning.replanner import Replanner
from gcs.plan.trajectory.plan import Plan
from tests.point_fleet import EPOCH_S, PointFleet, flown


class Planner:
    """Answers as the planner's process does, after so much virtual time."""

    def __init__(self, built: Replanner, takes_s: float = 0.3) -> None:
        self.worker, self.takes_s = PlanWorker(built.plan, None), takes_s
        self.worker._changer._replanner = built
        self.made: list[float] = []
        self.dies_at = ""  # a method, of which the process ends without an answer
        self._next: Callable[[], PlanWorker] = lambda: PlanWorker(built.plan, None)

    def next_makes(self, make: Callable[..., PlanWorker], *args: Any) -> None:
        self._next = lambda: make(*args)

    async def call(self, method: str, *args: Any) -> Any:
        if method == self.dies_at:
            self.dies_at, self.worker = "", self._next()
            raise OwnProcessEnded("the planner's process ended without an answer")
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


@pytest.fixture(scope="module")
def prepared(hop: Plan) -> PreparedReturns:
    return PreparedReturns((PreparedReturn(12.0, plan_return(hop, 12.0), cpu_s=2.0),))


def ahead(plan: Plan, t_s: float = 18.0, radius_m: float = 3.0) -> Avoid:
    north_m, east_m, _ = plan.leader_trajectory.state(t_s)[:3].tolist()
    return Avoid(north_m, east_m + 1.0, radius_m)


def told(
    planner: Planner,
    returns: ReturnPlan,
    story: Callable[[PointFleet, PlanOrders], Awaitable[None]],
    *,
    options: FlightOptions | None = None,
    never_heard: int | None = None,
) -> PointFleet:
    async def run(fleet: PointFleet) -> None:
        inner = fleet.executor
        if never_heard is not None:
            inner.never_heard(never_heard)
            fleet.points[never_heard].silent = True
            fleet.monitor.views[never_heard].position_ned_m = np.full(3, np.nan)

        def follow(new: Plan) -> None:
            fleet.monitor.follow(new)
            inner.follow(new)

        orders = PlanOrders(inner._fleet, inner, None, fleet.events.append, follow)
        orders._worker = planner  # type: ignore[assignment]
        beside = asyncio.ensure_future(orders.run())
        await asyncio.sleep(0.5)
        await story(fleet, orders)
        beside.cancel()

    return flown(planner.worker._changer.flown, returns, run, options=options or FlightOptions(), t_s=3.0)


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
        for order, hint in ((Slower(0.9), "order continue, return or land"), (ahead(hop), "order return or land")):
            with pytest.raises(FlightError, match="the plan waits") as refused:
                orders.ask(order, "a test")
            assert refused.value.hint == hint

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


def same_stream(fleet: PointFleet) -> None:
    """What every vehicle was sent is the plan as flown, without a gap or a jump."""
    assert fleet.streamer.scheduler is not None
    grid = np.array(fleet.streamer.scheduler.grid.t_s)
    for row, point in enumerate(fleet.points.values()):
        at_s = np.array([EPOCH_S + host_s - fleet.monitor.t0_s for host_s, _ in point.setpoints])
        sent = np.array([motion for _, motion in point.setpoints])
        assert np.diff(at_s).max() < 0.25, "no gap"
        grid_s = grid[np.searchsorted(grid, at_s + 2e-3) - 1]
        np.testing.assert_allclose(sent, fleet.monitor.plan.states(grid_s)[row, :, :6], atol=2e-5)
        assert np.abs(np.diff(sent[:, 3:6], axis=0)).max() < 0.8, "at most 3 m/s² between two setpoints at 4 Hz"


def test_the_formation_goes_over_to_a_return_that_was_prepared_without_planning(
    hop: Plan, built: Replanner, returns: ReturnPlan, prepared: PreparedReturns
) -> None:
    planner = Planner(built)
    planner.worker._returns = prepared

    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        asked_s = fleet.t_s
        orders.ask(FlyHome(), "a test")
        assert "prepared before the flight" in await orders.answer()
        assert fleet.t_s - asked_s < 1.0
        await asyncio.sleep(20.0)

    fleet = told(planner, returns, story)
    (change,) = fleet.told(NEW_PLAN)
    assert change.data is not None
    assert change.data["begins_t_s"] == 12.0
    assert not planner.made
    same_stream(fleet)


def test_a_formation_that_waits_for_its_return_holds_and_goes_on_home(
    hop: Plan, built: Replanner, returns: ReturnPlan, prepared: PreparedReturns
) -> None:
    planner = Planner(built)
    planner.worker._returns = prepared

    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        for order, then_s in ((FlyHome(), 0.1), (Hold(), 12.0), (GoOn(), 25.0)):
            orders.ask(order, "a test")
            assert "a new plan is flown" in await orders.answer()
            await asyncio.sleep(then_s)

    fleet = told(planner, returns, story)
    assert len(fleet.told(NEW_PLAN)) == 3
    same_stream(fleet)
    ends = fleet.monitor.plan.states(np.array([fleet.monitor.plan.landing_s - 0.1]))[:, 0, :2]
    np.testing.assert_allclose(ends, hop.pads_ned_m[:, :2], atol=0.1)


@pytest.mark.parametrize("why", ["it flies otherwise by then", "it begins too late"])
def test_a_return_is_planned_where_the_prepared_ones_do_not_fit(
    hop: Plan, built: Replanner, returns: ReturnPlan, prepared: PreparedReturns, why: str
) -> None:
    planner = Planner(built)
    planner.worker._returns = prepared
    if why == "it begins too late":
        (one,) = prepared.returns
        planner.worker._returns = PreparedReturns((PreparedReturn(3.0 + WAIT_S + 5.0, one.plan),))

    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        steps: tuple[PlanOrder, ...] = (Slower(0.6), FlyHome()) if why.startswith("it flies") else (FlyHome(),)
        for order in steps:
            orders.ask(order, "a test")
            assert "planned and verified" in await orders.answer()

    fleet = told(planner, returns, story)
    assert "fly home together" in fleet.told(NEW_PLAN)[-1].rule


def test_a_prepared_return_is_flown_also_late_where_none_is_found(
    hop: Plan, built: Replanner, returns: ReturnPlan
) -> None:
    planner = Planner(built)
    planner.worker._returns = PreparedReturns((PreparedReturn(20.5, plan_return(hop, 20.5)),))
    made = planner.call

    async def call(method: str, *args: Any) -> Any:
        if method == "change":
            raise PlanningError("no way", hint="")
        return await made(method, *args)

    planner.call = call  # type: ignore[method-assign]

    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        orders.ask(FlyHome(), "a test")
        assert "a new plan is flown from t = 20.50 s" in await orders.answer()

    told(planner, returns, story)


def outside(fleet: PointFleet, zone: Avoid, sysids: tuple[int, ...] = (1, 2, 3)) -> bool:
    """Whether no setpoint of these vehicles was in a zone."""
    sent = np.concatenate([np.array([one for _, one in fleet.points[sysid].setpoints]) for sysid in sysids])
    return bool((np.hypot(sent[:, 0] - zone.north_m, sent[:, 1] - zone.east_m) > zone.radius_m).all())


def test_a_zone_counts_also_while_no_new_plan_can_be_made_and_a_vehicle_that_returns_is_left_at_that(
    hop: Plan, built: Replanner, returns: ReturnPlan
) -> None:
    zone = ahead(hop, 22.0, 6.0)

    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        fleet.executor.ask(AskedOrder.RETURN, (2,), "a test")
        with pytest.raises(FlightError, match=r"vehicle 2 is returning; all brake at t = "):
            orders.ask(zone, "a test")
        await asyncio.sleep(20.0)

    fleet = told(Planner(built), returns, story)
    states = fleet.executor.policy.states
    assert (states[1], states[3]) == (State.WAITING, State.WAITING)
    assert states[2] is not State.WAITING
    assert outside(fleet, zone)


def test_a_zone_counts_that_is_given_while_another_order_is_planned(
    hop: Plan, built: Replanner, returns: ReturnPlan
) -> None:
    zone = ahead(hop, 25.0, 6.0)

    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        orders.ask(Slower(0.9), "a test")
        with pytest.raises(FlightError, match="still being asked"):
            orders.ask(zone, "a test")
        assert "a new plan is flown" in await orders.answer()
        await asyncio.sleep(28.0)

    fleet = told(Planner(built), returns, story)
    assert set(fleet.executor.policy.states.values()) == {State.WAITING}
    assert outside(fleet, zone)


def test_a_zone_that_is_given_while_the_plan_waits_counts_when_it_goes_on(
    hop: Plan, built: Replanner, returns: ReturnPlan
) -> None:
    """By the clock the plan had passed it: the plan's time goes back by as long as it waited."""
    zone = ahead(hop, 20.0, 5.0)

    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        fleet.executor.ask(AskedOrder.HOLD, (), "a test")
        await asyncio.sleep(22.0)
        with pytest.raises(FlightError, match="the plan waits"):
            orders.ask(zone, "a test")
        fleet.executor.ask(AskedOrder.CONTINUE, (), "a test")
        await asyncio.sleep(25.0)

    fleet = told(Planner(built), returns, story)
    assert fleet.told("were asked to continue"), "it did go on"
    assert set(fleet.executor.policy.states.values()) == {State.WAITING}
    assert outside(fleet, zone)


def test_a_vehicle_returns_by_itself_round_a_zone_that_no_plan_leads_round(
    hop: Plan, built: Replanner, returns: ReturnPlan
) -> None:
    """It lies behind the formation, on the straight way home."""
    zone = ahead(hop, 10.0, 4.0)

    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        await asyncio.sleep(16.0)
        fleet.executor.ask(AskedOrder.HOLD, (1,), "a test")
        before = {sysid: len(point.setpoints) for sysid, point in fleet.points.items()}
        with pytest.raises(FlightError, match="vehicle 1 is waiting"):
            orders.ask(zone, "a test")
        fleet.executor.ask(AskedOrder.RETURN, (), "a test")
        await asyncio.sleep(40.0)
        for sysid, point in fleet.points.items():
            del point.setpoints[: before[sysid]]

    fleet = told(Planner(built), returns, story)
    assert outside(fleet, zone)


def test_a_failure_of_closing_ranks_does_not_keep_the_formation_from_braking(
    hop: Plan, built: Replanner, returns: ReturnPlan
) -> None:
    zone = ahead(hop, 22.0, 6.0)

    def fails() -> None:
        raise ValueError("a place that is no number")

    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        orders._close_ranks = fails  # type: ignore[method-assign]
        fleet.executor.ask(AskedOrder.RETURN, (2,), "a test")
        with pytest.raises(FlightError):
            orders.ask(zone, "a test")
        await asyncio.sleep(20.0)

    fleet = told(Planner(built), returns, story)
    assert outside(fleet, zone)
    assert [event.rule for event in fleet.told("not looked after")] == ["ValueError: a place that is no number"], "once"


def test_ranks_do_not_close_for_a_vehicle_that_was_lost_before_this_process_began(
    hop: Plan, built: Replanner, returns: ReturnPlan
) -> None:
    """Where it is nobody knows."""

    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        await asyncio.sleep(1.0)

    fleet = told(Planner(built), returns, story, options=FlightOptions(on_loss=OnLoss.CLOSE), never_heard=3)
    assert not fleet.told("not looked after")
    assert not fleet.told("close ranks")


@pytest.mark.parametrize("dies_at", ["change", "adopt"])
def test_a_planner_that_ends_is_followed_by_one_that_knows_what_is_flown(
    hop: Plan, built: Replanner, returns: ReturnPlan, dies_at: str
) -> None:
    planner = Planner(built)

    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        orders.ask(Slower(0.6), "a test")
        await orders.answer()
        planner.dies_at = dies_at
        orders.ask(Hold(), "a test")
        if dies_at == "change":
            with pytest.raises(FlightError, match="ended without an answer"):
                await orders.answer()
            await asyncio.sleep(2.0)
            orders.ask(Hold(), "a test")
        assert "a new plan is flown" in await orders.answer()
        await asyncio.sleep(12.0)
        orders.ask(GoOn(), "a test")
        assert "a new plan is flown" in await orders.answer()
        await asyncio.sleep(5.0)

    fleet = told(planner, returns, story)
    assert [change.rule.split(", asked by")[0] for change in fleet.told(NEW_PLAN)] == [
        *map(str, (Slower(0.6), Hold(), GoOn()))
    ]
    same_stream(fleet)


def test_a_planner_that_does_not_come_to_an_end_keeps_no_later_order_waiting(
    hop: Plan, built: Replanner, returns: ReturnPlan
) -> None:
    planner = Planner(built, takes_s=1000.0)

    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        orders.ask(Scale(1.1), "a test")
        with pytest.raises(FlightError, match="no plan was found in 100 s"):
            await orders.answer()
        assert orders.ask(Hold(), "a test") == hop.sysids

    told(planner, returns, story)


def test_ways_back_of_a_plan_that_was_replaced_meanwhile_are_not_taken(
    hop: Plan, built: Replanner, returns: ReturnPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They could lead through a zone that the next plan was made for."""

    async def soon(*_: object) -> ReturnPlan:
        await asyncio.sleep(4.0)
        return returns

    monkeypatch.setattr("gcs.flight.execution.plan_orders.in_own_process", soon)
    planner, taken = Planner(built), []
    made = planner.call

    async def call(method: str, *args: Any) -> Any:
        if method == "adopt" and taken == [None]:
            await asyncio.sleep(6.0)
        return await made(method, *args)

    planner.call = call  # type: ignore[method-assign]

    async def story(fleet: PointFleet, orders: PlanOrders) -> None:
        fleet.executor.return_from = lambda plan, *_: taken.append(plan)  # type: ignore[method-assign]
        orders.ask(Slower(0.9), "a test")
        await orders.answer()
        taken.append(None)
        await asyncio.sleep(1.0)
        orders.ask(GoOn(), "a test")
        await orders.answer()
        await asyncio.sleep(12.0)
        assert taken == [None, fleet.monitor.plan]

    told(planner, returns, story)
