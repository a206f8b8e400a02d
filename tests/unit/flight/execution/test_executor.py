"""The contingency policy at work over a formation of points: what is told, what is ordered, where vehicles are led.

Expected are the table of rules in docs/flying.md, modes of ArduCopter, and places of the scenario.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gcs.errors import FlightError
from gcs.flight.contingency.choices import FlightMode, OnLeaderLoss, OnLoss
from gcs.flight.contingency.conflict_prediction import Conflict
from gcs.flight.contingency.detection import DetectionLimits
from gcs.flight.contingency.energy_choice import Outcome
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.contingency.policy import State
from gcs.flight.execution.executor import ContingencyExecutor
from gcs.flight.execution.position_checks import PositionChecks
from gcs.flight.monitoring.progress import AskedOrder, flown_plan_time
from gcs.mission.returns.return_routes import ReturnRoutes
from gcs.mission.returns.rtl_altitudes import ReturnPlan
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array
from tests.point_fleet import ARDUPILOT, EPOCH_S, PILOTS_MODE, PointFleet, flown

GUIDED, LAND, RTL, AUTO = 4, 9, 6, 3
Story = Callable[[PointFleet], Awaitable[None]]
CONTINUE = FlightOptions(on_loss=OnLoss.CONTINUE)


def words(fleet: PointFleet, sysid: int) -> list[str]:
    return [event.what for event in fleet.events if event.sysid == sysid]


def after(seconds: float, act: Callable[[PointFleet], None], then_s: float) -> Story:
    """A story in which one thing happens."""

    async def story(fleet: PointFleet) -> None:
        await asyncio.sleep(seconds)
        act(fleet)
        await asyncio.sleep(then_s)

    return story


def set_all(fleet: PointFleet, sysids: tuple[int, ...], **values: object) -> None:
    for sysid in sysids:
        for name, value in values.items():
            setattr(fleet.points[sysid], name, value)


def planned(plan: Plan, t_s: float) -> Array:
    """Planned positions (V, 3)."""
    return plan.states(np.array([t_s]))[:, 0, POSITION]


def test_of_an_undisturbed_formation_nothing_is_told(hop: Plan, hop_returns: ReturnPlan) -> None:
    fleet = flown(hop, hop_returns, lambda _: asyncio.sleep(4.0))
    assert (fleet.events, fleet.error) == ([], None)
    assert not fleet.executor.over.is_set()
    assert not fleet.executor.waits
    assert tuple(fleet.monitor.in_formation) == tuple(fleet.monitor.aloft) == (1, 2, 3)
    assert [point.modes_ordered for point in fleet.points.values()] == [[], [], []]
    places = np.array([point.position_ned_m for point in fleet.points.values()])
    np.testing.assert_allclose(places, planned(hop, fleet.t_s), atol=0.5)


def test_a_vehicle_heard_again_in_its_place_rejoins(hop: Plan, hop_returns: ReturnPlan) -> None:
    async def story(fleet: PointFleet) -> None:
        await asyncio.sleep(2.0)
        fleet.points[2].silent = True
        await asyncio.sleep(5.0)
        assert fleet.executor.policy.states[2] is State.SILENT
        assert fleet.monitor.in_formation == [1, 3]
        fleet.points[2].silent = False
        fleet.points[2].off_ned_m = np.array([0.0, -1.0, 0.0])
        await asyncio.sleep(1.0)
        fleet.points[2].off_ned_m = np.zeros(3)
        await asyncio.sleep(8.5)

    fleet = flown(hop, hop_returns, story, t_s=8.0)
    assert words(fleet, 2) == ["link lost", "link back", "ordered to rejoin"]
    assert fleet.executor.policy.states[2] is State.FLYING
    assert not fleet.points[2].modes_ordered, "it obeys setpoints"
    places = np.array([values[:3] for _, values in fleet.points[2].setpoints])
    times_s = np.array([host_s + EPOCH_S for host_s, _ in fleet.points[2].setpoints]) - fleet.monitor.t0_unix_s
    off_m = places - hop.states(np.clip(times_s, 0.0, 33.0))[1][:, :3]
    assert -1.1 < off_m[:, 1].min() < -0.8, "its setpoints begin where it is"
    (back,) = fleet.told("ordered to rejoin")
    assert np.abs(off_m[times_s > back.t_s + 8.3]).max() < 0.06
    assert np.abs(off_m[(times_s > back.t_s + 3.0) & (times_s < back.t_s + 5.0), 1]).min() > 0.15, "it takes 8 s"


def test_of_a_vehicle_heard_again_off_its_place_a_return_is_ordered(hop: Plan, hop_returns: ReturnPlan) -> None:
    async def story(fleet: PointFleet) -> None:
        fleet.points[2].silent = True
        await asyncio.sleep(4.0)
        fleet.points[2].silent, fleet.points[2].off_ned_m = False, np.array([0.0, -1.7, 0.0])
        await asyncio.sleep(1.0)

    fleet = flown(hop, hop_returns, story)
    assert words(fleet, 2) == ["link lost", "link back", "ordered to return"]


@pytest.mark.parametrize(
    ("on_loss", "ordered", "mode"),
    [
        (OnLoss.LAND, ["ordered to land"], LAND),
        (OnLoss.RETURN, ["ordered to return"], GUIDED),
        (OnLoss.CONTINUE, [], GUIDED),
    ],
)
def test_after_a_loss_the_others_do_as_chosen(
    hop: Plan, hop_returns: ReturnPlan, on_loss: OnLoss, ordered: list[str], mode: int
) -> None:
    """Vehicle 2 is silent from 10 s on."""

    async def story(fleet: PointFleet) -> None:
        fleet.points[2].silent = True
        await asyncio.sleep(12.0)

    fleet = flown(hop, hop_returns, story, options=FlightOptions(on_loss=on_loss))
    assert words(fleet, 2) == ["link lost", "vehicle lost"]
    assert words(fleet, 1) == words(fleet, 3) == ordered
    assert fleet.points[1].mode == fleet.points[3].mode == mode
    assert fleet.executor.over.is_set() is bool(ordered)
    assert tuple(fleet.monitor.aloft) == (1, 3)
    if mode == LAND:
        assert fleet.points[1].setpoints[-1][0] < fleet.points[1]._host_s() - 1.0, "no setpoints in the landing"
    (trouble,) = fleet.executor.policy.troubles
    told = fleet.executor.describe(trouble)
    assert told.startswith("vehicle 2 was lost (silent for 10.")
    assert float(told.split("t = ")[1].split()[0]) == pytest.approx(20.3, abs=0.5)


def test_a_return_leads_over_the_pad_at_its_own_altitude_and_then_lands(hop: Plan, hop_returns: ReturnPlan) -> None:
    """It climbs to the altitude of its return, and waits at rest 1 m above its pad until it is there."""
    fleet = flown(
        hop,
        hop_returns,
        after(1.0, lambda f: f.points[3].say("FENCE_STATUS", breach_status=1), 36.0),
        options=CONTINUE,
        t_s=3.0,
    )
    assert words(fleet, 3) == ["fence breached", "ordered to return"]
    point = fleet.points[3]
    assert point.modes_ordered == [LAND], "it obeys setpoints already"
    pad = hop.pads_ned_m[2]
    places = np.array([values[:3] for _, values in point.setpoints])
    assert pad[2] - places[:, 2].min() == pytest.approx(hop_returns.altitudes_m[2], abs=0.02)
    np.testing.assert_allclose(point.position_ned_m, pad - [0.0, 0.0, 1.0], atol=0.01)
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() < 0.6, "no jumps at 10 Hz"
    assert point.setpoints[-1][0] < point._host_s() - 1.0, "no setpoints in the landing"
    assert fleet.executor.policy.states[1] is State.FLYING


@pytest.mark.slow
def test_a_vehicle_that_is_blown_off_its_way_back_gets_a_new_reference_from_where_it_is(
    hop: Plan, hop_returns: ReturnPlan
) -> None:
    """The wind blows it 4 m aside and no more, so its new reference begins there; it is asked so three times."""

    async def story(fleet: PointFleet) -> None:
        await asyncio.sleep(0.5)
        fleet.points[3].say("FENCE_STATUS", breach_status=1)
        await asyncio.sleep(4.0)
        fleet.points[3].off_ned_m = np.array([0.0, 4.0, 0.0])
        await asyncio.sleep(12.0)

    point = flown(hop, hop_returns, story, options=CONTINUE).points[3]
    east_m = np.array([values[1] for _, values in point.setpoints])
    assert np.count_nonzero(np.diff(east_m) > 3.0) == 3


def test_all_return_when_the_operator_orders_it(hop: Plan, hop_returns: ReturnPlan) -> None:
    fleet = flown(hop, hop_returns, after(1.0, lambda f: f.executor.ask(AskedOrder.RETURN, (), "a test"), 2.0))
    asked, *orders = fleet.events
    assert (asked.sysid, asked.what) == (0, "were asked to return by a test")
    low_m, high_m = min(hop_returns.altitudes_m), max(hop_returns.altitudes_m)
    assert asked.rule.startswith(f"vehicles 1, 2, 3 return, staggered {low_m:.0f}–{high_m:.0f} m, ")
    assert [(event.sysid, event.what) for event in orders] == [(i, "ordered to return") for i in (1, 2, 3)]
    assert {event.rule for event in orders} == {"The operator ordered it to return"}
    assert [event.t_s for event in fleet.events] == pytest.approx([11.0] * 4, abs=0.2)
    assert fleet.executor.operator.ended[0].startswith("vehicles 1, 2, 3: return ordered by a test at t = 11.")
    assert fleet.executor.over.is_set()
    assert list(fleet.monitor.in_formation) == []


def test_the_plan_waits_while_all_hold_and_goes_on_when_they_continue(hop: Plan, hop_returns: ReturnPlan) -> None:
    """They hold for longer than after a conflict; then T0 is later by the time that they held."""
    t0_s: list[float] = []

    async def story(fleet: PointFleet) -> None:
        await asyncio.sleep(1.0)
        t0_s.append(fleet.monitor.t0_s)
        assert fleet.executor.ask(AskedOrder.HOLD, (), "a test") == (1, 2, 3)
        await asyncio.sleep(12.0)
        assert set(fleet.executor.policy.states.values()) == {State.WAITING}
        assert fleet.executor.waits and not fleet.executor.over.is_set()
        assert all(np.linalg.norm(point.velocity_ned_mps) < 0.01 for point in fleet.points.values())
        assert "they continue at t = " in fleet.executor.forecast(AskedOrder.CONTINUE, ()).words
        fleet.executor.ask(AskedOrder.CONTINUE, (), "a test")
        t0_s.append(fleet.monitor.t0_s)
        await asyncio.sleep(8.0)

    fleet = flown(hop, hop_returns, story)
    assert 9.0 < t0_s[1] - t0_s[0] < 16.0
    assert fleet.executor.policy.in_formation == (1, 2, 3) and not fleet.executor.waits
    places = np.array([point.position_ned_m for point in fleet.points.values()])
    np.testing.assert_allclose(places, planned(hop, fleet.t_s), atol=0.5)
    (back,) = fleet.told("are led back to the plan, which goes on")
    clock = flown_plan_time(fleet.monitor.t0_s, fleet.events)
    held_s = fleet.told("asked to hold")[0].unix_s
    assert clock.off_plan(np.array([held_s - 8.1, held_s + 1.0, back.unix_s])).tolist() == [False, True, True]
    assert fleet.executor.operator.ended == []


def test_one_vehicle_holds_until_the_operator_brings_it_home(hop: Plan, hop_returns: ReturnPlan) -> None:
    async def story(fleet: PointFleet) -> None:
        await asyncio.sleep(1.0)
        assert fleet.executor.ask(AskedOrder.HOLD, (2,), "a test") == (2,)
        await asyncio.sleep(8.0)
        assert fleet.executor.policy.states[2] is State.WAITING, "a vehicle that yielded would return now"
        assert not fleet.executor.waits, "the others fly on"
        with pytest.raises(
            FlightError, match="no vehicle would continue: the plan has not waited: flown by vehicles 1, 3"
        ):
            fleet.executor.ask(AskedOrder.CONTINUE, (2,), "a test")
        assert fleet.executor.ask(AskedOrder.RETURN, (2,), "a test") == (2,)
        await asyncio.sleep(1.0)

    fleet = flown(hop, hop_returns, story)
    assert words(fleet, 2) == ["ordered to hold", "ordered to return"]
    assert words(fleet, 1) == words(fleet, 3) == []
    (refused,) = fleet.told("asked to continue")
    assert refused.rule.startswith("refused: no vehicle would continue: ") and refused.data == {
        "order": "continue",
        "vehicles": [2],
        "by": "a test",
    }


def test_what_would_be_ordered_is_said_in_numbers(hop: Plan, hop_returns: ReturnPlan) -> None:
    """Heights are the return's own, seconds and battery those of the choice at a low battery."""
    said: dict[str, str] = {}

    async def story(fleet: PointFleet) -> None:
        set_all(fleet, (1, 2, 3), battery_pct=74)
        await asyncio.sleep(2.0)
        for order in (AskedOrder.HOLD, AskedOrder.LAND, AskedOrder.RETURN):
            said[order] = fleet.executor.forecast(order, (3,)).words
        with pytest.raises(FlightError, match="no vehicle 9 in this flight"):
            fleet.executor.forecast(AskedOrder.LAND, (3, 9))
        needs = fleet.executor.charge.needs(fleet.monitor.views[3])
        back = next(one for one in needs if one.outcome is Outcome.RETURN)
        said["need"] = f"{back.duration_s:.0f} s, {back.need_pct:.0f} % battery"

    fleet = flown(hop, hop_returns, story)
    assert said["return"] == (
        f"vehicle 3 returns, at {hop_returns.altitudes_m[2]:.0f} m, {said['need']}; the lowest has 74 %"
    )
    assert said["land"].startswith("vehicle 3 lands in place, ") and said["hold"].endswith("; the lowest has 74 %")
    assert fleet.events == [], "a forecast orders nothing"


def test_before_t0_the_start_is_held_goes_on_or_is_aborted_for_all(hop: Plan, hop_returns: ReturnPlan) -> None:
    said: dict[str, str] = {}

    async def story(fleet: PointFleet) -> None:
        operator = fleet.executor.operator
        for sysids, order, why in (
            ((2,), AskedOrder.LAND, "before T0 an order is for all vehicles"),
            ((), AskedOrder.CONTINUE, "the start is not held"),
        ):
            with pytest.raises(FlightError, match=why):
                fleet.executor.ask(order, sysids, "a test")
        assert fleet.executor.ask(AskedOrder.HOLD, (1, 2, 3), "a test") == (1, 2, 3)
        starting = asyncio.ensure_future(operator.until_start())
        await asyncio.sleep(60.0)
        assert not starting.done() and set(fleet.executor.policy.states.values()) == {State.STARTING}
        with pytest.raises(FlightError, match="held already"):
            fleet.executor.forecast(AskedOrder.HOLD, ())
        for order in (AskedOrder.CONTINUE, AskedOrder.LAND, AskedOrder.RETURN):
            said[order] = fleet.executor.forecast(order, ()).words
        fleet.executor.ask(AskedOrder.CONTINUE, (), "a test")
        await asyncio.wait_for(starting, 1.0)
        with pytest.raises(FlightError, match="T0 is being fixed"):
            fleet.executor.ask(AskedOrder.HOLD, (), "a test")
        fleet.executor.ask(AskedOrder.RETURN, (), "the page at 192.0.2.9")
        await asyncio.sleep(0.5)

    fleet = flown(hop, hop_returns, story, starting=True, t_s=-3.0)
    assert said["continue"] == "the start goes on: T0 follows once vehicles 1, 2, 3 hover"
    assert said["land"].startswith("the start is aborted: vehicles 1, 2, 3 land in place, ")
    assert said["return"] == said["land"], "their pads are below them"
    assert isinstance(fleet.error, FlightError)
    assert fleet.error.message == "the start was aborted: return ordered by the page at 192.0.2.9."
    assert [event.rule.split(":")[0] for event in fleet.events] == [
        *["refused"] * 2,
        "the start waits",
        "the start goes on",
        "refused",
        "the start is aborted",
    ]
    assert [point.modes_ordered for point in fleet.points.values()] == [[], [], []], "the flight lands them, not this"


def test_missions_on_board_start_at_a_fixed_time_or_not_at_all(hop: Plan, hop_returns: ReturnPlan) -> None:
    async def story(fleet: PointFleet) -> None:
        with pytest.raises(FlightError, match="missions on board start at a fixed time"):
            fleet.executor.forecast(AskedOrder.HOLD, ())
        assert fleet.executor.forecast(AskedOrder.LAND, ()).vehicles == (1, 2, 3)

    flown(hop, hop_returns, story, starting=True, options=FlightOptions(mode=FlightMode.MISSION), t_s=-3.0)


def test_without_a_way_back_a_vehicle_lands(
    hop: Plan, hop_returns: ReturnPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ReturnRoutes, "way_ned_m", lambda *_: None)
    fleet = flown(hop, hop_returns, after(1.0, lambda f: f.points[3].say("FENCE_STATUS", breach_status=1), 2.0))
    assert words(fleet, 3) == ["fence breached", "ordered to return", "ordered to land"]
    assert fleet.told("ordered to land")[0].rule.endswith(
        "; no way back keeps out of no-fly zones and inside the fence"
    )
    assert fleet.points[3].mode == LAND


def test_a_pilot_gets_the_vehicle_and_no_more_setpoints(hop: Plan, hop_returns: ReturnPlan) -> None:
    fleet = flown(hop, hop_returns, after(1.0, lambda f: set_all(f, (2,), mode=PILOTS_MODE), 4.0))
    assert words(fleet, 2) == ["pilot took over", "released"]
    assert fleet.events[0].rule == "now in LOITER"
    assert fleet.points[2].setpoints[-1][0] < fleet.points[2]._host_s() - 1.5
    assert fleet.points[2].modes_ordered == []
    (trouble,) = fleet.executor.policy.troubles
    assert fleet.executor.describe(trouble).startswith(
        "vehicle 2 left the formation: pilot took over (now in LOITER) at t = 12."
    )


@pytest.mark.parametrize(
    ("mode", "of", "who"),
    [
        (AUTO, FlightMode.STREAM, "pilot took over"),
        (AUTO, FlightMode.MISSION, None),
        (PILOTS_MODE, FlightMode.MISSION, "pilot took over"),
    ],
)
def test_a_mission_is_a_pilots_choice_where_setpoints_are_flown(
    hop: Plan, hop_returns: ReturnPlan, mode: int, of: FlightMode, who: str | None
) -> None:
    fleet = flown(
        hop, hop_returns, after(1.0, lambda f: set_all(f, (2,), mode=mode), 3.0), options=FlightOptions(mode=of)
    )
    assert words(fleet, 2)[:1] == ([] if who is None else [who])


def test_a_vehicle_in_its_failsafe_is_taken_over_and_returns(hop: Plan, hop_returns: ReturnPlan) -> None:
    fleet = flown(hop, hop_returns, after(1.0, lambda f: set_all(f, (2,), mode=RTL, critical=True), 3.0))
    assert words(fleet, 2) == ["failsafe took over", "ordered to return"]
    assert fleet.points[2].modes_ordered == [GUIDED]


def test_a_failsafe_of_the_battery_is_told_with_what_the_energy_allows(hop: Plan, hop_returns: ReturnPlan) -> None:
    def fail(fleet: PointFleet) -> None:
        set_all(fleet, (2,), mode=RTL, critical=True, battery_pct=60)
        fleet.points[2].say("STATUSTEXT", severity=2, text="Battery Failsafe", id=0, chunk_seq=0)

    limits = DetectionLimits(battery_low_pct=15)
    fleet = flown(hop, hop_returns, after(1.0, fail, 3.0), options=FlightOptions(limits=limits))
    assert words(fleet, 2)[0] == "failsafe took over"
    told = fleet.events[0]
    assert "cause: " in told.rule
    assert "; 15 % left, reserve 4 %: " in told.rule, "the alarm counts, not the 60 % that it reports"
    assert "finish" not in told.rule, "it left the plan"
    assert told.data is not None
    assert told.data["reserve_pct"] == 4.0


def test_a_low_battery_is_told_once_while_the_plan_can_be_finished(hop: Plan, hop_returns: ReturnPlan) -> None:
    async def story(fleet: PointFleet) -> None:
        for left_pct in (20, 19, 18):
            fleet.points[2].battery_pct = left_pct
            await asyncio.sleep(1.2)
        fleet.points[1].battery_pct = 8
        await asyncio.sleep(1.2)

    fleet = flown(hop, hop_returns, story)
    assert words(fleet, 2) == ["battery low"]
    assert words(fleet, 1) == ["battery critical"]
    low, critical = fleet.events
    assert low.rule.startswith("20 % left, reserve 10 %: finish needs ")
    assert critical.rule.startswith("8 % left, reserve 4 %: finish needs ")
    assert low.data is not None
    assert (low.data["chosen"], low.data["remaining_pct"], low.data["reserve_pct"]) == ("finish", 20, 10.0)


def test_a_critical_battery_ends_a_return_that_it_allows(hop: Plan, hop_returns: ReturnPlan) -> None:
    """The vehicle finishes what it was ordered; that is told once, at the first report."""

    async def story(fleet: PointFleet) -> None:
        await asyncio.sleep(0.5)
        fleet.points[2].say("FENCE_STATUS", breach_status=1)
        await asyncio.sleep(1.0)
        for left_pct in (40, 39):
            fleet.points[2].battery_pct = left_pct
            await asyncio.sleep(1.0)

    limits = DetectionLimits(battery_low_pct=45, battery_critical_pct=40)
    fleet = flown(hop, hop_returns, story, options=replace(CONTINUE, limits=limits))
    assert words(fleet, 2) == ["fence breached", "ordered to return", "battery critical"]
    assert fleet.events[-1].rule.startswith("40 % left, reserve 4 %: finish (as ordered) needs ")
    chosen = fleet.executor._chosen[2]
    assert chosen.remaining_pct == 39
    np.testing.assert_allclose(chosen.chosen.target_ned_m, hop.pads_ned_m[1])


def test_an_order_that_is_not_carried_out_is_told_and_then_a_landing_is_ordered(
    hop: Plan, hop_returns: ReturnPlan
) -> None:
    def fail(fleet: PointFleet) -> None:
        set_all(fleet, (2,), mode=RTL, critical=True, deaf=True)

    fleet = flown(hop, hop_returns, after(1.0, fail, 24.0), options=CONTINUE, t_s=2.0)
    assert words(fleet, 2) == [
        "failsafe took over",
        "ordered to return",
        *["did not return"] * 3,
        "ordered to land",
    ]
    failures = fleet.told("did not return")
    assert [event.rule.split("(")[-1] for event in failures] == [
        "attempt 1, repeated in 1 s)",
        "attempt 2, repeated in 2 s)",
        "attempt 3, repeated in 4 s)",
    ]
    pauses_s = np.diff([event.t_s for event in failures])
    assert pauses_s == pytest.approx([7.0, 8.0], abs=0.5), "6 s for the HEARTBEAT, and the pause before"


def test_of_two_that_would_meet_the_one_off_its_place_yields(hop: Plan, hop_returns: ReturnPlan) -> None:
    """Vehicles 2 and 3 are 5 m apart in the plan; 3 drifts towards 2, too fast for both to brake."""

    async def story(fleet: PointFleet) -> None:
        for _ in range(8):
            # 0.5 m would put predictions on limits.
            fleet.points[3].off_ned_m = fleet.points[3].off_ned_m - [0.0, 0.48, 0.0]
            await asyncio.sleep(0.5)
        fleet.points[3].off_ned_m = np.zeros(3)
        await asyncio.sleep(9.0)

    fleet = flown(hop, hop_returns, story, options=CONTINUE, t_s=5.0)
    assert words(fleet, 2) == []
    assert words(fleet, 3) == ["separation in danger", "ordered to climb", "ordered to return"]
    assert [event.rule.split(":")[0] for event in fleet.events[1:]] == [
        "The upper vehicle climbs by 2 m",
        "A vehicle that yielded returns after 5 s without a conflict",
    ]
    danger = fleet.events[0]
    assert danger.rule.endswith(" m")
    assert 1.4 <= float(danger.rule.split()[0]) <= 2.0
    assert "vehicles 3 and 2 will be" in fleet.events[1].rule


def test_a_vehicle_on_the_ground_has_no_incidents(hop: Plan, hop_returns: ReturnPlan) -> None:
    fleet = flown(hop, hop_returns, after(0.0, lambda f: set_all(f, (2,), armed=False, battery_pct=5), 2.0))
    assert fleet.events == []
    assert tuple(fleet.monitor.aloft) == (1, 3)


def test_a_vehicle_that_is_disarmed_in_the_air_is_lost_and_the_others_land(hop: Plan, hop_returns: ReturnPlan) -> None:
    fleet = flown(hop, hop_returns, after(2.0, lambda f: set_all(f, (2,), armed=False), 4.0))
    (fell,) = fleet.told("disarmed in the air")
    assert (fell.sysid, fell.alarm) == (2, True)
    assert fleet.executor.policy.states == {1: State.LANDING, 2: State.LOST, 3: State.LANDING}
    assert [fleet.points[n].modes_ordered for n in (1, 2, 3)] == [[LAND], [], [LAND]]


def test_before_t0_trouble_aborts_the_start_and_all_land(hop: Plan, hop_returns: ReturnPlan) -> None:
    fleet = flown(
        hop, hop_returns, after(1.0, lambda f: set_all(f, (2,), battery_pct=15), 2.0), t_s=hop.airborne_s, starting=True
    )
    assert isinstance(fleet.error, FlightError)
    (told,) = fleet.told("battery low")
    assert told.t_s == pytest.approx(hop.t_start_s + 1.2, abs=0.3), "as if the take-off had begun on time"
    assert f"at t = {told.t_s:.1f} s" in str(fleet.error)
    assert "the start was aborted: vehicle 2 left the formation: battery low" in str(fleet.error)
    assert [point.modes_ordered for point in fleet.points.values()] == [[LAND]] * 3


def test_before_t0_the_modes_of_a_take_off_are_ordered_ones(hop: Plan, hop_returns: ReturnPlan) -> None:
    fleet = flown(
        hop, hop_returns, after(1.0, lambda f: set_all(f, (2,), mode=ARDUPILOT.mission), 3.0), t_s=hop.airborne_s,
        starting=True,
    )  # fmt: skip
    assert (fleet.events, fleet.error) == ([], None)
    assert set(fleet.executor.policy.states.values()) == {State.STARTING}


def test_in_the_landing_its_mode_is_an_ordered_one(hop: Plan, hop_returns: ReturnPlan) -> None:
    def land(fleet: PointFleet) -> None:
        fleet.executor.landing()
        set_all(fleet, (1, 2), mode=LAND)

    assert flown(hop, hop_returns, after(1.0, land, 3.0)).events == []
    story = after(0.2, lambda f: set_all(f, (1,), mode=LAND), 2.5)
    unordered = flown(hop, hop_returns, story, options=CONTINUE, t_s=-3.9)  # all hover
    assert words(unordered, 1) == ["pilot took over", "released"]


def test_a_vehicle_that_was_never_heard_gets_no_order_and_others_fly_on(hop: Plan, hop_returns: ReturnPlan) -> None:
    async def story(fleet: PointFleet) -> None:
        fleet.points[2].silent = True
        fleet.executor.never_heard(2)
        await asyncio.sleep(12.0)
        assert fleet.events == []
        fleet.points[2].silent = False
        await asyncio.sleep(1.0)

    fleet = flown(hop, hop_returns, story, t_s=5.0)
    assert words(fleet, 2) == ["link back", "ordered to return"]
    assert words(fleet, 1) == words(fleet, 3) == []


def test_the_next_vehicle_leads_when_the_leader_leaves(hop: Plan, hop_returns: ReturnPlan) -> None:
    story = after(1.0, lambda f: set_all(f, (1,), mode=PILOTS_MODE), 3.0)
    fleet = flown(hop, hop_returns, story, options=FlightOptions(follow=True, on_loss=OnLoss.CONTINUE))
    assert words(fleet, 2) == ["ordered to lead"]
    back = FlightOptions(follow=True, on_leader_loss=OnLeaderLoss.RETURN)
    assert words(flown(hop, hop_returns, story, options=back), 2) == ["ordered to return"]
    assert words(flown(hop, hop_returns, story, options=replace(back, follow=False)), 2) == []


def test_landing_points_of_lost_and_landed_vehicles_are_free_unless_another_is_near(
    hop: Plan, hop_returns: ReturnPlan
) -> None:
    """The limit of separation is 3 m, and landing points are 5 m apart."""

    async def story(fleet: PointFleet) -> None:
        await asyncio.sleep(1.0)
        free = fleet.executor._free_points
        assert free(1) == []
        fleet.executor.policy.states[2] = State.LOST
        (point,) = free(1)
        assert point.name == "landing point of vehicle 2"
        np.testing.assert_allclose(point.ned_m, hop.landing_points_ned_m[1])
        assert free(2) == [], "its own"
        fleet.points[3].armed = False
        await asyncio.sleep(1.0)
        assert [point.name for point in free(1)] == ["landing point of vehicle 2", "landing point of vehicle 3"]
        view, second = fleet.monitor.views[3], hop.landing_points_ned_m[1]
        view.position_ned_m = second + np.array([2.9, 0.0, -9.0])
        assert "landing point of vehicle 2" not in [point.name for point in free(1)]
        view.position_ned_m = second + np.array([3.1, 0.0, -9.0])
        assert "landing point of vehicle 2" in [point.name for point in free(1)]

    flown(hop, hop_returns, story)


@pytest.mark.parametrize("off_m", [(0.0, 2.0), (2.0, 0.0)])
@pytest.mark.parametrize("down_m", [(-8.0, -9.0), (-9.0, -8.0)])
def test_the_vehicle_farther_from_its_place_yields_whether_it_is_above_or_below(
    off_m: tuple[float, float], down_m: tuple[float, float]
) -> None:
    ours: Any = object.__new__(PositionChecks)
    ours._policy = SimpleNamespace(states=dict.fromkeys((1, 2), State.FLYING))
    ours._vehicles = dict.fromkeys((1, 2), SimpleNamespace(session=SimpleNamespace(armed=True)))
    views = {
        sysid: SimpleNamespace(error_m=off, position_ned_m=np.array([0.0, 0.0, down]))
        for sysid, off, down in zip((1, 2), off_m, down_m, strict=True)
    }
    ours._monitor = SimpleNamespace(views=views, t0_unix_s=0.0, watch_separation=lambda aloft: None)
    ours._fell_s = {}
    ours._separation = SimpleNamespace(look=lambda *_: [Conflict((1, 2), 0.75, 1.234)])
    (incident,) = ours.conflicts(20.0, 20.0, gathers=False)
    farther = 1 + int(np.argmax(off_m))
    assert (incident.sysid, incident.other, incident.in_s, incident.detail) == (farther, 3 - farther, 0.75, "1.23 m")
    assert incident.higher is (int(np.argmin(down_m)) == farther - 1)


def test_a_flight_is_checked_every_tenth_of_a_second_of_fleet_time() -> None:
    """While fleet time is not known there is no check, nor between a start that is over and a known T0."""
    ours: Any = object.__new__(ContingencyExecutor)
    fleet_s = iter([0.0625, 0.1, 0.1875, 0.2, None, 0.375, 0.4375, 0.5, 0.75])
    checks_s: list[float] = []
    awaited_s: list[float] = []

    def check(now_s: float, t_s: float) -> None:
        assert t_s == now_s - 0.5
        checks_s.append(now_s)
        ours.policy.states[1] = State.STARTING if now_s < 0.45 else State.FLYING

    def next_s() -> float | None:
        for now_s in fleet_s:
            return now_s
        raise asyncio.CancelledError

    async def comes_to(unix_s: float) -> None:
        awaited_s.append(unix_s)

    ours._time = SimpleNamespace(hold=lambda: None, sure_s=lambda: 0.0, now_s=next_s, comes_to=comes_to)
    ours._loop = SimpleNamespace(time=lambda: 0.0)
    ours._vehicles, ours._watches = {}, {}
    ours.policy = SimpleNamespace(states={1: State.STARTING}, troubles=[])
    ours.operator = SimpleNamespace(aborted="")
    ours._rests = False
    ours._monitor = SimpleNamespace(t0_unix_s=None)
    ours._fleet = SimpleNamespace(plan=SimpleNamespace(t_start_s=-0.5))
    ours._standstill = SimpleNamespace(open=False, reads=lambda checked_s: False)
    ours._report_clocks, ours._check = lambda now_s: None, check
    with pytest.raises(asyncio.CancelledError):
        asyncio.run(ours.run())
    assert checks_s == [0.1, 0.2, 0.375, 0.5]
    assert sorted(set(awaited_s)) == pytest.approx([0.1, 0.2, 0.3, 0.475, 0.6])
