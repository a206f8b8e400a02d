"""The common time of a fleet: jumps of one clock, of two, of all, late links, reboots and silence."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.flight.monitoring.fleet_time import AGREE_S, ClockChange, FleetClock, common_time_s, differences_s, disagreeing
from gcs.link.protocols.clock import JUMP_S, VehicleClock
from gcs.link.wire.message import GROUND, Message
from tests.real_flights import FLIGHTS, Flight, unpacked

EPOCH_S = 1_700_000_000.0
PERIOD_S = 0.1  # between two messages; every fifth is a SYSTEM_TIME
FULL_RATES = [0.7, 1.0, 10.0, 60.0]


class Fleet:
    """Vehicles whose true time is `EPOCH_S + rate * local time`, each with its own boot time, delay and jumps."""

    def __init__(self, count: int, rate: float = 1.0) -> None:
        self.rate = rate
        self.now_s = 0.0  # local
        self.clocks = {sysid: VehicleClock() for sysid in range(1, count + 1)}
        self.boot_s = {sysid: 50.0 + 7.0 * sysid for sysid in self.clocks}
        self.delay_s = dict.fromkeys(self.clocks, 0.0)
        self.ahead_s = dict.fromkeys(self.clocks, 0.0)  # of its GNSS time
        self.silent: set[int] = set()
        self.fleet = FleetClock()
        self.said: list[tuple[int, str]] = []
        self._steps = 0

    @property
    def true_s(self) -> float:
        """Unix time now, by the clocks that are right."""
        return EPOCH_S + self.rate * self.now_s

    def run(self, seconds: float) -> list[float]:
        """Let local time pass; return the common time after every message."""
        shown = []
        for _ in range(round(seconds / (PERIOD_S / self.rate))):
            self.now_s += PERIOD_S / self.rate
            self._steps += 1
            for sysid, clock in self.clocks.items():
                if sysid in self.silent:
                    continue
                sent_s = self.rate * (self.now_s - self.delay_s[sysid])
                boot_ms = round(1e3 * (self.boot_s[sysid] + sent_s))
                stamps = {"time_boot_ms": boot_ms}
                if self._steps % 5 == 0:
                    unix_s = EPOCH_S + sent_s + self.ahead_s[sysid]
                    clock.receive(Message("SYSTEM_TIME", {**stamps, "time_unix_usec": round(unix_s * 1e6)}), self.now_s)
                else:
                    clock.receive(Message("ATTITUDE", stamps), self.now_s)
            self.said += [(change.sysid, change.what) for change in self.fleet.changes(self.clocks, self.now_s)]
            common_s = self.fleet.unix_s(self.clocks, self.now_s)
            assert common_s is not None or self._steps < 5
            shown.append(math.nan if common_s is None else common_s)
        return shown

    def hold(self) -> None:
        self.fleet.hold(self.clocks, self.now_s)

    def off_s(self) -> dict[int, float]:
        """How far each clock is from the truth."""
        read = {sysid: clock.now_unix_s(self.now_s) for sysid, clock in self.clocks.items()}
        return {sysid: unix_s - self.true_s for sysid, unix_s in read.items() if unix_s is not None}


def held(count: int, rate: float = 1.0) -> Fleet:
    fleet = Fleet(count, rate)
    fleet.run(10.0 / rate)
    fleet.hold()
    fleet.run(10.0 / rate)
    assert fleet.said == []
    return fleet


def words(ahead_s: float) -> str:
    return f"has a GNSS time that is off by {ahead_s:+.1f} s: it flies by its boot clock"


@pytest.mark.parametrize("ahead_s", [20.0, -20.0, 3600.0, -86400.0, 0.7])
@pytest.mark.parametrize("count", [1, 2, 3, 6])
def test_a_jump_is_told_and_not_followed_and_its_end_is_told(count: int, ahead_s: float) -> None:
    fleet = held(count)
    fleet.ahead_s[1] = ahead_s
    times = fleet.run(30.0)
    assert times == sorted(times)
    assert fleet.said == [(1, words(ahead_s))]
    assert max(map(abs, fleet.off_s().values())) < 0.05
    assert times[-1] == pytest.approx(fleet.true_s, abs=0.05)
    fleet.ahead_s[1] = 0.0
    fleet.run(10.0)
    assert fleet.said[1:] == [(1, "has a GNSS time that agrees with its boot clock again")]


@pytest.mark.parametrize("rate", FULL_RATES)
def test_all_jump_together_and_the_fleet_keeps_its_time(rate: float) -> None:
    fleet = held(3, rate)
    fleet.ahead_s = dict.fromkeys(fleet.clocks, -37.0)
    times = fleet.run(30.0 / rate)
    assert sorted(fleet.said) == [(sysid, words(-37.0)) for sysid in (1, 2, 3)]
    assert times[-1] == pytest.approx(fleet.true_s, abs=0.15)


def test_one_wrong_report_says_nothing() -> None:
    fleet = held(3)
    stamps = {"time_boot_ms": round(1e3 * (fleet.boot_s[2] + fleet.now_s)) + 1, "time_unix_usec": 2**64 - 1}
    fleet.clocks[2].receive(Message("SYSTEM_TIME", stamps), fleet.now_s)
    stamps["time_unix_usec"] = round(1e6 * (fleet.true_s + 900.0))
    fleet.clocks[2].receive(Message("SYSTEM_TIME", stamps), fleet.now_s)
    fleet.run(10.0)
    assert fleet.said == []
    assert max(map(abs, fleet.off_s().values())) < 0.05


def test_before_the_clocks_are_held_gnss_may_set_them_back() -> None:
    fleet = Fleet(3)
    fleet.ahead_s = dict.fromkeys(fleet.clocks, 86_400.0)
    fleet.run(5.0)
    fleet.ahead_s = dict.fromkeys(fleet.clocks, 0.0)
    assert fleet.run(5.0)[-1] == pytest.approx(fleet.true_s, abs=0.05)
    fleet.hold()
    assert fleet.run(5.0)[-1] == pytest.approx(fleet.true_s, abs=0.05)
    assert fleet.said == []


def test_one_that_is_off_when_the_clocks_are_held_gets_the_time_of_the_others() -> None:
    fleet = Fleet(3)
    fleet.ahead_s[3] = 20.0
    fleet.run(10.0)
    assert list(disagreeing(fleet.clocks, fleet.now_s)) == [3]
    fleet.hold()
    fleet.run(5.0)
    assert fleet.said == [(3, words(20.0))]
    assert max(map(abs, fleet.off_s().values())) < 0.05


def test_of_two_that_differ_both_are_named() -> None:
    fleet = Fleet(2)
    fleet.ahead_s[2] = 20.0
    fleet.run(5.0)
    assert disagreeing(fleet.clocks, fleet.now_s) == pytest.approx({1: -20.0, 2: 20.0}, abs=0.1)
    assert differences_s({1: fleet.clocks[1]}, fleet.now_s) == {}


def test_a_slow_link_and_a_silent_vehicle_are_no_events_and_do_not_slow_the_fleet() -> None:
    fleet = Fleet(3)
    fleet.delay_s[2] = 3.0
    fleet.run(10.0)
    assert disagreeing(fleet.clocks, fleet.now_s, delay_s=6.0) == {}
    fleet.fleet.hold(fleet.clocks, fleet.now_s, 6.0)
    fleet.silent = {1}
    fleet.run(20.0)
    fleet.silent = {1, 2}
    assert fleet.run(20.0)[-1] == pytest.approx(fleet.true_s, abs=0.05)
    fleet.silent = set()
    assert fleet.run(20.0)[-1] == pytest.approx(fleet.true_s, abs=0.05)
    assert fleet.said == []


def test_time_stands_while_no_vehicle_reports() -> None:
    fleet = held(2)
    fleet.silent = {1, 2}
    times = fleet.run(20.0)
    assert times[-1] == times[len(times) // 2] < times[0] + 1.0


def test_a_reboot_in_flight_keeps_the_fleets_time() -> None:
    fleet = held(3)
    fleet.boot_s[2] = -fleet.now_s  # its boot clock begins anew, with the right GNSS time
    fleet.run(10.0)
    assert fleet.said == []
    fleet.boot_s[3], fleet.ahead_s[3] = -fleet.now_s, 500.0  # and with a wrong one
    fleet.run(10.0)
    assert fleet.said == [(3, words(500.0))]
    assert max(map(abs, fleet.off_s().values())) < 0.05


def test_a_boot_clock_that_jumps_is_told_and_gnss_time_is_used() -> None:
    fleet = held(3)
    fleet.boot_s[1] += 600.0
    times = fleet.run(10.0)
    assert fleet.said == [(1, "has a boot clock that jumped by +600.0 s: it flies by GNSS time")]
    assert times[-1] == pytest.approx(fleet.true_s, abs=0.05)
    assert max(map(abs, fleet.off_s().values())) < 0.05


def test_what_is_told_names_the_rule_and_the_difference() -> None:
    fleet = held(3)
    told: list[ClockChange] = []
    plain = fleet.fleet.changes
    fleet.fleet.changes = lambda *now: told.extend(plain(*now)) or []  # type: ignore[method-assign, func-returns-value]
    fleet.ahead_s[1] = 20.0
    fleet.run(30.0)
    fleet.ahead_s[1] = 0.0
    fleet.run(10.0)
    fleet.boot_s[2] += 600.0
    fleet.run(10.0)
    assert [(change.sysid, change.rule) for change in told] == [
        (1, "GNSS time more than 0.5 s off is not followed"),
        (1, "GNSS time within 0.5 s is followed"),
        (2, "its GNSS time agrees with the other vehicles"),
    ]
    assert [change.off_s for change in told] == pytest.approx([20.0, 0.0, 0.0], abs=0.05)


def test_before_the_clocks_are_held_nothing_is_told() -> None:
    fleet = Fleet(3)
    fleet.run(10.0)
    fleet.ahead_s[1] = 20.0
    fleet.boot_s[2] = -fleet.now_s
    fleet.run(10.0)
    assert fleet.said == []


def test_held_clocks_never_run_back_and_others_only_by_more_than_they_may_differ() -> None:
    """0.6 s back within what clocks may differ: time stands until it has caught up. 20 s back: it goes back."""
    fleet = Fleet(1)
    fleet.ahead_s[1] = 0.4
    fleet.run(5.0)
    fleet.ahead_s[1] = 0.0
    times = fleet.run(5.0)
    assert times == sorted(times)
    fleet.ahead_s[1] = -20.0
    assert min(fleet.run(5.0)) < times[-1] - 10.0


def test_a_vehicle_that_never_reported_hides_no_jump_of_the_others() -> None:
    fleet = Fleet(3)
    fleet.silent = {1}
    fleet.run(10.0)
    fleet.hold()
    fleet.ahead_s[2] = 20.0
    fleet.run(10.0)
    assert fleet.said == [(2, words(20.0))]


def test_a_boot_clock_that_jumps_after_a_reboot_is_told_as_any_other() -> None:
    fleet = held(3)
    for sysid in (2, 3):
        fleet.boot_s[sysid] = -fleet.now_s
        fleet.run(10.0)
    fleet.boot_s[2] += 600.0
    fleet.run(10.0)
    assert fleet.said == [(2, "has a boot clock that jumped by +600.0 s: it flies by GNSS time")]
    assert max(map(abs, fleet.off_s().values())) < 0.05


@pytest.mark.parametrize(("delay_s", "set_right"), [(0.0, True), (3.0, False)])
def test_after_a_reboot_a_clock_is_set_right_unless_its_link_explains_the_difference(
    delay_s: float, set_right: bool
) -> None:
    fleet = held(3)
    plain = fleet.fleet.changes
    fleet.fleet.changes = lambda clocks, now_s: plain(clocks, now_s, delay_s)  # type: ignore[method-assign]
    fleet.boot_s[2], fleet.ahead_s[2] = -fleet.now_s, -2.5
    fleet.run(10.0)
    assert (abs(fleet.off_s()[2]) < 0.1) == set_right


def test_a_second_hold_changes_no_clock() -> None:
    """One whose boot clock was set wrong later is told by `changes`; holding again does not hide it."""
    fleet = held(3)
    clock = fleet.clocks[3]
    clock.set_unix_s(fleet.true_s + 50.0, fleet.now_s)
    fleet.hold()
    assert clock.uncapped_unix_s(fleet.now_s) == pytest.approx(fleet.true_s + 50.0, abs=0.05)


def test_of_clocks_without_a_majority_those_count_that_continue_the_common_time() -> None:
    """Two pairs, one of them 300 s ahead: the fleet stays with the pair that goes on as it went."""
    fleet = Fleet(4)
    fleet.run(10.0)
    fleet.ahead_s[3] = fleet.ahead_s[4] = 300.0
    assert fleet.run(10.0)[-1] == pytest.approx(fleet.true_s, abs=0.05)


def test_a_slow_drift_of_the_boot_clock_is_followed() -> None:
    """Simulators of PX4 lose one second in a hundred against the time of their computer."""
    fleet = held(3)
    for _ in range(300):
        fleet.run(1.0)
        for sysid in (1, 2):
            fleet.boot_s[sysid] -= 0.011
    assert fleet.said == []
    assert max(map(abs, fleet.off_s().values())) < 0.2


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name == "mixed-stream" else pytest.mark.slow) for name in FLIGHTS]
)
def test_no_clock_of_a_real_autopilot_is_odd(name: str, tmp_path: Path) -> None:
    """Whole logs, held as soon as the clocks agree. One vehicle of one flight rebooted."""
    flight = Flight(unpacked(name, tmp_path))
    clocks = {sysid: VehicleClock() for sysid in range(1, 7)}
    fleet, said, last_s = FleetClock(), [], -math.inf
    began_s = flight.log.unix_s[0]
    for frame, at_s in zip(flight.log.frames, flight.log.unix_s.tolist(), strict=True):
        if frame.message is None or frame.sysid == GROUND.sysid:
            continue
        clocks[frame.sysid].receive(frame.message, at_s)
        ready = at_s > began_s + 1.0 and all(clock.ready for clock in clocks.values())
        if ready and not clocks[1].held and not disagreeing(clocks, at_s):
            assert at_s < began_s + 10.0
            fleet.hold(clocks, at_s)
        if at_s >= last_s + 0.1:
            last_s = at_s
            said += fleet.changes(clocks, at_s)
    assert said == []
    assert all(clock.held for clock in clocks.values())


Jump = st.tuples(st.integers(1, 4), st.floats(-5000.0, 5000.0), st.floats(0.5, 8.0))


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 4), st.sampled_from(FULL_RATES), st.lists(Jump, max_size=6))
def test_whatever_gnss_times_do_the_fleet_keeps_its_time(
    count: int, rate: float, jumps: list[tuple[int, float, float]]
) -> None:
    fleet = held(count, rate)
    shown: list[float] = []
    for sysid, ahead_s, seconds in jumps:
        if sysid in fleet.clocks:
            fleet.ahead_s[sysid] = ahead_s
        shown += fleet.run(seconds / rate)
        # within what is followed slowly, and half a step of the rate
        assert max(map(abs, fleet.off_s().values())) < JUMP_S + 0.2
        assert shown[-1] == pytest.approx(fleet.true_s, abs=JUMP_S + 0.2)
    assert shown == sorted(shown)


@given(st.lists(st.floats(0.0, 1e5), min_size=1, max_size=9), st.none() | st.floats(0.0, 1e5))
def test_the_common_time_is_that_of_a_vehicle_and_of_most_where_most_agree(
    times: list[float], expected_s: float | None
) -> None:
    common_s = common_time_s(times, expected_s)
    assert common_s in times
    agreeing = [t for t in times if abs(t - times[0]) <= AGREE_S / 2]
    if 2 * len(agreeing) > len(times):
        assert min(agreeing) <= common_s <= times[0] + 2 * AGREE_S


def heard(unix_s: float, now_s: float) -> VehicleClock:
    """A clock that has heard one report of the time, just now."""
    clock = VehicleClock()
    stamps = {"time_boot_ms": 50_000, "time_unix_usec": round(1e6 * unix_s)}
    clock.receive(Message("SYSTEM_TIME", stamps), now_s)
    return clock


@pytest.mark.parametrize(
    ("times_s", "expected_s", "common_s"),
    [
        ([0.0, 10.0, 20.0], None, 20.0),  # nothing is known but the latest
        ([0.0, 10.0, 20.0], 19.0, 20.0),
        ([0.0, 10.0, 20.0], 1.0, 0.0),
        ([0.0, 10.0, 10.5, 30.0], 30.2, 30.0),  # two of four are no majority
        ([0.0, 10.0, 10.5, 30.0], 9.8, 10.5),
        ([0.0, 10.0, 10.2, 10.5, 30.0], 30.2, 10.5),  # three of five are
    ],
)
def test_a_majority_counts_and_then_what_was_expected(
    times_s: list[float], expected_s: float | None, common_s: float
) -> None:
    assert common_time_s(times_s, expected_s) == common_s


@pytest.mark.parametrize("wrong_s", [90.0, 130.0])
def test_of_two_clocks_the_one_counts_that_went_on_as_the_ground_did(wrong_s: float) -> None:
    fleet = FleetClock()
    assert fleet.unix_s({1: heard(EPOCH_S + 100.0, 1000.0)}, 1000.0) == pytest.approx(EPOCH_S + 100.0, abs=1e-3)
    clocks = {1: heard(EPOCH_S + 110.0, 1010.0), 2: heard(EPOCH_S + wrong_s, 1010.0)}
    assert fleet.unix_s(clocks, 1010.0) == pytest.approx(EPOCH_S + 110.0, abs=1e-3)


@pytest.mark.parametrize(("hold", "back_s", "shown_s"), [(False, 0.5, 0.0), (False, 1.5, -1.5), (True, 1.5, 0.0)])
def test_the_common_time_runs_back_only_if_gnss_sets_the_clocks_before_they_are_held(
    hold: bool, back_s: float, shown_s: float
) -> None:
    fleet, clocks = FleetClock(), {1: heard(EPOCH_S, 10.0)}
    assert fleet.unix_s(clocks, 10.0) == pytest.approx(EPOCH_S, abs=1e-3)
    if hold:
        fleet.hold(clocks, 10.0)
    assert fleet.unix_s({1: heard(EPOCH_S - back_s, 10.0)}, 10.0) == pytest.approx(EPOCH_S + shown_s, abs=1e-3)


@pytest.mark.parametrize("hold", [False, True])
def test_no_delay_is_assumed_and_nothing_is_set_before_clocks_are_held(hold: bool) -> None:
    """Vehicle 2 restarts with a clock that is 1.5 s off: a delay would explain half a second of it, were there one."""
    fleet = Fleet(3)
    fleet.run(20.0)
    if hold:
        fleet.hold()
    fleet.run(1.0)
    fleet.boot_s[2], fleet.ahead_s[2] = -20.0, 1.5
    fleet.run(5.0)
    assert fleet.clocks[2].restarts == 1
    assert fleet.off_s() == pytest.approx({1: 0.0, 2: 0.0 if hold else 1.5, 3: 0.0}, abs=0.11)
    assert list(disagreeing(fleet.clocks, fleet.now_s)) == ([] if hold else [2])
    fleet.hold()
    assert fleet.off_s() == pytest.approx(dict.fromkeys(fleet.clocks, 0.0), abs=0.11)
