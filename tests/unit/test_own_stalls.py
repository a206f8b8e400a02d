"""The program's own stalls, and the clock that stands still in them."""

from __future__ import annotations

import pytest

from gcs.own_stalls import NOTE_EVERY_S, STALL_S, OwnStalls


def test_notes_in_time_are_no_stall() -> None:
    stalls = OwnStalls(100.0)
    for k in range(1, 50):
        assert stalls.note(100.0 + k * NOTE_EVERY_S) == 0.0
    assert stalls.running_s(105.0) == pytest.approx(105.0)


def test_a_stall_is_told_once_and_its_time_does_not_count() -> None:
    stalls = OwnStalls(0.0)
    assert stalls.running_s(6.0) == pytest.approx(STALL_S), "asked before anybody could note that it ended"
    assert stalls.note(6.0) == pytest.approx(6.0)
    assert stalls.note(6.1) == 0.0
    assert stalls.running_s(6.1) == pytest.approx(0.1 + STALL_S)
    assert stalls.note(8.1) == pytest.approx(2.0)


def test_the_running_clock_never_runs_back() -> None:
    stalls, last_s = OwnStalls(0.0), 0.0
    for now_s in (0.1, 0.2, 0.2 + STALL_S, 0.3 + STALL_S, 5.0, 5.05, 9.0, 9.1):
        stalls.note(now_s)
        assert stalls.running_s(now_s) >= last_s
        last_s = stalls.running_s(now_s)
