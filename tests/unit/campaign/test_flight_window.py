"""The rolling window: order, room, another attempt after the machine failed, and when enough is known."""

from __future__ import annotations

import random
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from gcs.campaign.flight_window import ATTEMPTS, FlightWindow, flights_counted
from gcs.campaign.records import INFRASTRUCTURE


def design(count: int) -> list[dict[str, Any]]:
    return [{"index": index} for index in range(count)]


def test_no_more_flights_are_out_than_there_is_room_for() -> None:
    window = FlightWindow(design(5))
    assert [row["index"] for row in window.next(2)] == [0, 1]
    assert window.next(2) == []
    assert window.ended({"index": 1, "outcome": "held"}) == 1
    assert [row["index"] for row in window.next(2)] == [2]
    assert window.next(0) == []


def test_a_flight_that_the_machine_fails_flies_again_and_then_waits_for_another_start() -> None:
    window = FlightWindow(design(1))
    for attempt in range(1, ATTEMPTS + 1):
        assert [row["index"] for row in window.next(1)] == [0]
        took = window.ended({"index": 0, "outcome": INFRASTRUCTURE})
        assert took == (attempt if attempt == ATTEMPTS else None)
    assert window.is_over


@given(st.integers(0, 2**32), st.integers(1, 9), st.integers(40, 200))
def test_any_number_of_workers_ends_after_the_same_flight(seed: int, room: int, count: int) -> None:
    outcome = ["held" if random.Random(n).random() < 0.9 else "failed" for n in range(count)]
    window, out, known = FlightWindow(design(count), until=0.25), [], {}
    order = random.Random(seed)
    while not window.is_over:
        out += [row["index"] for row in window.next(room)]
        index = out.pop(order.randrange(len(out)))
        known[index] = outcome[index]
        window.ended({"index": index, "outcome": outcome[index]})
    assert flights_counted(known, 0.25) == flights_counted(dict(enumerate(outcome)), 0.25)


def test_a_resumed_window_counts_what_is_known() -> None:
    known = [{"index": n, "outcome": "held"} for n in range(100)]
    assert FlightWindow(design(200)[100:], known, until=0.05).is_over
    assert not FlightWindow(design(200)[100:], known, until=0.01).is_over
    assert not FlightWindow(design(200)[99:], [*known[:50], *known[51:]], until=0.05).is_over
