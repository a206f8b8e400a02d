"""Missions, flown here by a clock and straight lines as an ideal autopilot would, against the plan they came from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.errors import ScenarioError
from gcs.frames import from_degE7, geodetic_to_ned
from gcs.mission.model import Altitude, Command, Frame, MissionItem, VehicleMission
from gcs.mission.waypoints.mission_items import (
    ROUNDING_M,
    TIME_SHARE,
    build_missions,
    starting_at,
    timed_waits,
)
from gcs.mission.waypoints.placement import Deviation, SampledFlight, deviation
from gcs.mission.waypoints.timed_legs import Gate, TimedLegs
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.values.si import local_origin
from tests.unit.mission.waypoints.small_flights import stop_and_go


def ned(item: MissionItem, mission: VehicleMission, plan: Plan) -> np.ndarray:
    alt = mission.home.alt_amsl_m + item.alt_m
    origin = local_origin(plan.scenario)
    return geodetic_to_ned(from_degE7(item.lat_degE7), from_degE7(item.lon_degE7), alt, origin)


def fly(mission: VehicleMission, plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    """Knots (K,), (K, 3) of the motion from the end of the takeoff to the last waypoint, by the items alone."""
    knots_s, knots_m = [plan.phase("takeoff").end_s], [ned(mission.items[0], mission, plan)]
    speed = np.nan
    for item, arrival_s in zip(mission.items[1:-1], mission.arrival_s[1:-1], strict=True):
        if item.command == Command.DO_CHANGE_SPEED:
            speed = item.params[1]
        elif item.command == Command.NAV_DELAY:
            knots_s.append(knots_s[-1] + item.params[0])
            knots_m.append(knots_m[-1])
        else:
            there = ned(item, mission, plan)
            knots_s.append(knots_s[-1] + float(np.linalg.norm(there - knots_m[-1])) / speed)
            knots_m.append(there)
            assert knots_s[-1] == pytest.approx(arrival_s, abs=0.1)
    return np.array(knots_s), np.array(knots_m)


def test_an_ideal_autopilot_keeps_path_and_time(simulation1_plan: Plan, missions: tuple[VehicleMission, ...]) -> None:
    plan = simulation1_plan
    tolerance_m = plan.scenario.mission.tolerance_m
    t_s = np.linspace(plan.phase("takeoff").end_s, plan.flight_s, 20_001)
    wanted = plan.states(t_s)[..., POSITION]
    for row, mission in enumerate(missions):
        knots_s, knots_m = fly(mission, plan)
        assert knots_s[-1] == pytest.approx(plan.flight_s, abs=0.1)
        flown = np.stack([np.interp(t_s, knots_s, knots_m[:, axis]) for axis in range(3)], axis=-1)
        # Rounded lengths and speeds shift the clock by some 10 ms in 300 s.
        assert np.linalg.norm(flown - wanted[row], axis=-1).max() < TIME_SHARE * tolerance_m + 0.1
        starts, legs = knots_m[:-1], np.diff(knots_m, axis=0)
        legs, starts = legs[np.any(legs != 0, axis=1)], starts[np.any(legs != 0, axis=1)]
        from_starts = wanted[row, ::20, None] - starts
        share = np.clip(np.sum(from_starts * legs, axis=-1) / np.sum(legs * legs, axis=-1), 0, 1)
        nearest = np.linalg.norm(from_starts - share[..., None] * legs, axis=-1).min(axis=1)
        assert nearest.max() < tolerance_m


def test_the_stated_error_is_the_measured_one(simulation1_plan: Plan, legs: TimedLegs) -> None:
    tolerance_m = simulation1_plan.scenario.mission.tolerance_m
    assert legs.error.path_m <= tolerance_m - ROUNDING_M
    assert legs.error.time_m <= TIME_SHARE * tolerance_m
    fine_s = np.union1d(np.linspace(legs.t_s[0], legs.t_s[-1], 30_001), legs.t_s)
    fine = SampledFlight(fine_s, simulation1_plan.states(fine_s)[..., POSITION], 0.2)
    measured = deviation(fine, np.searchsorted(fine_s, legs.t_s).tolist())
    assert measured.path_m == pytest.approx(legs.error.path_m, abs=1e-3)
    assert measured.time_m == pytest.approx(legs.error.time_m, abs=1e-3)
    assert 30 <= len(legs.t_s) <= 80


def test_all_vehicles_pass_at_the_same_times_T0_and_arrival_among_them(
    simulation1_plan: Plan, missions: tuple[VehicleMission, ...]
) -> None:
    arrivals = [[a for a in m.arrival_s if a is not None] for m in missions]
    for mission, arrival in zip(missions, arrivals, strict=True):
        # The slowest legs, waited out, end when the centimetres left by rounding have been flown at 0.2 m/s.
        assert arrival == pytest.approx(arrivals[0], abs=2 * ROUNDING_M / 0.2)
        assert arrival == sorted(arrival)
        assert arrival[-1] == simulation1_plan.t_end_s
        at_T0 = mission.items[mission.arrival_s.index(0.0)]
        row = simulation1_plan.sysids.index(mission.sysid)
        position = simulation1_plan.states(np.array([0.0]))[row, 0, POSITION]
        assert np.allclose(ned(at_T0, mission, simulation1_plan), position, atol=ROUNDING_M)


def test_items_come_in_the_order_autopilots_need(simulation1_plan: Plan, missions: tuple[VehicleMission, ...]) -> None:
    for mission in missions:
        commands = [i.command for i in mission.items]
        assert commands[0] == Command.NAV_TAKEOFF
        assert commands[-2:] == [Command.NAV_WAYPOINT, Command.NAV_LAND]
        assert commands.count(Command.NAV_TAKEOFF) == commands.count(Command.NAV_LAND) == 1
        assert mission.items[1].params == (simulation1_plan.scenario.ground_phases.hover_s, -1, -1, -1)
        assert mission.items[-2].params[0] == simulation1_plan.scenario.ground_phases.hover_s
        top_speed = np.linalg.norm(simulation1_plan.scenario.limits.speed_ned_mps)
        for before, item in zip(mission.items, mission.items[1:], strict=False):
            if item.command == Command.NAV_WAYPOINT:
                assert before.command == Command.DO_CHANGE_SPEED
                kind, speed, throttle, _ = before.params
                assert (kind, throttle) == (1, -1)
                assert 0.2 <= speed <= top_speed
            positioned = item.command in (Command.NAV_WAYPOINT, Command.NAV_LAND)
            assert item.frame == (Frame.GLOBAL_RELATIVE_ALT if positioned else Frame.MISSION)


def test_each_vehicle_starts_above_its_own_pad_and_lands_on_its_own_ground(
    simulation1_plan: Plan, missions: tuple[VehicleMission, ...]
) -> None:
    for row, mission in enumerate(missions):
        home = geodetic_to_ned(
            mission.home.lat_deg,
            mission.home.lon_deg,
            mission.home.alt_amsl_m,
            local_origin(simulation1_plan.scenario),
        )
        assert np.allclose(home, simulation1_plan.pads_ned_m[row], atol=1e-3)  # homes are written in millimetres
        takeoff, land = mission.items[0], mission.items[-1]
        hover = simulation1_plan.states(np.array([simulation1_plan.phase("takeoff").end_s]))[row, 0]
        assert takeoff.alt_m == pytest.approx(simulation1_plan.pads_ned_m[row, 2] - hover[2], abs=0.0051)
        assert takeoff.params[3] == pytest.approx(np.degrees(hover[8]), abs=0.01)
        assert np.allclose(
            ned(land, mission, simulation1_plan), simulation1_plan.landing_points_ned_m[row], atol=ROUNDING_M
        )


def with_tolerance(plan: Plan, tolerance_m: float) -> Plan:
    mission = plan.scenario.mission.model_copy(update={"tolerance_m": tolerance_m})
    return replace(plan, scenario=plan.scenario.model_copy(update={"mission": mission}))


@pytest.mark.parametrize(
    ("firmware", "most", "stores"),  # a speed and a waypoint for each leg, take-off and landing; ArduPilot's home
    [(Autopilot.ARDUPILOT, 323, "651 items; ArduCopter stores at most 650"), (Autopilot.PX4, 249, "502 .* most 500")],
)
def test_more_items_than_the_autopilot_stores(
    simulation1_plan: Plan, firmware: Autopilot, most: int, stores: str
) -> None:
    plan = stop_and_go(simulation1_plan, 0.0)

    def made(count: int) -> tuple[VehicleMission, ...]:
        return build_missions(
            plan, TimedLegs(np.linspace(0.0, 10.0, count + 1), Deviation(0.0, 0.0)), firmware=firmware
        )

    assert len(made(most)[0].items) == 2 * most + 2
    with pytest.raises(ScenarioError, match=stores) as caught:
        made(most + 1)
    assert "mission.tolerance_m" in caught.value.hint


def test_the_altitude_frame_is_the_one_asked_for(simulation1_plan: Plan, legs: TimedLegs) -> None:
    """One place, three ways to say how high: above home, above the sea, above the ground under it."""
    plan = simulation1_plan
    relative, amsl, terrain = (build_missions(plan, legs, altitude=altitude) for altitude in Altitude)
    origin = local_origin(plan.scenario)
    for above_home, above_sea, above_ground in zip(relative, amsl, terrain, strict=True):
        for a, b, c in zip(above_home.items, above_sea.items, above_ground.items, strict=True):
            assert (a.command, a.lat_degE7, a.lon_degE7) == (b.command, b.lat_degE7, b.lon_degE7)
            assert (a.command, a.lat_degE7, a.lon_degE7) == (c.command, c.lat_degE7, c.lon_degE7)
            assert a.params == pytest.approx(b.params, abs=2 * ROUNDING_M / 0.2)  # other centimetres, other lengths
            assert a.params == pytest.approx(c.params, abs=2 * ROUNDING_M / 0.2)
            if a.frame == Frame.MISSION:
                continue
            assert (a.frame, b.frame, c.frame) == (3, 0, 10)
            assert b.alt_m == pytest.approx(a.alt_m + above_home.home.alt_amsl_m, abs=0.0111)
            place = geodetic_to_ned(from_degE7(a.lat_degE7), from_degE7(a.lon_degE7), b.alt_m, origin)
            ground_m = float(ground_height_m(plan.scenario.terrain, place[:1], place[1:2])[0])
            assert c.alt_m == pytest.approx(-place[2] - ground_m, abs=0.03)  # the ground slopes where degrees round
        assert above_ground.items[-1].alt_m == 0.0


def test_heights_above_ground_are_refused_where_the_autopilot_refuses_them(simulation1_plan: Plan) -> None:
    with pytest.raises(ScenarioError, match="PX4 refuses altitudes above the ground"):
        build_missions(simulation1_plan, firmware=Autopilot.PX4, altitude=Altitude.TERRAIN)


def test_the_rounding_is_half_a_step_of_degrees_north_and_east_and_of_centimetres_up() -> None:
    step_m = 1e-7 * np.radians(1.0) * 6_378_137.0
    assert np.linalg.norm([0.5 * step_m, 0.5 * step_m, 0.005]) <= ROUNDING_M < 0.0096


def test_a_tolerance_below_the_rounding_of_waypoints(simulation1_plan: Plan) -> None:
    with pytest.raises(ScenarioError, match="rounded"):
        build_missions(with_tolerance(simulation1_plan, 0.005))


def test_standing_still_on_the_way_is_a_delay_and_no_speed_of_zero(simulation1_plan: Plan) -> None:
    mission = build_missions(stop_and_go(simulation1_plan, -np.pi / 2))[0]
    assert [i.command for i in mission.items] == [
        Command.NAV_TAKEOFF,
        Command.DO_CHANGE_SPEED,
        Command.NAV_WAYPOINT,
        Command.NAV_DELAY,
        Command.DO_CHANGE_SPEED,
        Command.NAV_WAYPOINT,
        Command.NAV_LAND,
    ]
    assert mission.arrival_s == pytest.approx((0.0, None, 10.0, None, None, 35.0, 45.0))
    assert [mission.items[i].params[1] for i in (1, 4)] == pytest.approx([2.0, 4.0], abs=1e-3)
    assert mission.items[3].params[0] == pytest.approx(20.0)
    assert {i.params[3] for i in mission.items if i.frame == Frame.GLOBAL_RELATIVE_ALT} == {270.0}


def test_south_of_the_equator_and_west_of_greenwich(simulation1_plan: Plan) -> None:
    mission = build_missions(stop_and_go(simulation1_plan, 0.0))[0]
    first, second, third = (mission.items[i] for i in (0, 2, 5))
    assert (first.lat_degE7, first.lon_degE7) == (-350000000, -710000000)
    assert second.lat_degE7 < first.lat_degE7 == third.lat_degE7
    assert first.lon_degE7 == second.lon_degE7


GATED = TimedLegs(
    np.array([0.0, 10.0, 30.0, 35.0]),
    Deviation(0.0, 0.0),
    speeds_mps=np.array([[2.5, np.nan, 4.50004]]),
    leaves_s=0.75,
    gates=(Gate(2, 33.0, 5.0),),
    raised_m=np.array([0.0, 1.0, 2.0, 0.0]),
    waits_s=np.array([[1.5, 18.0, 0.0004]]),
)


def test_corrected_legs_are_written_with_their_speeds_delays_gates_and_raises(simulation1_plan: Plan) -> None:
    """All vehicles fly the leader's speeds where there is one row of them."""
    plan = stop_and_go(simulation1_plan, 0.0)
    every = build_missions(plan, GATED)
    assert {len(mission.items) for mission in every} == {10}
    mission = every[3]
    assert [
        (item.command, item.params[1 if item.command == Command.DO_CHANGE_SPEED else 0]) for item in mission.items
    ] == [
        (Command.NAV_TAKEOFF, 0.0),
        (Command.NAV_DELAY, 0.75),
        (Command.DO_CHANGE_SPEED, 2.5),
        (Command.NAV_WAYPOINT, 0.0),
        (Command.NAV_DELAY, 1.5),
        (Command.NAV_DELAY, 18.0),
        (Command.NAV_DELAY, 5.0),
        (Command.DO_CHANGE_SPEED, 4.5),
        (Command.NAV_WAYPOINT, 0.0),
        (Command.NAV_LAND, 0.0),
    ]
    for item in (mission.items[1], mission.items[2]):
        assert item.params in ((0.75, -1.0, -1.0, -1.0), (1.0, 2.5, -1.0, 0.0))  # a ground speed, at any throttle
        assert (item.frame, item.lat_degE7, item.lon_degE7, item.alt_m) == (Frame.MISSION, 0, 0, 0.0)
    assert mission.arrival_s == (0.0, None, None, 10.0, None, None, None, None, 35.0, 45.0)
    assert (mission.leaves_s, mission.gates) == (0.75, ((6, 33.0),))
    up_m = [mission.items[index].alt_m for index in (0, 3, 8)]
    assert np.diff(up_m).tolist() == pytest.approx([1.0, -1.0], abs=0.011)


def test_vehicles_with_legs_of_their_own_have_their_own_speeds_and_rests(simulation1_plan: Plan) -> None:
    plan = stop_and_go(simulation1_plan, 0.0)
    speeds = np.outer(np.arange(1.0, len(plan.sysids) + 1.0), [1.0, np.nan, 2.0])
    own = replace(GATED, speeds_mps=speeds, waits_s=None, gates=(), leaves_s=None, raised_m=None)
    for number, mission in enumerate(build_missions(plan, own), start=1):
        asked = [item.params[1] for item in mission.items if item.command == Command.DO_CHANGE_SPEED]
        assert asked == [number, 2.0 * number]
        assert [item.params[0] for item in mission.items if item.command == Command.NAV_DELAY] == [20.0]
        assert mission.leaves_s == 0.0


def test_only_the_last_waypoint_is_held_until_the_landing_begins(simulation1_plan: Plan) -> None:
    """At corrected speeds too: the legs end 3 s before it."""
    early = replace(GATED, t_s=np.array([0.0, 10.0, 30.0, 32.0]), speeds_mps=np.array([[2.5, 1.0, 4.5]]), gates=())
    items = build_missions(stop_and_go(simulation1_plan, 0.0), early)[0].items
    assert [item.params[0] for item in items if item.command == Command.NAV_WAYPOINT] == [0.0, 0.0, 3.0]


def test_a_leg_too_slow_for_an_autopilot_is_flown_faster_and_waited_out(simulation1_plan: Plan) -> None:
    """1 m in 10 s at 0.2 m/s, then 5 s of delay; the last waypoint is held until the landing begins."""
    plan = stop_and_go(simulation1_plan, 0.0)
    state = plan.leader_trajectory.state
    state.c[:, 1, 0], state.c[:, 2:, 0] = [-0.1, 0.0], [[0.0] * 3, [-1.0] * 3]
    mission = build_missions(plan, TimedLegs(np.array([0.0, 10.0]), Deviation(0.0, 0.0)))[0]
    first, speed, there, wait, land = mission.items
    assert speed.params[1] == 0.2
    assert there.params[0] == 25.0
    assert wait.params[0] == pytest.approx(5.0, abs=0.1)
    assert mission.arrival_s[2] == pytest.approx(5.0, abs=0.1)
    assert (first.command, land.command) == (Command.NAV_TAKEOFF, Command.NAV_LAND)


def test_a_plan_that_begins_in_the_air_takes_off_from_nowhere(simulation1_plan: Plan) -> None:
    plan = stop_and_go(simulation1_plan, 0.0)
    begun = replace(plan, begin_state=(0.0,) * 12)
    assert build_missions(begun, GATED)[0].items[0].command == Command.NAV_WAYPOINT


def test_gates_of_a_common_start_open_the_planned_seconds_after_it(simulation1_plan: Plan) -> None:
    """32.25 s after a start two seconds before midnight: at 0:00:30 UTC."""
    mission = build_missions(stop_and_go(simulation1_plan, 0.0), GATED)[0]
    started = starting_at(mission, 86_400 * 20_000 - 2)
    assert started.items[1].params == (-1.0, 23.0, 59.0, 58.0)
    assert started.items[6] == MissionItem(Command.NAV_DELAY, Frame.MISSION, (-1.0, 0.0, 0.0, 30.0), 0, 0, 0.0)
    assert timed_waits(started) == (1, 6)
    assert len(started.items) == len(started.arrival_s) == 10
    without = replace(
        mission, items=mission.items[:1] + mission.items[2:], arrival_s=mission.arrival_s[:1] + mission.arrival_s[2:]
    )
    without = replace(without, gates=((5, 33.0),))
    again = starting_at(without, 86_400 * 20_000 - 2)
    assert again == started
    assert timed_waits(again) == (1, 6)
