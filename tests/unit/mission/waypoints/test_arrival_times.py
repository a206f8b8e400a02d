"""The predicted timing of missions: lateness, least distance, gates, and what is refused."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs.autopilots.traits import TRAITS, Autopilot
from gcs.errors import ScenarioError, UsageError, VerificationError
from gcs.flight.setup.build_loads import build_loads
from gcs.mission.export.atomic_folder import INDEX
from gcs.mission.export.export import export
from gcs.mission.export.mission_files import MissionOrder, make_missions
from gcs.mission.formats.registry import select_formats
from gcs.mission.model import Altitude, Command
from gcs.mission.returns.fence_rally import build_safety
from gcs.mission.waypoints.arrival_times import (
    _Attempt,
    _gate_samples,
    _Samples,
    _worst_s,
    climb_s,
    corrected_legs,
    navigator_of,
)
from gcs.mission.waypoints.mission_items import ImpossibleMission
from gcs.mission.waypoints.speed_correction import Corrected
from gcs.mission.waypoints.timed_legs import TimedLegs
from gcs.plan.trajectory.plan import Plan
from tests.unit.mission.waypoints.small_flights import FLIGHT_S
from tests.unit.plan.routed import with_route

Plans = Callable[[str], Plan]
SPREAD_S = 0.2
DAY_START_S = 10 * 3600 + 30 * 60


@pytest.fixture(scope="module")
def field(plan_of: Plans) -> Plan:
    return plan_of("field/scenario.toml")


@pytest.mark.parametrize(
    ("name", "firmware", "late_s"),  # a little more than docs/design.md says
    [
        pytest.param("field", Autopilot.ARDUPILOT, 0.2, marks=pytest.mark.slow),
        pytest.param("field", Autopilot.PX4, 0.5, marks=pytest.mark.long),
        pytest.param("simulation1", Autopilot.ARDUPILOT, 0.8, marks=pytest.mark.slow),
        pytest.param("simulation1", Autopilot.PX4, 3.2, marks=pytest.mark.long),
        pytest.param("simulation2", Autopilot.ARDUPILOT, 1.6, marks=pytest.mark.long),
        pytest.param("simulation2", Autopilot.PX4, 2.0, marks=pytest.mark.long),
    ],
)
def test_everybody_is_in_time(plan_of: Plans, name: str, firmware: Autopilot, late_s: float) -> None:
    plan = plan_of(f"{name}/scenario.toml")
    made = make_missions(plan, MissionOrder(firmware), build_safety(plan, firmware), select_formats(["plan"]))
    assert made.timing is not None
    assert abs(made.timing.late_s) <= late_s
    assert made.timing.spread_s <= SPREAD_S
    assert [vehicle.sysid for vehicle in made.timing.vehicles] == list(plan.sysids)
    limit_mps = np.linalg.norm(plan.scenario.limits.speed_ned_mps)
    for mission in made.missions:
        speeds = [item.params[1] for item in mission.items if item.command == Command.DO_CHANGE_SPEED]
        assert firmware.traits.missions.speed_mps[0] <= min(speeds)
        assert max(speeds) <= min(limit_mps, firmware.traits.missions.speed_mps[1])


@pytest.mark.slow
def test_a_formation_flies_one_set_of_legs(small: Plan) -> None:
    """60 m north in 24 s and 60 m east in 24 s, which the model flies to within a second."""
    legs = corrected_legs(small, Autopilot.ARDUPILOT)
    assert legs.speeds_mps is not None and legs.waits_s is not None and legs.raised_m is not None
    assert legs.speeds_mps.shape == legs.waits_s.shape == (1, len(legs.t_s) - 1)
    assert (legs.t_s[0], legs.t_s[-1], legs.gates) == (0.0, FLIGHT_S, ())
    assert small.phase("takeoff").end_s <= legs.left_s <= 0.0
    assert not legs.raised_m.any()
    ends_ned_m = small.states(legs.t_s)[small.leader, :, :3]
    moving_s = np.linalg.norm(np.diff(ends_ned_m, axis=0), axis=1) / legs.speeds_mps[0]
    # Speeds are those of the plan, and a little more: every leg begins or ends at rest.
    assert 0.7 < float(np.nansum(moving_s) + np.nansum(legs.waits_s)) / FLIGHT_S < 1.1
    fine_s = np.linspace(0.0, FLIGHT_S, 2001)
    chords = np.stack([np.interp(fine_s, legs.t_s, ends_ned_m[:, axis]) for axis in range(3)], axis=1)
    off_m = np.linalg.norm(small.states(fine_s)[small.leader, :, :3] - chords, axis=1).max()
    assert legs.error.time_m == pytest.approx(off_m, abs=0.05)
    assert legs.error.path_m < 0.5


def test_at_a_gate_all_are_early_and_leave_on_a_whole_second(small: Plan) -> None:
    """Drawn points before and after it are waypoints all the same."""
    drawn_s = (7.03, 33.48)
    legs = corrected_legs(with_route(small, {t_s: {} for t_s in drawn_s}), Autopilot.ARDUPILOT, 1)
    assert set(drawn_s) <= set(legs.t_s.tolist())
    (gate,) = legs.gates
    assert legs.t_s[gate.waypoint] == pytest.approx(24.0)
    assert (gate.leaves_s, gate.slack_s) == (pytest.approx(23.0), 5.0)
    assert legs.left_s == -1.0
    assert legs.speeds_mps is not None and legs.waits_s is not None
    (speeds,), (waits,) = legs.speeds_mps, legs.waits_s
    way_m = np.linalg.norm(np.diff(small.states(legs.t_s)[small.leader, :, :3], axis=0), axis=1)
    flown_s = np.cumsum(np.nan_to_num(way_m / speeds) + waits) + legs.left_s
    assert flown_s[gate.waypoint - 1] < gate.leaves_s - 1.0  # what the slack is for


def test_parts_of_a_flight_know_the_drawn_points_inside_them() -> None:
    t_s = np.arange(10.0)
    places = np.arange(60.0).reshape(2, 10, 3)
    part = _Samples(t_s, places, (2, 3, 5, 8)).part(3, 8)
    assert part.drawn == (2,)  # its ends are waypoints anyway
    assert part.t_s.tolist() == [3.0, 4.0, 5.0, 6.0, 7.0, 8.0]
    np.testing.assert_array_equal(part.position_ned_m, places[:, 3:9])


@pytest.mark.parametrize(
    ("late_s", "gate", "worst_s"),
    [([0.5, -2.0, 1.0], False, 2.0), ([0.5, 0.2, -3.0], True, 0.5), ([-3.0], True, 3.0), ([0.5, -3.0], False, 3.0)],
)
def test_before_a_gate_the_last_waypoint_does_not_count(late_s: list[float], gate: bool, worst_s: float) -> None:
    """There vehicles are early on purpose."""
    found = Corrected(np.ones(len(late_s)), 0.0, None, np.array(late_s), None)  # type: ignore[arg-type]
    assert _worst_s(found, gate) == worst_s


def test_limits_of_an_autopilot_are_those_of_the_plans_vehicles(small: Plan) -> None:
    tight = small.scenario.model_copy(
        update={"limits": small.scenario.limits.model_copy(update={"roll_pitch_yaw_deg": (4.0, 4.0, 60.0)})}
    )
    assert navigator_of(replace(small, scenario=tight), Autopilot.PX4) != navigator_of(small, Autopilot.PX4)


@pytest.mark.long
def test_missions_that_px4_may_fly_too_near_are_not_written(field: Plan, tmp_path: Path) -> None:
    refused = r"vehicles \d and \d may come within .* m at .* s|no-fly zone"
    with pytest.raises(VerificationError, match=refused) as caught:
        export(field, tmp_path / "asked", formats=["plan"], firmware=Autopilot.PX4)
    assert "setpoint stream" in caught.value.hint
    assert not (tmp_path / "asked").exists()
    index = export(field, tmp_path / "unasked", firmware=Autopilot.PX4, setpoint_rate_hz=1)
    assert index.refused == caught.value.message
    names = {p.name for p in (tmp_path / "unasked").iterdir()}
    assert names == {INDEX, *(f"uav{sysid}.setpoints" for sysid in field.sysids)}
    document = json.loads((tmp_path / "unasked" / INDEX).read_text())
    assert document["refused"] == index.refused
    assert document["timing"]["nearest"]["distance_m"] < field.scenario.judge.separation_min_m
    assert document["verified"] is None


@pytest.mark.slow
def test_nor_are_such_missions_uploaded(field: Plan) -> None:
    autopilots = dict.fromkeys(field.sysids, int(Autopilot.PX4))
    with pytest.raises(VerificationError, match=r"failed verification|not fit for mission mode"):
        build_loads(field, autopilots, timed=True)
    heard: list[str] = []
    loads = build_loads(field, autopilots, timed=False, warn=heard.append)
    assert [load.sysid for load in loads] == list(field.sysids)
    # An upload repeats the warnings that an export gives of its returns.
    assert any(re.search(r"returns reach [\d.]+ m, above the plan's ceiling of 40 m", text) for text in heard)
    assert any("crosses no-fly zone" in text for text in heard)
    heard.clear()
    build_loads(field, autopilots, timed=False, safety=False, warn=heard.append)
    assert heard == []


@pytest.mark.slow
def test_missions_at_the_plans_own_speeds_are_written_on_request(field: Plan, tmp_path: Path) -> None:
    index = export(field, tmp_path, formats=["plan"], firmware=Autopilot.PX4, timed=False)
    assert (index.timing, index.refused) == (None, "")
    assert (tmp_path / "uav1.plan").exists()


@pytest.mark.slow
def test_everybody_waits_at_gates(field: Plan) -> None:
    order = MissionOrder(Autopilot.ARDUPILOT, gates=2, start_s=DAY_START_S)
    made = make_missions(field, order, build_safety(field, Autopilot.ARDUPILOT), select_formats(["plan"]))
    assert made.refusal is None
    assert made.timing is not None
    assert len(made.timing.gates_early_s) == 2
    assert min(made.timing.gates_early_s) >= 1.0
    for mission in made.missions:
        delays = [i.params for i in mission.items if i.command == Command.NAV_DELAY]
        assert delays[0] == (-1.0, 10.0, 30.0, 0.0)
        clock_s = [h * 3600 + m * 60 + s for seconds, h, m, s in delays if seconds < 0]
        assert len(clock_s) == len(delays) == 3
        for (index, leaves_s), clock in zip(mission.gates, clock_s[1:], strict=True):
            assert mission.items[index].command == Command.NAV_DELAY
            assert clock - DAY_START_S == pytest.approx(leaves_s - mission.leaves_s)


@pytest.mark.parametrize(
    ("order", "reason"),
    [
        (MissionOrder(Autopilot.PX4, gates=1, start_s=0), "cannot wait until a time of day"),
        (MissionOrder(Autopilot.ARDUPILOT, gates=1), "time of the common start is missing"),
        (MissionOrder(Autopilot.ARDUPILOT, gates=1, start_s=0, timed=False), "corrected"),
        (MissionOrder(Autopilot.ARDUPILOT, Altitude.TERRAIN, gates=1, start_s=0), "corrected"),
        (MissionOrder(Autopilot.ARDUPILOT, start_s=86_400), "start_s is 86400"),
    ],
)
def test_gates_that_nobody_has(order: MissionOrder, reason: str) -> None:
    with pytest.raises(UsageError, match=reason):
        order.refuse_impossible()


def test_too_many_gates(field: Plan) -> None:
    with pytest.raises(ScenarioError, match="30 gates do not fit"):
        corrected_legs(field, Autopilot.ARDUPILOT, 30)


@pytest.mark.long
def test_more_vehicles_with_legs_of_their_own_than_can_be_corrected(
    plan_of: Plans, monkeypatch: pytest.MonkeyPatch
) -> None:
    changes = plan_of("changes/scenario.toml")
    monkeypatch.setattr("gcs.mission.waypoints.arrival_times.VEHICLES_MAX", 3)
    with pytest.raises(VerificationError, match="7 vehicles need legs of their own") as caught:
        corrected_legs(changes, Autopilot.ARDUPILOT)
    assert "--format setpoints" in caught.value.hint
    assert "--untimed" in caught.value.hint


@pytest.mark.slow
def test_waypoints_are_raised_over_ground_that_long_legs_would_touch(simulation1_plan: Plan) -> None:
    limits = simulation1_plan.scenario.limits.model_copy(update={"clearance_min_m": 2.0})  # the plan is lower
    higher = simulation1_plan.scenario.model_copy(update={"limits": limits})
    legs = corrected_legs(replace(simulation1_plan, scenario=higher), Autopilot.ARDUPILOT)
    assert legs.raised_m is not None
    assert legs.raised_m[0] == legs.raised_m[-1] == 0.0
    assert 0.0 < legs.raised_m.max() < 5.0


def test_the_longest_climb_counts_at_the_speed_of_the_autopilot(field: Plan) -> None:
    """ArduCopter climbs at 2.5 m/s, PX4 at 3 m/s."""
    hover_ned_m = field.states(np.array([field.airborne_s]))
    climbs_m = [float(field.pads_ned_m[row, 2] - hover_ned_m[row, 0, 2]) for row in range(len(field.sysids))]
    assert max(climbs_m) > min(climbs_m) + 1.0
    assert climb_s(field, Autopilot.ARDUPILOT) == pytest.approx(sorted(climbs_m)[-1] / 2.5)
    assert climb_s(field, Autopilot.PX4) == pytest.approx(sorted(climbs_m)[-1] / 3.0)


def test_gates_are_whole_seconds_evenly_spread_and_20_s_apart() -> None:
    t_s = np.linspace(7.0, 107.0, 1001)  # 100 s
    assert _gate_samples(t_s, 0) == [0, 1000]
    assert _gate_samples(t_s, 2) == [0, 330, 670, 1000]
    assert _gate_samples(t_s, 4) == [0, 200, 400, 600, 800, 1000]
    with pytest.raises(ScenarioError, match="5 gates do not fit a flight of 100 s; limit 4"):
        _gate_samples(t_s, 5)
    with pytest.raises(ScenarioError):
        _gate_samples(t_s, -1)


def test_the_samples_of_a_flight_are_tenths_of_a_second_from_its_start(field: Plan) -> None:
    sampled = _Samples.of(field, slice(2, 3))
    assert (sampled.t_s[0], sampled.t_s[-1]) == (0.0, 220.0)
    np.testing.assert_allclose(np.diff(sampled.t_s), 0.1)
    np.testing.assert_allclose(sampled.position_ned_m[0], field.states(sampled.t_s)[2, :, :3], atol=0.01)


def test_too_many_items_are_refused_before_their_speeds_are_found(field: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    row = Autopilot.ARDUPILOT.traits
    monkeypatch.setattr("gcs.mission.waypoints.arrival_times._attempt", lambda *_: pytest.fail("speeds were found"))
    monkeypatch.setattr("gcs.mission.waypoints.arrival_times._CACHE", {})
    monkeypatch.setitem(TRAITS, Autopilot.ARDUPILOT, replace(row, missions=replace(row.missions, items_max=6)))
    with pytest.raises(ImpossibleMission, match="ArduCopter stores at most 6") as caught:
        corrected_legs(field, Autopilot.ARDUPILOT)
    assert "mission.tolerance_m" in caught.value.hint


@pytest.mark.parametrize(
    ("off_s", "tried", "chosen"),
    [
        ((1.0, 0.1, 0.1), 1, 0),  # good enough
        ((1.2, 1.16, 1.18), 3, 0),  # no other is better by 0.05 s
        ((1.2, 1.14, 1.1), 3, 1),
        ((1.2, 0.9, 0.1), 2, 1),
    ],
)
def test_other_placements_are_tried_until_one_is_good_and_count_if_clearly_better(
    field: Plan, monkeypatch: pytest.MonkeyPatch, off_s: tuple[float, ...], tried: int, chosen: int
) -> None:
    made: list[_Attempt] = []

    def attempt(*_: object) -> _Attempt:
        made.append(_Attempt(TimedLegs(np.zeros(1), 0.0, None, 0.0), off_s[len(made)]))  # type: ignore[arg-type]
        return made[-1]

    monkeypatch.setattr("gcs.mission.waypoints.arrival_times._attempt", attempt)
    monkeypatch.setattr("gcs.mission.waypoints.arrival_times._CACHE", {})
    legs = corrected_legs(field, Autopilot.ARDUPILOT)
    assert len(made) == tried
    assert legs is made[chosen].legs
    assert corrected_legs(field, Autopilot.ARDUPILOT) is legs
    assert len(made) == tried, "once for each plan"
