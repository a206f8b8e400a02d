"""Faults by name, by file and by MAVLink, and when they are in force."""

from __future__ import annotations

import math

import pytest

from gcs.errors import UsageError
from gcs.link.wire.message import Message
from gcs.mavlink import MavResult
from sim_bridge.faults import fault_spec as f
from sim_bridge.faults.fault_commands import INJECT_FAILURE, USER_1, is_fault_command, read_order
from sim_bridge.faults.fault_spec import (
    Fault,
    LinkDirection,
    Since,
    When,
    make_fault,
    parse_fault,
    parse_faults,
    read_fault_file,
)
from sim_bridge.faults.injector import FaultSchedule

IDS = (1, 2, 3)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("3:loss=0.2", Fault(f.LOSS, (0.2,))),
        ("3:up.loss=1@10..30", Fault(f.LOSS, (1.0,), LinkDirection.UP, When(10.0, 30.0, Since.TAKEOFF))),
        ("3:down.delay=0.2,0.1", Fault(f.DELAY, (0.2, 0.1), LinkDirection.DOWN)),
        ("3:delay=0.2@start:5", Fault(f.DELAY, (0.2, 0.0), when=When(5.0, math.inf, Since.START))),
        ("3:silent", Fault(f.SILENT)),
        ("3:die@12.5", Fault(f.DIE, when=When(12.5, math.inf, Since.TAKEOFF))),
        ("3:reboot@upload:4", Fault(f.REBOOT, when=When(since=Since.UPLOAD, item=4))),
        ("3:gnss-jump=3,-4", Fault(f.GNSS_JUMP, (3.0, -4.0, 0.0))),
        ("3:motor=2,0.3@..9", Fault(f.MOTOR, (2.0, 0.3), when=When(0.0, 9.0, Since.TAKEOFF))),
        ("3:battery", Fault(f.BATTERY, (0.15,))),
        ("3:stuck=barometer@20..", Fault(f.STUCK, (3.0,), when=When(20.0, math.inf, Since.TAKEOFF))),
        ("3:slow=1.5", Fault(f.SLOW, (1.5,))),
        ("3:wind=4,-3@30", Fault(f.WIND, (4.0, -3.0, 0.0), when=When(30.0, math.inf, Since.TAKEOFF))),
        ("3:push=0,6@30..31", Fault(f.PUSH, (0.0, 6.0, 0.0), when=When(30.0, 31.0, Since.TAKEOFF))),
    ],
)
def test_faults_as_people_write_them(text, fault):
    assert parse_fault(text) == (3, fault)


def test_all_means_every_vehicle_and_faults_add_up():
    faults = parse_faults(["all:loss=0.1", "2:die@3"], IDS)
    assert [len(faults[n]) for n in IDS] == [1, 2, 1]


@pytest.mark.parametrize(
    "text",
    [
        *("9:silent", "silent", "3:lame", "3:die@", "3:die@-1", "3:die@nan", "x:silent", "3:", ""),
        *("3:loss", "3:loss=2", "3:loss=nan", "3:loss=0.1,0.2", "3:loss=x", "3:up.reboot", "3:loss=0.1@30..10"),
        *("3:motor=5", "3:motor=1.5", "3:stuck=nose", "3:reboot@upload:x", "3:loss=0.1@landing:3", "3:delay=0.1@5..5"),
        *("3:wind", "3:wind=31", "3:push=inf", "3:push=0,nan", "3:motor=1,1.1", "3:battery=-0.1", "3:slow=0"),
        "3:gnss-jump=nan",
    ],
)
def test_wrong_faults_are_quoted(text):
    with pytest.raises(UsageError) as refused:
        parse_faults([text], IDS)
    assert repr(text) in refused.value.message
    assert refused.value.hint


def test_kinds_have_names_and_numbers_of_their_own():
    assert len({kind.name for kind in f.KINDS}) == len({kind.number for kind in f.KINDS}) == len(f.KINDS)
    assert all(f.kind_of(kind.number) is kind for kind in f.KINDS)
    assert f.kind_of(0) is None


def test_a_fault_file_says_the_same_by_vehicle(tmp_path):
    path = tmp_path / "faults.toml"
    path.write_text('[faults]\nall = ["down.loss=0.05"]\n3 = ["loss=0.2@10..30", "gnss-outage@20..40"]\n')
    assert read_fault_file(path) == ["all:down.loss=0.05", "3:loss=0.2@10..30", "3:gnss-outage@20..40"]


@pytest.mark.parametrize(
    "text", ["[faults", "x = 1", "[faults]\n3 = 'loss'", "[faults]\n3 = [1]", "[faults]\n[more]", ""]
)
def test_a_wrong_fault_file_is_named(tmp_path, text):
    path = tmp_path / "faults.toml"
    path.write_text(text)
    with pytest.raises(UsageError, match=r"faults\.toml"):
        read_fault_file(path)
    with pytest.raises(UsageError, match=r"nowhere\.toml"):
        read_fault_file(tmp_path / "nowhere.toml")


# When


def began(schedule: FaultSchedule, t_s: float) -> list[str]:
    return [fault.kind.name for fault in schedule.step(t_s) or ()]


def active(schedule: FaultSchedule) -> list[str]:
    return [fault.kind.name for fault in schedule.active]


def agenda_of(*texts: str) -> FaultSchedule:
    schedule = FaultSchedule()
    for text in texts:
        schedule.add(parse_fault(f"1:{text}")[1], 0.0)
    return schedule


def test_a_fault_without_a_time_is_always_in_force():
    schedule = agenda_of("loss=0.1")
    assert began(schedule, 0.0) == ["loss"]
    assert schedule.step(1000.0) is None
    assert active(schedule) == ["loss"]


def test_times_count_from_take_off_and_again_from_the_next_one():
    schedule = agenda_of("slow=1@10..30")
    assert schedule.step(50.0) is None
    for moment_s in (60.0, 200.0):
        schedule.flies(False, moment_s - 1.0)
        schedule.flies(True, moment_s)
        schedule.flies(True, moment_s + 1.0)
        assert began(schedule, moment_s + 9.99) == []
        assert began(schedule, moment_s + 10.0) == ["slow"]
        assert active(schedule) == ["slow"]
        assert schedule.step(moment_s + 29.99) is None
        assert began(schedule, moment_s + 30.0) == []
        assert active(schedule) == []


def test_an_upload_strikes_once_at_its_item():
    schedule = agenda_of("reboot@upload:2")
    assert not schedule.awaits_upload(1)
    assert schedule.awaits_upload(2)
    schedule.uploaded(2, 7.0)
    assert began(schedule, 7.0) == ["reboot"]
    assert active(schedule) == []
    assert not schedule.awaits_upload(2)


def test_what_strikes_at_once_is_over_at_once_and_the_rest_keeps_its_order():
    schedule = agenda_of("loss=0.1@start:1", "reboot@start:1", "loss=0.5@start:2..3")
    assert began(schedule, 1.5) == ["loss", "reboot"]
    assert began(schedule, 2.0) == ["loss"]
    assert [fault.values[0] for fault in schedule.active] == [0.1, 0.5]
    schedule.step(3.0)
    assert [fault.values[0] for fault in schedule.active] == [0.1]


def test_ending_a_kind_ends_what_is_in_force_and_what_is_to_come():
    schedule = agenda_of("loss=0.1", "delay=1", "loss=0.3@start:9", "loss=0.2@5")
    schedule.step(0.0)
    schedule.end([f.LOSS])
    schedule.step(0.0)
    schedule.flies(True, 1.0)
    assert began(schedule, 100.0) == []
    assert active(schedule) == ["delay"]


def test_a_live_fault_counts_from_now():
    schedule = FaultSchedule()
    schedule.add(make_fault(f.LOSS, (0.2,), when=When(1.0, 3.0)), 40.0)
    assert [began(schedule, t_s) for t_s in (40.5, 41.0)] == [[], ["loss"]]
    schedule.step(43.0)
    assert active(schedule) == []


# By MAVLink


def command(number: int, *params: float, name: str = "COMMAND_LONG") -> Message:
    full = [*params, *[0.0] * (7 - len(params))]
    return Message(name, {"command": number, **{f"param{i + 1}": p for i, p in enumerate(full)}}, 255, 190)


def test_which_commands_are_for_the_emulator():
    assert is_fault_command(command(USER_1))
    assert is_fault_command(command(INJECT_FAILURE, name="COMMAND_INT"))
    assert not is_fault_command(command(400))
    assert not is_fault_command(Message("HEARTBEAT", {}))


@pytest.mark.parametrize(
    ("params", "fault"),
    [
        ((1, 0.25, 0, 0, 2), Fault(f.LOSS, (0.25,), LinkDirection.DOWN)),
        ((5, 0.3, math.nan, 0, 1, 2, 10), Fault(f.DELAY, (0.3, 0.0), LinkDirection.UP, When(2.0, 12.0))),
        ((11, 5, -3, 1), Fault(f.GNSS_JUMP, (5.0, -3.0, 1.0))),
        ((13, math.nan), Fault(f.BATTERY, (0.15,))),
        ((9,), Fault(f.REBOOT)),
    ],
)
def test_the_user_command_says_everything(params, fault):
    order = read_order(command(USER_1, *params))
    assert (order.result, list(order.begins), list(order.ends)) == (MavResult.ACCEPTED, [fault], [])


@pytest.mark.parametrize(
    "params", [(99,), (math.nan,), (1, 7), (1, math.nan), (1, 0.1, 0, 0, 3), (9, 0, 0, 0, 1), (1, 0.1, 0, 0, 0, -1)]
)
def test_nonsense_is_denied(params):
    order = read_order(command(USER_1, *params))
    assert (order.result, order.begins) == (MavResult.DENIED, ())
    assert read_order(command(USER_1, 1, 0.1, name="COMMAND_INT")).result == MavResult.COMMAND_LONG_ONLY


def test_zero_ends_everything():
    assert set(read_order(command(USER_1, 0)).ends) == set(f.KINDS)


@pytest.mark.parametrize(
    ("params", "begins"),
    [
        ((4, 1), [(f.GNSS_OUTAGE, ())]),
        ((4, 2), [(f.STUCK, (4.0,))]),
        ((0, 2), [(f.STUCK, (0.0,))]),
        ((101, 1, 3), [(f.MOTOR, (3.0, 1.0))]),
        ((101, 1, 0), [(f.MOTOR, (n, 1.0)) for n in (1.0, 2.0, 3.0, 4.0)]),
        ((105, 7), [(f.LOSS, (0.3,))]),
    ],
)
def test_failures_that_clients_know_by_name(params, begins):
    order = read_order(command(INJECT_FAILURE, *params))
    assert order.result == MavResult.ACCEPTED
    assert [(fault.kind, fault.values) for fault in order.begins] == begins


def test_a_failure_is_mended_or_not_known():
    assert read_order(command(INJECT_FAILURE, 4, 0)).ends == (f.STUCK, f.GNSS_OUTAGE, f.GNSS_JUMP)
    assert read_order(command(INJECT_FAILURE, 8, 1)).result == MavResult.UNSUPPORTED
    assert read_order(command(INJECT_FAILURE, 101, 1, 9)).result == MavResult.DENIED
    assert read_order(command(INJECT_FAILURE, math.nan)).result == MavResult.DENIED
