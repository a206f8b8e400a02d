"""What follows a standstill of the ground station, over a formation of points in the air.

The points hold their places without setpoints. Expected are times that were chosen here, and places of the plan.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from gcs.flight.contingency.choices import FlightMode, OnLoss
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.contingency.policy import State
from gcs.flight.execution.standstill import Standstill
from gcs.flight.execution.streamer import Streamer
from gcs.flight.monitoring.monitor import VehicleView
from gcs.flight.monitoring.progress import OFF_PLAN, Action
from gcs.mission.returns.rtl_altitudes import ReturnPlan
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from tests.point_fleet import EPOCH_S, PILOTS_MODE, PointFleet, flown
from tests.unit.flight.contingency.straight_plan import straight_plan, yaw_rad

GUIDED, RTL = 4, 6
BACK, LATER = "are led back to the plan", ", which goes on {:.1f} s later"
OBEY = "ordered to follow setpoints again"


def stood_still(
    seconds: float, then_s: float = 8.0, meanwhile: Callable[[PointFleet], None] = lambda _: None
) -> Callable[[PointFleet], Awaitable[None]]:
    """A story in which the program stands still, and something happens to the vehicles meanwhile."""

    async def story(fleet: PointFleet) -> None:
        await asyncio.sleep(2.0)
        fleet.loop.stand_still(seconds)
        meanwhile(fleet)
        await asyncio.sleep(then_s)

    return story


def told(fleet: PointFleet) -> list[str]:
    return [event.what for event in fleet.events]


def fall_back(sysid: int, *, deaf: bool = False) -> Callable[[PointFleet], None]:
    """A vehicle's own failsafe takes it over while it has no setpoints."""

    def change(fleet: PointFleet) -> None:
        point = fleet.points[sysid]
        point.mode, point.critical, point.deaf = RTL, True, deaf

    return change


def test_after_a_long_standstill_the_plan_goes_on_later_by_as_much_as_was_missed(
    hop: Plan, hop_returns: ReturnPlan
) -> None:
    """The vehicles hold where they were at t = 12 s. A fade of 4 s begins at most 2 s before that in the plan."""
    t0_unix_s: list[float] = []

    async def story(fleet: PointFleet) -> None:
        await asyncio.sleep(2.0)
        t0_unix_s.append(fleet.monitor.t0_unix_s or 0.0)
        fleet.loop.stand_still(15.0)
        await asyncio.sleep(0.2)
        assert fleet.executor.waits
        await asyncio.sleep(6.0)
        assert not fleet.executor.waits

    fleet = flown(hop, hop_returns, story)
    stayed, back = fleet.events
    assert stayed.what == "stayed without setpoints"
    assert stayed.t_s == pytest.approx(27.2, abs=0.3), "the vehicles' time went on"
    later_s = (fleet.monitor.t0_unix_s or 0.0) - t0_unix_s[0]
    assert back.what == BACK + LATER.format(later_s)
    assert back.t_s == pytest.approx(27.2 - later_s, abs=0.3)
    assert back.data is not None
    off_s, on_s = back.data[OFF_PLAN]
    assert off_s == pytest.approx(t0_unix_s[0] + back.t_s, abs=0.1), "the plan waited from there on"
    assert on_s == pytest.approx(back.unix_s + 4.0, abs=0.3), "the fade is over"
    assert 15.0 <= later_s <= 17.5
    assert set(fleet.executor.policy.states.values()) == {State.FLYING}, "nobody was silent"
    for row, point in enumerate(fleet.points.values()):
        np.testing.assert_allclose(point.position_ned_m, hop.states(np.array([fleet.t_s]))[row, 0, POSITION], atol=0.5)
        steps_m = np.linalg.norm(np.diff([values[:3] for _, values in point.setpoints], axis=0), axis=1)
        assert steps_m.max() < 0.6, "no jumps at 10 Hz"


def test_vehicles_near_their_places_keep_t0(hop: Plan, hop_returns: ReturnPlan) -> None:
    """In the hover before t = 0 nothing moves, so nothing is missed."""
    fleet = flown(hop, hop_returns, stood_still(1.2, 3.0), t_s=-3.9)
    assert told(fleet) == ["stayed without setpoints", BACK]
    assert fleet.monitor.t0_unix_s == pytest.approx(EPOCH_S + 1001.0 + 3.9, abs=0.1)


def test_a_vehicle_that_is_not_heard_is_waited_for_no_longer_than_a_second_and_a_half(
    hop: Plan, hop_returns: ReturnPlan
) -> None:
    """The clock of this loop counts 0.1 s of a standstill."""

    def waited_s(silent: bool) -> float:
        def change(fleet: PointFleet) -> None:
            fleet.points[2].silent = silent

        fleet = flown(hop, hop_returns, stood_still(4.0, 2.4, change))
        stayed = fleet.told("stayed without setpoints")[0]
        return stayed.unix_s - EPOCH_S - 1007.0

    assert 0.2 < waited_s(silent=False) < 0.45
    assert 1.3 < waited_s(silent=True) < 1.75


def test_a_vehicle_in_its_failsafe_follows_again_and_all_go_on_together(hop: Plan, hop_returns: ReturnPlan) -> None:
    """The others hold until it follows setpoints again."""
    fleet = flown(hop, hop_returns, stood_still(6.0, 8.0, fall_back(2)))
    assert told(fleet)[:2] == ["failsafe took over", OBEY]
    assert [what.split(",")[0] for what in told(fleet)[2:]] == ["stayed without setpoints", BACK]
    assert fleet.points[2].modes_ordered == [GUIDED]
    assert fleet.points[1].modes_ordered == []
    assert set(fleet.executor.policy.states.values()) == {State.FLYING}
    obeyed, stayed = fleet.told(OBEY)[0], fleet.told("stayed")[0]
    between = [
        values[3:] for host_s, values in fleet.points[1].setpoints if obeyed.unix_s < host_s + EPOCH_S < stayed.unix_s
    ]
    assert len(between) > 2, "it gets setpoints"
    assert np.abs(between).max() < 0.01, "at rest"


@pytest.mark.slow
def test_a_vehicle_that_does_not_follow_again_is_not_waited_for_longer_than_20_s(
    hop: Plan, hop_returns: ReturnPlan
) -> None:
    options = FlightOptions(on_loss=OnLoss.CONTINUE)
    fleet = flown(hop, hop_returns, stood_still(6.0, 24.0, fall_back(2, deaf=True)), options=options)
    woke_s = 1009.0 + EPOCH_S
    assert told(fleet)[:2] == ["failsafe took over", OBEY]
    (stayed,) = fleet.told("stayed without setpoints")
    assert stayed.unix_s - woke_s == pytest.approx(20.4, abs=0.4)
    assert fleet.told(BACK)
    back = next(event for event in fleet.events if event.sysid == 2 and event.action is Action.RETURN)
    assert back.unix_s == pytest.approx(stayed.unix_s, abs=0.01)
    assert back.rule.startswith("Without a safe way back to the plan")
    assert fleet.executor.policy.states[1] is fleet.executor.policy.states[3] is State.FLYING


def test_vehicles_that_drifted_far_return(hop: Plan, hop_returns: ReturnPlan) -> None:
    def drift(fleet: PointFleet) -> None:
        for point in fleet.points.values():
            point.position_ned_m = point.position_ned_m - [0.0, 0.0, 20.0]

    fleet = flown(hop, hop_returns, stood_still(6.0, 2.0, drift))
    assert told(fleet)[0] == "stayed without setpoints"
    assert fleet.events[0].rule == "a vehicle is 20.0 m from the plan at its nearest instant (limit 15 m)"
    assert [(e.sysid, e.what) for e in fleet.events if e.what.startswith("ordered")] == [
        (sysid, "ordered to return") for sysid in (1, 2, 3)
    ]
    assert fleet.executor.over.is_set()


def test_a_silent_vehicle_is_judged_when_it_is_heard_again(hop: Plan, hop_returns: ReturnPlan) -> None:
    async def story(fleet: PointFleet) -> None:
        fleet.points[2].silent = True
        await asyncio.sleep(4.0)
        fleet.loop.stand_still(3.0)
        await asyncio.sleep(3.0)

    fleet = flown(hop, hop_returns, story, options=FlightOptions(on_loss=OnLoss.CONTINUE))
    assert [what.split(",")[0] for what in told(fleet)] == ["link lost", "stayed without setpoints", BACK]
    assert fleet.executor.policy.states[2] is State.SILENT, "the standstill is no silence of its own"
    assert 0.2 < fleet.told("stayed")[0].unix_s - EPOCH_S - 1008.0 < 0.5, "it is not waited for"


@pytest.mark.parametrize("why", ["landing", "missions on board", "before T0"])
def test_where_no_setpoints_are_due_nothing_is_done(hop: Plan, hop_returns: ReturnPlan, why: str) -> None:
    async def story(fleet: PointFleet) -> None:
        await asyncio.sleep(1.0)
        if why == "landing":
            fleet.executor.landing()
        fleet.loop.stand_still(4.0)
        await asyncio.sleep(1.0)
        assert not fleet.executor.waits
        assert not fleet.streamer.paused

    options = FlightOptions(mode=FlightMode.MISSION if why.startswith("missions") else FlightMode.STREAM)
    starting = why == "before T0"
    fleet = flown(hop, hop_returns, story, options=options, starting=starting, t_s=hop.airborne_s if starting else 10.0)
    assert (fleet.events, fleet.error) == ([], None)


def test_a_failsafe_long_after_a_standstill_is_no_consequence_of_it(hop: Plan, hop_returns: ReturnPlan) -> None:
    """6 s of vehicle time after the messages were read."""

    async def story(fleet: PointFleet, wait_s: float) -> None:
        await asyncio.sleep(1.0)
        fleet.loop.stand_still(3.0)
        await asyncio.sleep(wait_s)
        fall_back(2)(fleet)
        await asyncio.sleep(1.2)

    soon = flown(hop, hop_returns, lambda fleet: story(fleet, 4.5), t_s=2.0)
    assert [event.what for event in soon.events if event.sysid == 2] == ["failsafe took over", OBEY]
    late = flown(hop, hop_returns, lambda fleet: story(fleet, 7.0), t_s=2.0)
    assert [event.what for event in late.events if event.sysid == 2] == ["failsafe took over", "ordered to return"]


def test_a_pilot_who_takes_over_in_a_standstill_keeps_the_vehicle(hop: Plan, hop_returns: ReturnPlan) -> None:
    """The others are led back without it, once it is clear that it is a pilot's."""

    def take(fleet: PointFleet) -> None:
        fleet.points[2].mode = PILOTS_MODE

    fleet = flown(hop, hop_returns, stood_still(5.0, 6.0, take), options=FlightOptions(on_loss=OnLoss.CONTINUE))
    of_pilot = [event.what for event in fleet.events if event.sysid == 2]
    assert of_pilot == ["pilot took over", "released"]
    assert fleet.points[2].modes_ordered == []
    assert [what.split(",")[0] for what in told(fleet) if what not in of_pilot] == ["stayed without setpoints", BACK]


class PausedStreamer(SimpleNamespace):
    """A streamer that sends nothing after a standstill until it resumes."""

    def __init__(self, missing_s: float = 0.0, **others: Any) -> None:
        super().__init__(paused=True, pause_if_stalled=lambda: None, missing_s=lambda now_s: missing_s, **others)

    def resume(self) -> None:
        self.paused = False


@pytest.mark.parametrize("t_s", [30.0, 80.0])  # after the end of the plan too
def test_a_vehicle_holds_from_where_it_is_when_its_setpoints_begin(t_s: float) -> None:
    """It was seen 0.5 s ago at 2 m/s, and its setpoints begin 0.3 s from now: 1.6 m on, and 1.33 m to brake."""
    ours: Any = object.__new__(Standstill)
    t0_unix_s, now_s = EPOCH_S, EPOCH_S + t_s
    ours._options = FlightOptions(lead_s=0.3)
    ours._monitor = SimpleNamespace(t0_s=t0_unix_s, plan=straight_plan())
    ours._tracks = SimpleNamespace(routes=SimpleNamespace(depth_m=lambda tracks, at_s: np.zeros(len(at_s))))
    seen = VehicleView(1, np.array([10.0, 0.0, -8.0]), np.array([0.0, 2.0, 0.0]), now_s - 0.5)
    track = ours._hold_at(SimpleNamespace(view=seen), now_s)
    assert track.begin_s == pytest.approx(t_s + 0.3)
    assert track.at(0, track.begin_s)[:6] == pytest.approx((10.0, 1.6, -8.0, 0.0, 2.0, 0.0), abs=1e-5)
    assert track.at(0, track.begin_s)[9] == pytest.approx(yaw_rad(min(t_s + 0.3, 60.0)))
    assert track.end_ned_m == pytest.approx([10.0, 1.6 + 2.0**2 / (2 * 1.5), -8.0], abs=1e-5)


@pytest.mark.parametrize(
    ("mps", "fleet_s", "local_s", "waits"),
    [
        (0.49, 1.0, 1.0, False),
        (0.51, 1.0, 1.0, True),
        (9.0, 19.9, 15.1, True),
        (9.0, 20.1, 14.9, True),
        (9.0, 20.1, 15.1, False),
    ],
)
def test_vehicles_gather_until_all_are_slow_or_both_clocks_say_that_it_takes_too_long(
    mps: float, fleet_s: float, local_s: float, waits: bool
) -> None:
    """One of them follows setpoints a little later than the other. They are slow below 0.5 m/s."""
    ours: Any = object.__new__(Standstill)
    clock = SimpleNamespace(now_s=0.0)
    ours._loop, ours._streamer = SimpleNamespace(time=lambda: clock.now_s), PausedStreamer()
    ours._monitor, ours._before_s, ours._held = SimpleNamespace(t0_s=0.0), 0.0, set()
    ours._stranded, ours.gathers = True, False
    ours._vehicles = {
        sysid: SimpleNamespace(
            sysid=sysid,
            session=SimpleNamespace(armed=True, custom_mode=GUIDED),
            behaviour=SimpleNamespace(guided=GUIDED),
            view=VehicleView(sysid, np.zeros(3), np.zeros(3), 0.0),
        )
        for sysid in (1, 2)
    }
    ours._policy = SimpleNamespace(states=dict.fromkeys((1, 2), State.FLYING))
    ours._hold, ours._choose = lambda *_: None, lambda *_: "they go on"
    ours._vehicles[2].session.custom_mode = RTL
    assert ours.step(0.0, lambda _: True) is None
    ours._vehicles[2].session.custom_mode = GUIDED
    ours._vehicles[2].view.velocity_ned_mps = mps * np.array([0.6, 0.0, -0.8])
    clock.now_s = local_s
    assert ours.step(fleet_s, lambda _: True) == (None if waits else "they go on")
    assert ours.gathers is waits


def reading(lead_s: float, missing_s: float, *, is_read: bool) -> tuple[Any, SimpleNamespace]:
    """A program that has just stood still, and its clock; `missing_s`: how long vehicles had no setpoints."""
    ours: Any = object.__new__(Standstill)
    clock = SimpleNamespace(now_s=50.0)
    ours._stalls, ours._seen = SimpleNamespace(count=1), 0
    ours._loop, ours._time = SimpleNamespace(time=lambda: clock.now_s), SimpleNamespace(sure_s=lambda: 0.0)
    ours._streamer = PausedStreamer(missing_s=missing_s)
    ours._options, ours._reads, ours._stranded, ours.gathers = FlightOptions(lead_s=lead_s), False, False, False
    ours._heard, ours._is_read = lambda: [None], lambda vehicle: is_read
    return ours, clock


@pytest.mark.parametrize(("lead_s", "at_most_s"), [(0.0, 1.4), (0.3, 0.4)])
def test_vehicles_that_say_nothing_new_are_waited_for_until_a_limit(lead_s: float, at_most_s: float) -> None:
    """Emulated vehicles that wait for setpoints send nothing new before; others would in time."""
    ours, clock = reading(lead_s, 9.0, is_read=False)
    assert ours.reads(7.0)
    clock.now_s = 50.0 + at_most_s - 0.01
    assert ours.reads(7.0) and ours.open
    clock.now_s = 50.0 + at_most_s + 0.01
    assert not ours.reads(8.0)
    assert ours._before_s == 7.0, "the last check before"
    assert ours.end_reading(20.0) == 12.0
    assert ours.ours(26.0) and not ours.ours(26.1)


@pytest.mark.parametrize(("missing_s", "leads_back"), [(0.45, False), (0.55, True)])
def test_without_setpoints_for_half_a_second_vehicles_are_led_back(missing_s: float, leads_back: bool) -> None:
    ours, _ = reading(0.0, missing_s, is_read=True)
    assert not ours.reads(7.0)
    assert ours.open is leads_back
    assert ours._streamer.paused is leads_back


def test_after_a_standstill_nothing_is_sent_for_three_seconds_or_until_it_is_resumed() -> None:
    """Of two standstills, three seconds after the second."""
    ours: Any = object.__new__(Streamer)
    clock = SimpleNamespace(now_s=50.0)
    ours._loop, ours._woken = SimpleNamespace(time=lambda: clock.now_s), asyncio.Event()
    ours._stalls, ours._stalls_seen, ours._paused_until_s = SimpleNamespace(count=0), 0, -math.inf
    seen = []
    for count, now_s in ((0, 50.0), (1, 51.0), (1, 53.9), (1, 54.1), (2, 55.0), (3, 57.0), (3, 59.9), (3, 60.1)):
        ours._stalls.count, clock.now_s = count, now_s
        ours.pause_if_stalled()
        seen.append(ours.paused)
    assert seen == [False, True, True, False, True, True, True, False]
    ours._stalls.count = 4
    ours.pause_if_stalled()
    assert ours.paused and not ours._woken.is_set()
    ours.resume()
    assert not ours.paused and ours._woken.is_set()


@pytest.mark.parametrize("flies", [True, False])
def test_a_vehicle_that_is_taken_back_gets_setpoints_again(flies: bool) -> None:
    """In the air it holds where it is; before T0 it only changes its mode."""
    ours: Any = object.__new__(Standstill)
    done: list[object] = []

    async def take(vehicle: object, *reference: object) -> None:
        done.append((*reference, ours._streamer.paused))

    ours._streamer = PausedStreamer(enter_setpoint_mode=take, take_over=take)
    ours._monitor = SimpleNamespace(t0_unix_s=EPOCH_S if flies else None)
    ours._time, ours._held = SimpleNamespace(sure_s=lambda: 7.0), set()
    ours._hold_at = lambda vehicle, now_s: ("hold", now_s)
    vehicle: Any = SimpleNamespace(sysid=2)
    with patch("gcs.flight.execution.standstill.hurried", lambda vehicle: vehicle):
        asyncio.run(ours.take_back(vehicle))
    assert done == ([(("hold", 7.0), False)] if flies else [(True,)])
    assert ours._held == ({2} if flies else set())
