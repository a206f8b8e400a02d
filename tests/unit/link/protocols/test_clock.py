import random

import pytest

from gcs.link.protocols.clock import VehicleClock
from gcs.link.protocols.timesync import TimeSync
from gcs.link.wire.message import Message, Station

UNIX_S = 1_700_000_000.0
VEHICLE = Station(1, 1)


def system_time(boot_s, boot_unix_s=UNIX_S):
    stamps = {"time_unix_usec": round((boot_unix_s + boot_s) * 1e6), "time_boot_ms": round(boot_s * 1e3)}
    return Message("SYSTEM_TIME", stamps, *VEHICLE)


def attitude(boot_s):
    return Message("ATTITUDE", {"time_boot_ms": round(boot_s * 1e3)}, *VEHICLE)


def test_boot_time_becomes_unix_time_to_the_millisecond():
    clock = VehicleClock()
    assert clock.unix_s(1000) is None
    assert clock.now_unix_s(0.0) is None
    for n in range(1, 20):
        clock.receive(system_time(n * 0.9996), n)
    assert clock.unix_s(5000) == pytest.approx(UNIX_S + 5.0, abs=1e-3)
    assert clock.boot_ms(UNIX_S + 5.0) == pytest.approx(5000, abs=1)


def test_the_first_report_counts():
    clock = VehicleClock()
    clock.receive(system_time(30.0), 1.0)
    assert clock.ready
    assert clock.unix_s(0) == pytest.approx(UNIX_S, abs=1e-3)


@pytest.mark.parametrize("unix_usec", [2**64 - 1, 1, round(1.2e15), round(4.2e15)])
def test_a_time_of_no_flight_says_nothing(unix_usec):
    clock = VehicleClock()
    clock.receive(Message("SYSTEM_TIME", {"time_unix_usec": unix_usec, "time_boot_ms": 500}, *VEHICLE), 1.0)
    assert not clock.ready
    assert clock.boot_ms(UNIX_S) is None


def test_a_boot_stamp_fits_its_field():
    clock = VehicleClock()
    clock.receive(system_time(30.0), 1.0)
    assert clock.boot_ms(UNIX_S - 100.0) == 0
    assert clock.boot_ms(UNIX_S + 1e9) == 2**32 - 1


def test_a_boot_time_that_is_far_ahead_counts_once_it_is_confirmed():
    clock = VehicleClock()
    for n in range(1, 50):
        clock.receive(system_time(100 + 0.1 * n), 0.1 * n)
    before = clock.now_unix_s(5.0)
    for boot_s in (9000.0, 104.95, 9000.1):
        clock.receive(attitude(boot_s), 5.0)
    assert clock.now_unix_s(5.0) == pytest.approx(before, abs=0.1)
    for boot_s in (9000.2, 9000.3):
        clock.receive(attitude(boot_s), 5.1)
    assert clock.now_unix_s(5.1) == pytest.approx(UNIX_S + 9000.3, abs=0.1)


def test_unset_gnss_time_says_nothing():
    clock = VehicleClock()
    clock.receive(Message("SYSTEM_TIME", {"time_unix_usec": 0, "time_boot_ms": 500}, *VEHICLE), 1.0)
    assert not clock.ready


@pytest.mark.parametrize("rate", [0.5, 1.0, 10.0, 40.0])
def test_prediction_follows_a_vehicle_at_any_rate_through_jitter(rate):
    rng = random.Random(4)
    clock = VehicleClock(cap_s=5.0)
    worst = 0.0
    for n in range(400):
        sent_s = 100.0 + 0.02 * n
        arrival_s = sent_s + rng.uniform(0.001, 0.012)
        boot_s = 7.0 + (sent_s - 100.0) * rate
        clock.receive(system_time(boot_s) if n % 50 == 0 else attitude(boot_s), arrival_s)
        if n > 100:
            ask_s = arrival_s + 0.005
            truth = UNIX_S + 7.0 + (ask_s - 100.0) * rate
            worst = max(worst, abs(clock.now_unix_s(ask_s) - truth))
    assert clock.rate == pytest.approx(rate, rel=0.02)
    assert worst < 0.02 * rate + 0.002


def test_prediction_stops_at_the_cap_and_never_runs_back():
    clock = VehicleClock(cap_s=0.5)
    for n in range(1, 101):
        clock.receive(system_time(0.1 * n), 0.01 * n)  # ten times real time
    newest = UNIX_S + 10.0
    answers = [clock.now_unix_s(1.0 + 0.01 * k) for k in range(100)]
    assert answers == sorted(answers)
    assert answers[-1] == pytest.approx(newest + 0.5, abs=2e-3)
    clock.receive(attitude(10.1), 3.0)
    assert clock.now_unix_s(3.0) >= answers[-1]
    assert clock.now_unix_s(60.0) == pytest.approx(newest + 0.6, abs=2e-3)


def test_old_messages_change_nothing_and_a_reboot_everything():
    clock = VehicleClock()
    for n in range(1, 50):
        clock.receive(system_time(100 + 0.1 * n), 0.1 * n)
    before = clock.now_unix_s(5.0)
    clock.receive(attitude(102.0), 5.0)
    assert clock.now_unix_s(5.0) == before
    for boot_s in (1.0, 1.1):
        clock.receive(attitude(boot_s), 6.0)
        assert clock.ready  # a late frame of long ago, perhaps
    clock.receive(attitude(1.2), 6.0)
    assert not clock.ready
    assert clock.restarts == 1


def test_the_shortest_round_trip_wins():
    sync, ahead_s = TimeSync(VEHICLE), 1000.0
    for now_s, there_s, back_s in ((0.0, 0.3, 0.001), (1.0, 0.002, 0.002), (2.0, 0.01, 0.2)):
        question = sync.request(now_s)
        vehicle_ns = round((now_s + there_s + ahead_s) * 1e9)
        answer = Message("TIMESYNC", {"tc1": vehicle_ns, "ts1": question.fields["ts1"]})
        sync.receive(Message(answer.name, answer.fields, *VEHICLE), now_s + there_s + back_s)
    assert sync.best.offset_s == pytest.approx(ahead_s, abs=1e-6)
    assert sync.best.round_trip_s == pytest.approx(0.004, abs=1e-6)


def test_foreign_and_stale_answers_are_ignored():
    sync = TimeSync(VEHICLE)
    question = sync.request(5.0)
    sync.receive(Message("TIMESYNC", {"tc1": 5, "ts1": question.fields["ts1"]}, 9, 1), 5.1)
    sync.receive(Message("TIMESYNC", {"tc1": 5, "ts1": 123}, *VEHICLE), 5.1)
    sync.receive(Message("TIMESYNC", {"tc1": 0, "ts1": question.fields["ts1"]}, *VEHICLE), 5.1)
    assert sync.best is None


def test_messages_that_waited_while_this_program_stood_still_measure_nothing() -> None:
    clock = VehicleClock()
    for n in range(31):
        clock.receive(system_time(10.0 + 0.1 * n), 0.1 * n)  # real time, until 3.0 s
    before = clock.now_unix_s(3.0)
    assert before is not None
    clock.stood_still(9.0)
    for n in range(31, 60):  # half of them were lost: the socket was full
        clock.receive(attitude(10.0 + 0.1 * n), 9.0)
    for n in range(92, 120):
        now_s = 0.1 * n
        clock.receive(attitude(10.0 + now_s), now_s)
        assert clock.rate == pytest.approx(1.0, abs=1e-6)
        assert clock.now_unix_s(now_s) == pytest.approx(before + now_s - 3.0, abs=1e-3)


def test_what_is_learned_between_two_questions_at_one_instant_counts():
    clock = VehicleClock()
    clock.receive(system_time(10.0), 1.0)
    assert clock.now_unix_s(1.0) == pytest.approx(UNIX_S + 10.0)
    clock.receive(attitude(10.3), 1.0)
    assert clock.now_unix_s(1.0) == pytest.approx(UNIX_S + 10.3)
    clock.set_unix_s(UNIX_S + 60.0, 1.0)
    assert clock.now_unix_s(1.0) == pytest.approx(UNIX_S + 60.0)
    clock.follow_gnss()
    assert clock.now_unix_s(1.0) == pytest.approx(UNIX_S + 60.0)  # nothing is reported before it is held
    clock.hold()
    for _ in range(3):
        clock.receive(system_time(10.3), 1.0)
    clock.follow_gnss()
    assert clock.now_unix_s(1.0) == pytest.approx(UNIX_S + 10.3)
    clock.receive(system_time(10.3, UNIX_S + 0.2), 1.0)
    clock.receive(system_time(10.4, UNIX_S + 0.2), 1.0)
    assert UNIX_S + 10.4 < clock.now_unix_s(1.0) < UNIX_S + 10.5


def test_the_rate_is_that_of_the_samples_there_are():
    clock = VehicleClock()
    for n in range(1, 30):
        clock.receive(system_time(0.4 * n), 0.1 * n)
    assert clock.rate == pytest.approx(4.0)
    clock.stood_still(5.0)
    assert clock.rate == pytest.approx(4.0)  # kept, until there are samples again
    for n in range(1, 30):
        clock.receive(system_time(20.0 + 0.2 * n), 5.0 + 0.1 * n)
    assert clock.rate == pytest.approx(2.0)
    for n in range(1, 6):
        clock.receive(system_time(0.1 * n), 8.0 + 0.1 * n)  # it rebooted
    assert clock.restarts == 1
    assert clock.rate == 1.0
