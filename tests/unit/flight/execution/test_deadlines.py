"""Deadlines of setpoints: absolute, no bursts, silence where time stands still."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.flight.execution.setpoint_schedule import Grid, Scheduler

RATE_HZ, T0 = 50.0, 1_700_000_000.0
GRID = Grid.of(np.rint(np.arange(-100, 501) * 20.0) / 1e3, RATE_HZ)
LAST = len(GRID.t_s) - 1


def scheduler(**options: float) -> Scheduler:
    made = Scheduler(GRID, T0, **options)
    made.start(1, 0, len(GRID.t_s))
    return made


def test_the_grid_goes_on_before_and_after() -> None:
    assert GRID.at(0) == -2.0
    assert GRID.at(-3) == pytest.approx(-2.06)
    assert GRID.at(LAST) == 10.0
    assert GRID.at(LAST + 2) == pytest.approx(10.04)


@given(st.floats(-20.0, 40.0))
def test_the_number_ahead_of_an_instant(t_s: float) -> None:
    k = GRID.ahead_of(t_s)
    assert GRID.at(k - 1) <= t_s < GRID.at(k)


def test_every_deadline_is_absolute() -> None:
    """However late each look, the next deadline does not move."""
    ours = scheduler()
    for k in range(len(GRID.t_s)):
        due_s = T0 + GRID.at(k)
        assert ours.next_unix_s(1) == due_s
        assert ours.due(1, due_s - 1e-4) == []
        assert ours.due(1, due_s + 0.013) == [k]
    assert ours.finished
    assert ours.next_unix_s(1) == math.inf
    assert list(ours.streams[1].late_s) == pytest.approx([0.013] * len(GRID.t_s), abs=1e-6)


@given(st.integers(0, LAST), st.floats(0.0, 0.5), st.floats(0.0, 1e9))
def test_what_is_said_to_be_due_is_due(k: int, lead_s: float, t0_unix_s: float) -> None:
    """To the last bit; otherwise a wait until the deadline ends with nothing due, again and again."""
    ours = Scheduler(GRID, t0_unix_s, lead_s=lead_s)
    ours.start(1, k, None)
    assert ours.due(1, ours.next_unix_s(1)) == [k]


def test_who_lags_is_told_earlier() -> None:
    ours = Scheduler(GRID, T0, lead_s=0.05, lags_s={2: 0.1})
    ours.start(1, 100, None)
    ours.start(2, 100, None)
    assert ours.next_unix_s(1) == pytest.approx(T0 - 0.05)
    assert ours.next_unix_s(2) == pytest.approx(T0 - 0.15)
    assert ours.due(1, T0 - 0.14) == []
    assert ours.due(2, T0 - 0.14) == [100]


def test_after_a_stall_the_newest_point_alone_is_sent() -> None:
    ours = scheduler()
    assert ours.due(1, T0 + 1.0) == [150]
    assert ours.due(1, T0 + 3.505) == [275]
    assert ours.due(1, T0 + 3.505) == []
    assert ours.streams[1].skipped == 150 + 124


def test_where_time_stands_still_nothing_is_sent() -> None:
    ours = scheduler()
    ours.due(1, T0)
    assert [ours.due(1, T0) for _ in range(100)] == [[]] * 100


def test_the_last_point_is_sent_however_late() -> None:
    ours = scheduler()
    ours.due(1, T0)
    assert ours.due(1, T0 + 1e5) == [LAST]
    assert ours.finished


def test_who_goes_by_the_stamp_gets_what_lies_ahead_and_what_is_hardly_past() -> None:
    ours = scheduler(lead_s=0.2, keep_s=0.5)
    ours.due(1, T0)
    assert ours.due(1, T0 + 0.2) == list(range(111, 121))
    numbers = ours.due(1, T0 + 2.0)
    assert [numbers[0], numbers[-1]] == [175, 210]
    assert GRID.at(numbers[0]) == 1.5


def test_a_stream_without_end_goes_on() -> None:
    ours = Scheduler(GRID, T0)
    ours.start(1, GRID.ahead_of(-5.0), None)
    assert ours.due(1, T0 - 4.5) == [GRID.ahead_of(-4.5) - 1]
    assert ours.due(1, T0 + 20.0) == [GRID.ahead_of(20.0) - 1]
    assert not ours.finished
    ours.stop(1)
    assert ours.finished
    assert ours.due(1, T0 + 30.0) == []


@given(st.lists(st.floats(0.0, 0.7), min_size=1, max_size=60), st.sampled_from([0.0, 0.2]))
def test_numbers_rise_and_none_is_sent_before_its_time(pauses_s: list[float], lead_s: float) -> None:
    ours = scheduler(lead_s=lead_s, keep_s=2.5 * lead_s)
    sent: list[int] = []
    for now_s in itertools.accumulate(pauses_s, initial=-2.0):
        numbers = ours.due(1, T0 + now_s)
        assert all(GRID.at(k) <= now_s + lead_s + 1e-6 for k in numbers)
        if lead_s == 0.0:
            assert len(numbers) <= 1
            assert all(now_s - GRID.at(k) <= 0.02 + 1e-6 or k == LAST for k in numbers)
        sent += numbers
    assert sent == sorted(set(sent))
    assert ours.streams[1].sent == len(sent)
    assert ours.streams[1].sent + ours.streams[1].skipped == ours.streams[1].next
