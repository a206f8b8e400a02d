"""The verdict on flights whose true states nobody knows: right, or not known, never wrong."""

from __future__ import annotations

import math

import numpy as np
import pyarrow as pa
import pytest

from gcs.autopilots.local_frame import local_frame
from gcs.flight.assessment.criterion import Criterion, CriterionName, FlightOutcome
from gcs.flight.assessment.judge import Truth, Verdict, judge, judge_reports, reported_tracks
from gcs.flight.monitoring.progress import OFF_PLAN, Event, FlightTimes, PlanTime, flown_plan_time
from gcs.flight.recording.record_table import ReportedAccuracy, build_record
from gcs.link.wire.message import Message
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.navigation_error import NavigationError
from gcs.scenario.values.si import local_origin
from gcs.types import Array

T0_UNIX_S, BOOT_UNIX_S = 1_700_000_100.0, 1_700_000_000.0
SIGMA_M = 0.02
ARMED = {"type": 2, "autopilot": 3, "base_mode": 128 | 1, "custom_mode": 4}


def told(
    plan: Plan, t_s: Array, states: Array, errors_m: Array, every: int, fixes: Array | None, high: float
) -> list[Message]:
    """What vehicles report of their states (V, N, 12): every so many samples, each with its own error (V, 3).

    Their barometers make every height above the pad `high` times what it is.
    """
    messages = []
    for row, sysid in enumerate(plan.sysids):
        messages.append(
            Message("SYSTEM_TIME", {"time_unix_usec": round((BOOT_UNIX_S + 1.0) * 1e6), "time_boot_ms": 1000}, sysid, 1)
        )
        messages.append(Message("HEARTBEAT", ARMED, sysid, 1))
        frame = local_frame(ARMED["autopilot"], local_origin(plan.scenario), plan.pads_ned_m[row])
        for n in range(0, len(t_s), every):
            has_fix = fixes is None or bool(fixes[n])
            acc = {"fix_type": 3 if has_fix else 0, "h_acc": round(SIGMA_M * 1e3), "v_acc": round(SIGMA_M * 1e3)}
            messages.append(Message("GPS_RAW_INT", acc, sysid, 1))
            at = frame.own_m(states[row, n, POSITION] + errors_m[row]) * (1.0, 1.0, high)
            rates = states[row, n, VELOCITY] * frame.counts
            values = zip(("x", "y", "z", "vx", "vy", "vz"), (*at, *rates), strict=True)
            boot_ms = round((T0_UNIX_S + t_s[n] - BOOT_UNIX_S) * 1e3)
            messages.append(Message("LOCAL_POSITION_NED", {"time_boot_ms": boot_ms, **dict(values)}, sysid, 1))
    return messages


def both(
    plan: Plan,
    change: object = None,
    errors_m: Array | None = None,
    fixes: object = None,
    clock: PlanTime | None = None,
    high: float = 1.0,
) -> tuple[Verdict, Verdict]:
    """The verdicts on a flight as planned but for `change`: from true states, and from reports at 10 Hz."""
    t_s = np.arange(plan.t_start_s, plan.t_end_s, 0.02)
    states = np.array(plan.states(t_s))
    if callable(change):
        change(t_s, states)
    plan_time = clock or PlanTime.of(T0_UNIX_S)
    times = FlightTimes(T0_UNIX_S + plan.airborne_s, T0_UNIX_S, T0_UNIX_S + plan.phase("landing").start_s, plan_time)
    true = judge(plan, Truth(plan.sysids, T0_UNIX_S + t_s, states), times)
    off_m = np.zeros((len(plan.sysids), 3)) if errors_m is None else errors_m
    said = told(plan, t_s, states, off_m, 5, fixes(t_s) if callable(fixes) else None, high)
    tracks = reported_tracks(plan, build_record(plan, plan_time, said), plan_time)
    assert tracks is not None
    return true, judge_reports(plan, tracks)


@pytest.mark.parametrize(
    ("lowest", "highest", "at_least", "outcome", "words"),
    [
        (1.1, 1.5, True, FlightOutcome.OK, "ok"),
        (0.5, 0.9, True, FlightOutcome.FAILED, "FAILED"),
        (0.9, 1.7, True, FlightOutcome.UNKNOWN, "not known within ±0.4 m"),
        (0.5, 0.9, False, FlightOutcome.OK, "ok"),
        (1.1, 1.5, False, FlightOutcome.FAILED, "FAILED"),
        (0.9, 1.7, False, FlightOutcome.UNKNOWN, "not known within ±0.4 m"),
        (-math.inf, math.inf, True, FlightOutcome.UNKNOWN, "not known"),
        (math.nan, math.nan, True, FlightOutcome.UNKNOWN, "not known"),
    ],
)
def test_a_limit_inside_the_range_of_the_true_value_is_not_decided(
    lowest: float, highest: float, at_least: bool, outcome: FlightOutcome, words: str
) -> None:
    found = Criterion(CriterionName.SEPARATION, "m", 1.3, 1.0, at_least, lowest=lowest, highest=highest)
    assert (found.outcome, found.verdict, found.ok) == (outcome, words, outcome is FlightOutcome.OK)


def test_a_failed_criterion_outweighs_one_that_is_not_known() -> None:
    ok, unknown, failed = (
        Criterion(CriterionName.HEIGHT, "m", 1.0, 1.0, True, lowest=low, highest=high)
        for low, high in ((1, 1), (0, 2), (0, 0.5))
    )
    for criteria, outcome in (
        ((ok, ok), FlightOutcome.OK),
        ((ok, unknown), FlightOutcome.UNKNOWN),
        ((failed, unknown, ok), FlightOutcome.FAILED),
    ):
        assert Verdict(criteria, {}, {}, 0.0).outcome is outcome


def test_plan_time_waits_while_vehicles_are_led_back() -> None:
    """T0 moved by 3 s at 1010, when the plan would have been at 10 s: it goes on at 7 s, where it waited."""
    time = PlanTime.of(1003.0, [(1002.0, 2.0), (math.nan, math.nan), (1010.0, 7.0), (1020.0, 17.0), (1011.0, 8.0)])
    assert time.t_s(np.array([999.0, 1005.0, 1007.0, 1008.0, 1010.0, 1012.0])).tolist() == [-1, 5, 7, 7, 7, 9]
    assert time.t0_unix_s == 1003.0
    again = PlanTime.of(1008.0, [(1002.0, 2.0), (1010.0, 7.0), (1020.0, 12.0)])
    assert again.t_s(np.array([1009.0, 1014.0, 1016.0, 1021.0])).tolist() == [7, 11, 12, 13]


@pytest.mark.slow
def test_no_position_error_counts_while_a_standstill_led_the_vehicles_off_the_plan(simulation1_plan: Plan) -> None:
    """Vehicles 5 m off from 60 to 80 s, as the event of the standstill has it; separation and fence count on."""

    def aside(t_s: Array, states: Array) -> None:
        states[:, (t_s > 60.0) & (t_s < 80.0), 0] += 5.0

    data = {OFF_PLAN: [T0_UNIX_S + 59.9, T0_UNIX_S + 80.1]}
    events = (
        Event(T0_UNIX_S + 1.0, 1.0, 2, "link lost"),
        Event(T0_UNIX_S + 72.0, 72.0, 0, "are led back", "", data),
        Event(T0_UNIX_S + 90.0, 90.0, 0, "told by a damaged file", "", {OFF_PLAN: "soon"}),
    )
    for verdict in both(simulation1_plan, aside):
        assert max(verdict.rms_m.values()) > 1.0
        assert verdict.not_counted == ""
    for verdict in both(simulation1_plan, aside, clock=flown_plan_time(T0_UNIX_S, events)):
        assert max(verdict.rms_m.values()) < 0.01
        assert verdict.off_plan_s == pytest.approx(20.2, abs=0.1)
        assert "position errors do not count 20" in verdict.not_counted


def test_events_that_do_not_know_the_last_t0_leave_one_piece() -> None:
    assert PlanTime.of(1003.0, [(1002.0, 2.0)]).t_s(np.array([1005.0])).tolist() == [2.0]


def test_the_larger_of_what_receiver_and_estimator_tell_counts() -> None:
    said = ReportedAccuracy(NavigationError(2.4, 2.8))
    assert said.within_m == (2.4, 2.8)
    said.receive(Message("GPS_RAW_INT", {"fix_type": 3, "h_acc": 300, "v_acc": 500}, 1, 1))
    assert said.within_m == pytest.approx((0.9, 1.5))
    ratios = {"pos_horiz_ratio": 0.5, "pos_vert_ratio": 0.0}
    told = Message("ESTIMATOR_STATUS", {"pos_horiz_accuracy": 0.4, "pos_vert_accuracy": 0.2, **ratios}, 1, 1)
    said.receive(told)
    assert said.within_m == pytest.approx((1.8, 1.5))
    said.receive(Message("EKF_STATUS_REPORT", {"pos_horiz_variance": 1.0, "pos_vert_variance": 0.0}, 1, 1))
    assert said.within_m == pytest.approx((math.inf, 1.5))
    alone = ReportedAccuracy(NavigationError(2.4, 2.8))
    alone.receive(Message("GPS_RAW_INT", {"fix_type": 2}, 1, 1))
    assert alone.within_m == (math.inf, math.inf)


@pytest.mark.parametrize("seed", range(4))
def test_a_verdict_from_reports_is_that_of_the_true_states_or_not_known(hop: Plan, seed: int) -> None:
    """Vehicles off their places by about a limit; errors of up to 3 sigma in their reports, and air up to 14 K off."""
    plan, chosen = hop, np.random.default_rng(seed)
    decided = wrong = 0
    for share in chosen.uniform(0.0, 2.0, 3):
        way = chosen.normal(size=(len(plan.sysids), 3))
        way /= np.linalg.norm(way, axis=1, keepdims=True)

        def change(_: Array, states: Array, off_m: Array = share * 0.15 * way) -> None:
            states[..., POSITION] += off_m[:, None]

        errors_m = chosen.uniform(-1.0, 1.0, (len(plan.sysids), 3)) * 3.0 * SIGMA_M * (0.7, 0.7, 1.0)
        high = chosen.uniform(0.955, 1.045)
        for true, found in zip(*(v.criteria for v in both(plan, change, errors_m, high=high)), strict=True):
            assert true.name == found.name
            assert found.lowest is not None
            assert found.highest is not None
            assert found.lowest - 1e-3 <= true.value <= found.highest + 1e-3 or true.unit == "s", true.name
            decided += found.outcome is not FlightOutcome.UNKNOWN
            wrong += found.outcome not in (FlightOutcome.UNKNOWN, true.outcome)
    assert wrong == 0
    assert decided >= 12


@pytest.mark.parametrize("off_s", [-40e4, 40e5])
def test_one_report_of_a_broken_clock_changes_nothing(hop: Plan, off_s: float) -> None:
    """A flipped bit of time_boot_ms puts a report days away: a grid of all the time between would take hours."""
    t_s = np.arange(hop.t_start_s, hop.t_end_s, 0.1)
    states, plan_time = np.array(hop.states(t_s)), PlanTime.of(T0_UNIX_S)
    said = told(hop, t_s, states, np.zeros((len(hop.sysids), 3)), 1, None, 1.0)
    good = build_record(hop, plan_time, said)
    row = good.slice(len(good) // 2, 1)
    for name in ("t_s", "unix_s"):
        column = row.column_names.index(name)
        row = row.set_column(column, name, pa.array([row.column(name)[0].as_py() + off_s]))
    expected, found = (reported_tracks(hop, each, plan_time) for each in (good, pa.concat_tables([good, row])))
    assert expected is not None and found is not None
    np.testing.assert_array_equal(found.t_s, expected.t_s)
    np.testing.assert_allclose(found.ned_m, expected.ned_m)


def test_a_collision_is_seen_in_reports(hop: Plan) -> None:
    def meet(t_s: Array, states: Array) -> None:
        now = np.abs(t_s - 15.0) < 0.5
        states[2, now, :6] = states[1, now, :6]

    true, found = both(hop, meet)
    assert true.outcome is found.outcome is FlightOutcome.FAILED
    (separation,) = (c for c in found.criteria if c.name == "separation")
    assert (separation.outcome, separation.vehicles) == (FlightOutcome.FAILED, "vehicles 2, 3")


def test_nothing_is_known_of_a_vehicle_without_a_fix(hop: Plan) -> None:
    _, found = both(hop, fixes=lambda t_s: np.abs(t_s - 15.0) > 2.0)
    assert found.outcome is FlightOutcome.UNKNOWN
    words = {c.name: c.verdict for c in found.criteria}
    assert words["position error (RMS)"] == "not known"
    assert words["separation"].startswith("not known within ±")
    assert words["arrival position"] == "ok"


def test_a_vehicle_that_is_heard_no_more_gives_no_figure_and_fails_nothing(hop: Plan) -> None:
    """Its last place is not where it is: the others fly through it, and it stays behind the plan."""
    t_s = np.arange(hop.t_start_s, hop.t_end_s, 0.1)
    states, plan_time, lost = np.array(hop.states(t_s)), PlanTime.of(T0_UNIX_S), hop.sysids[0]
    gone_s = hop.flight_s / 2.0
    there = int(np.searchsorted(t_s, gone_s))
    states[1, there + 10 :, POSITION] = states[0, there, POSITION]  # 1 s later in its last place
    states[1, there + 10 :, VELOCITY] = 0.0
    last_ms = (T0_UNIX_S + gone_s - BOOT_UNIX_S) * 1e3
    said = [
        message
        for message in told(hop, t_s, states, np.zeros((len(hop.sysids), 3)), 1, None, 1.0)
        if message.sysid != lost or message.fields.get("time_boot_ms", 0) <= last_ms
    ]
    tracks = reported_tracks(hop, build_record(hop, plan_time, said), plan_time)
    assert tracks is not None
    found = {one.name: one for one in judge_reports(hop, tracks).criteria}
    assert lost not in {one.sysid for one in found.values() if one.t_s is None or one.t_s > gone_s + 0.1}
    separation = found[CriterionName.SEPARATION]
    assert separation.outcome is FlightOutcome.UNKNOWN
    assert separation.value > 1.0
    for name in (CriterionName.SEPARATION, CriterionName.ZONES, CriterionName.FENCE):
        assert name not in found or found[name].outcome is not FlightOutcome.FAILED
