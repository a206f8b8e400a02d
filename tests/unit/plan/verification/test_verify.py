"""The verifier: Simulation 1 passes with the figures asked for, and every kind of spoiled plan fails for its reason."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.plan.formation.shape import joined, rigid
from gcs.plan.trajectory.phases import Phase
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.plan.verification.verify import Report, verify
from tests.unit.plan.problems import alone, changed

EQ_1 = "Eq. 1 re-integrated over 5 s"
JOINTS = "state continuous at joints"


def failing(plan: Plan) -> set[str]:
    report = verify(plan)
    assert report.ok == (not report.failures)
    return {check.name for check in report.failures}


@pytest.fixture(scope="module")
def simulation1_report(simulation1_plan: Plan) -> Report:
    return verify(simulation1_plan)


def test_simulation1_holds_what_was_asked_of_it(simulation1_plan: Plan, simulation1_report: Report) -> None:
    report = simulation1_report
    assert report.ok, [str(check) for check in report.failures]
    assert report.clearance_min_m >= 0.5 - 1e-3
    assert report.window_error_max_m <= 10e-3
    assert report.terminal_error_m <= 1e-3
    assert report.separation_min_m is not None
    assert report.separation_min_m >= 0.4
    assert simulation1_plan.phase("mission") == Phase("mission", 0.0, 275.0)
    arrived = simulation1_plan.states(np.array([275.0]))[simulation1_plan.leader, 0]
    np.testing.assert_allclose(arrived[:3], [1200, 1000, -2], atol=1e-3)
    np.testing.assert_allclose(arrived[3:6], 0, atol=1e-6)


def test_every_phase_is_judged_by_every_limit(simulation1_report: Report) -> None:
    by_phase: dict[str, set[str]] = {}
    for check in simulation1_report.checks:
        by_phase.setdefault(check.phase, set()).add(check.name)
    assert set(by_phase) == {"takeoff", "hover", "run-up", "mission", "arrival-hover", "landing", "all"}
    everywhere = set.intersection(*(names for phase, names in by_phase.items() if phase != "all"))
    assert {"height", "north speed", "pitch", "yaw rate", "thrust U1", "control U4", "separation"} <= everywhere
    boxed = {phase for phase, names in by_phase.items() if {"north position", "east position"} <= names}
    assert boxed == {"takeoff", "hover", "run-up", "mission", "arrival-hover", "landing"}
    assert {check.verdict for check in simulation1_report.checks} == {"proved"}
    airborne = {phase for phase, names in by_phase.items() if "clearance above ground" in names}
    assert airborne == {"hover", "run-up", "mission", "arrival-hover"}
    assert all("height above ground" in by_phase[phase] for phase in ("takeoff", "landing"))


def test_the_figures_are_those_of_a_finer_look(simulation1_plan: Plan, simulation1_report: Report) -> None:
    """Clearance and separation over the whole mission every 5 ms, with the ground of Eqs. 52 and 53 written anew."""
    t = np.linspace(0, 275, 55001)[:-1]
    position = simulation1_plan.states(t)[..., :3]
    x, y = position[..., 0], position[..., 1]
    r = np.hypot(x, y)
    ripple = np.abs(np.sin(y + 10) + 0.2 * np.sin(x) + 0.1 * np.cos(0.6 * r) + np.cos(y) + 0.1 * np.sin(0.1 * r))
    peaks = np.zeros_like(x)
    for cx, cy, h, sx, sy in zip(
        [500, 300, 300, 1300, 760, 700, 1300],
        [1100, 410, 800, 450, 750, 200, 1300],
        [55, 20, 40, 30, 48, 25, 31],
        [50, 40, 30, 86, 87, 60, 30],
        [50, 30, 20, 79, 83, 90, 30],
        strict=True,
    ):
        peaks += h * np.exp(-(((x - cx) / sx) ** 2) - ((y - cy) / sy) ** 2)
    height = (-position[..., 2] - np.maximum(ripple, peaks)).min()
    # The distance in any direction is no more than the height, and over these slopes no less than half of it.
    assert 0.5 * height <= simulation1_report.clearance_min_m <= height
    pairs = np.linalg.norm(position[:, None, ::100] - position[None, :, ::100], axis=-1)
    assert pairs[~np.eye(6, dtype=bool)].min() == pytest.approx(0.5)


def test_the_small_flight_passes(meadow_report: Report) -> None:
    assert meadow_report.ok, [str(check) for check in meadow_report.failures]


def test_one_vehicle_has_no_separation(meadow_plan: Plan) -> None:
    scenario = alone(meadow_plan.scenario)
    leader = meadow_plan.leader
    shape = replace(meadow_plan.shape, basis_ned_m=meadow_plan.shape.basis_ned_m[:, leader : leader + 1])
    report = verify(replace(meadow_plan, scenario=scenario, shape=shape))
    assert report.ok
    assert report.separation_min_m is None
    assert "separation" not in {check.name for check in report.checks}


# What the plan is judged by is changed; the flight is the same.
STRICTER: list[tuple[str, dict[str, Any], set[str]]] = [
    ("north speed", {"limits": {"speed_ned_mps": [2.0, 5.0, 2.0]}}, {"north speed"}),
    ("east speed", {"limits": {"speed_ned_mps": [5.0, 0.5, 2.0]}}, {"east speed"}),
    ("vertical speed", {"limits": {"speed_ned_mps": [5.0, 5.0, 0.1]}}, {"vertical speed"}),
    ("roll", {"limits": {"roll_pitch_yaw_deg": [0.01, 60.0, 60.0]}}, {"roll"}),
    ("pitch", {"limits": {"roll_pitch_yaw_deg": [180.0, 0.1, 60.0]}}, {"pitch"}),
    ("yaw", {"limits": {"roll_pitch_yaw_deg": [180.0, 60.0, 0.01]}}, {"yaw"}),
    ("roll rate", {"limits": {"rates_degps": [0.01, 10.0, 5.0]}}, {"roll rate"}),
    ("pitch rate", {"limits": {"rates_degps": [32.0, 0.1, 5.0]}}, {"pitch rate"}),
    ("yaw rate", {"limits": {"rates_degps": [32.0, 10.0, 0.001]}}, {"yaw rate"}),
    ("thrust", {"limits": {"thrust_N": [0.0, 4.91]}}, {"thrust U1"}),
    ("roll torque", {"limits": {"roll_pitch_force_N": [1e-4, 0.0501]}}, {"control U2"}),
    ("pitch torque", {"limits": {"roll_pitch_force_N": [0.0501, 1e-4]}}, {"control U3"}),
    ("yaw torque", {"limits": {"yaw_moment_Nm": 1e-9}}, {"control U4"}),
    ("rotors", {"vehicle": {"rotor_max_radps": 333.5}}, {"rotor speed"}),
    ("ceiling", {"limits": {"height_m": [0.0, 4.99]}}, {"height"}),
    ("box north", {"limits": {"north_m": [0.1, 1500.0]}}, {"north position"}),
    ("box east", {"limits": {"east_m": [0.0, 13.0]}}, {"east position"}),
    ("clearance", {"limits": {"clearance_min_m": 3.01}}, {"clearance above ground"}),
    ("turning", {"limits": {"load_factor_max": 1e-3}}, {"turning load factor"}),
    ("separation", {"limits": {"separation_min_m": 2.01}}, {"separation"}),
    ("disk", {"no_fly": [{"north_m": 20.0, "east_m": 7.0, "radius_m": 3.0}]}, {"no-fly zone 1"}),
    (
        "polygon",
        {"no_fly": [{"polygon_m": [[15.0, 0.0], [25.0, 0.0], [25.0, 14.0], [24.0, 4.0]]}]},
        {"no-fly zone 1"},
    ),
    (
        "moving disk",  # where it stands nobody comes near it
        {
            "no_fly": [
                {"north_m": 20.0, "east_m": 90.0, "radius_m": 3.0, "moves": [[0, 0, 0], [10, 0, -83], [20, 0, 0]]}
            ]
        },
        {"no-fly zone 1"},
    ),
    ("arrival", {"time": {"flight_s": 20.000001}}, {"arrival time"}),
    ("start attitude", {"start": {"roll_pitch_yaw_deg": [0.0, -1.0, 0.0]}}, {"start attitude"}),
    ("start velocity", {"start": {"velocity_mps": [0.0, 0.0, 0.01]}}, {"start velocity"}),
    ("start", {"start": {"position_m": [2.0, 1.0, 3.005]}}, {"start position"}),
    ("end, 5 mm", {"end": {"position_m": [40.0, 14.005, 5.0]}}, {"end position", "landing point"}),
    ("end velocity", {"end": {"velocity_mps": [0.01, 0.0, 0.0]}}, {"end velocity"}),
    ("end attitude", {"end": {"roll_pitch_yaw_deg": [0.0, 0.0, 0.02]}}, {"end attitude"}),
    (
        "a hill",
        {
            "terrain": {
                "mountains": {
                    "north_m": [20.0],
                    "east_m": [7.0],
                    "height_m": [4.5],
                    "spread_north_m": [2.0],
                    "spread_east_m": [2.0],
                }
            }
        },
        {"clearance above ground"},
    ),
    ("heavier", {"vehicle": {"mass_kg": 0.502}}, {EQ_1}),
    ("more drag", {"vehicle": {"drag_Nspm": [0.083, 0.073, 0.073]}}, {EQ_1}),
]


@pytest.mark.parametrize(("tables", "fails"), [case[1:] for case in STRICTER], ids=[case[0] for case in STRICTER])
def test_a_stricter_scenario_fails_that_check_and_no_other(
    meadow_plan: Plan,
    meadow_report: Report,
    monkeypatch: pytest.MonkeyPatch,
    tables: dict[str, Any],
    fails: set[str],
) -> None:
    if EQ_1 not in fails:  # the same motion of the same vehicles: it need not be integrated again
        (integrated,) = (check for check in meadow_report.checks if check.name == EQ_1)
        monkeypatch.setattr("gcs.plan.verification.verify._window_check", lambda _: integrated)
    assert failing(replace(meadow_plan, scenario=changed(meadow_plan.scenario, **tables))) == fails


def with_motion(plan: Plan, state: PPoly | None = None, control: PPoly | None = None) -> Plan:
    old = plan.leader_trajectory
    return replace(plan, leader_trajectory=Trajectory(state or old.state, control or old.control))


def shifted(part: PPoly, row: int, by: float, pieces: slice = slice(None)) -> PPoly:
    """One component moved by a constant over some of the polynomials."""
    c = part.c.copy()
    c[-1, pieces, row] += by
    return PPoly(c, part.x)


def in_flight(plan: Plan, t_s: float = 10.0) -> slice:
    """The polynomial flown at that time."""
    piece = int(np.searchsorted(plan.leader_trajectory.joints_s, t_s, side="right")) - 1
    return slice(piece, piece + 1)


def lowered_over_the_mountain(plan: Plan) -> Plan:
    return with_motion(plan, state=shifted(plan.leader_trajectory.state, 2, 18.0, in_flight(plan, 186.5)))


@pytest.mark.slow
def test_simulation1_flown_lower_over_its_mountain_fails(simulation1_plan: Plan) -> None:
    fails = failing(lowered_over_the_mountain(simulation1_plan))
    assert fails == {"clearance above ground", JOINTS, EQ_1}


def yaw_rate_raised(plan: Plan) -> Plan:
    return with_motion(plan, state=shifted(plan.leader_trajectory.state, 11, np.radians(8.0), in_flight(plan)))


def control_scaled(plan: Plan) -> Plan:
    old = plan.leader_trajectory.control
    return with_motion(plan, control=PPoly(old.c * 1.01, old.x))


def torque_at_one_joint(plan: Plan) -> Plan:
    return with_motion(plan, control=shifted(plan.leader_trajectory.control, 1, 0.06, in_flight(plan)))


def joint_shifted(plan: Plan) -> Plan:
    old = plan.leader_trajectory
    x = old.joints_s.copy()
    x[in_flight(plan).start] += 0.005
    return replace(plan, leader_trajectory=Trajectory(PPoly(old.state.c, x), PPoly(old.control.c, x)))


def end_moved(plan: Plan) -> Plan:
    """The last polynomial of the mission gains 5 mm and no speed: a step at its beginning."""
    return with_motion(plan, state=shifted(plan.leader_trajectory.state, 0, 0.005, in_flight(plan, 19.999)))


def begun_in_the_ground(plan: Plan) -> Plan:
    return with_motion(plan, state=shifted(plan.leader_trajectory.state, 2, 0.005, slice(0, 1)))


def follower_beside_another(plan: Plan) -> Plan:
    """In the air, the second vehicle 0.3 m beside the third."""
    up, down = plan.phases[0].end_s, plan.phases[-1].start_s
    beside = plan.shape.at(0.0)
    beside[1] = beside[2] + [0.3, 0.0, 0.0]
    ends = [rigid(plan.shape.at(t), *span) for t, span in ((0.0, (plan.t_start_s, up)), (0.0, (down, plan.t_end_s)))]
    return replace(plan, shape=joined([ends[0], rigid(beside, up, down), ends[1]]))


def follower_out_of_place(plan: Plan) -> Plan:
    """The whole time 5 mm west of where the formation has it."""
    tables = plan.shape.basis_ned_m.copy()
    tables[:, 1, 1] -= 0.005
    return replace(plan, shape=replace(plan.shape, basis_ned_m=tables))


def follower_climbs_unpaid(plan: Plan) -> Plan:
    """The leader's thrust no longer matches its motion in the climb alone."""
    old = plan.leader_trajectory.control
    c = old.c.copy()
    c[:-1, 0, 0] = 0.0
    return with_motion(plan, control=PPoly(c, old.x))


def no_number(plan: Plan) -> Plan:
    return with_motion(plan, control=shifted(plan.leader_trajectory.control, 3, np.nan, in_flight(plan)))


def nowhere(plan: Plan) -> Plan:
    return with_motion(plan, state=shifted(plan.leader_trajectory.state, 2, np.nan, in_flight(plan)))


def arrived_late(plan: Plan) -> Plan:
    late = [Phase("mission", 0.0, 20.01) if p.name == "mission" else p for p in plan.phases]
    return replace(plan, phases=tuple(late))


SPOILED: list[tuple[Callable[[Plan], Plan], set[str]]] = [
    (yaw_rate_raised, {"yaw rate", JOINTS, EQ_1}),
    (control_scaled, {EQ_1, "thrust U1"}),  # the climb was near its limit
    (torque_at_one_joint, {"control U2", "control continuous at joints", EQ_1}),
    (joint_shifted, {JOINTS, EQ_1}),
    (end_moved, {"end position", JOINTS}),
    (begun_in_the_ground, {"take-off point", "height above ground", JOINTS}),
    (follower_beside_another, {"separation", "place in formation", JOINTS}),
    (follower_out_of_place, {"place in formation", "take-off point", "landing point", "east position"}),
    (follower_climbs_unpaid, {EQ_1}),
    (arrived_late, {"arrival time"}),
]


@pytest.mark.parametrize(("spoil", "fails"), SPOILED, ids=[spoil.__name__ for spoil, _ in SPOILED])
def test_a_spoiled_flight_fails_for_its_reason(
    meadow_plan: Plan, spoil: Callable[[Plan], Plan], fails: set[str]
) -> None:
    assert failing(spoil(meadow_plan)) == fails


@pytest.mark.parametrize(
    ("spoil", "among"),
    [
        (no_number, {"control U4", "rotor speed", EQ_1}),
        (nowhere, {"clearance above ground", "height", EQ_1, JOINTS}),
    ],
    ids=["control", "state"],
)
def test_what_is_no_number_never_passes(meadow_plan: Plan, spoil: Callable[[Plan], Plan], among: set[str]) -> None:
    assert among <= failing(spoil(meadow_plan))


def test_a_check_says_what_who_when_and_by_how_much(meadow_plan: Plan) -> None:
    slow = changed(meadow_plan.scenario, limits={"speed_ned_mps": [2.0, 5.0, 2.0]})
    (failure,) = verify(replace(meadow_plan, scenario=slow)).failures
    fastest = meadow_plan.states(np.linspace(0, 20, 2001))[0, :, 3].max()
    assert failure.worst == pytest.approx(2.0 - fastest, abs=1e-3)
    assert str(failure).startswith(f"north speed, mission: violated by {fastest - 2.0:.2f}"[:-1])
    assert failure.sysid == 1
    assert failure.t_s is not None
    assert 0 < failure.t_s < 20
