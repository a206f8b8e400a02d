"""Orders are repeated with growing pauses; what failed stays known."""

from __future__ import annotations

from itertools import pairwise

from gcs.flight.contingency.order_book import FIRST_PAUSE_S, LONGEST_PAUSE_S, OrderBook


def test_pauses_grow_to_a_limit_and_attempts_do_not_end() -> None:
    book = OrderBook()
    order = book.give(3, "land", 10.0)
    assert order.wait_s(10.0) == 0.0
    now_s, pauses = 10.0, []
    for _ in range(50):
        book.note_failure(order, now_s, "refused")
        pauses.append(order.wait_s(now_s))
        now_s = order.due_s
        assert order.wait_s(now_s) == 0.0
    assert pauses[0] == FIRST_PAUSE_S
    assert pauses[-1] == LONGEST_PAUSE_S
    assert all(later >= earlier for earlier, later in pairwise(pauses))
    assert book.stands(order)


def test_a_new_order_replaces_the_one_before() -> None:
    book = OrderBook()
    first = book.give(3, "return", 10.0)
    second = book.give(3, "land", 11.0)
    assert (book.stands(first), book.stands(second)) == (False, True)
    book.end(3)
    assert not book.stands(second)


def test_what_failed_is_named_with_its_reason_to_the_end_of_the_flight() -> None:
    book = OrderBook()
    order = book.give(3, "land", 10.0)
    assert book.failed == ()
    book.note_failure(order, 10.0, "the vehicle refused")
    book.note_failure(order, 12.0, "no answer")
    (failed,) = book.failed
    assert str(failed) == "vehicle 3 did not land when ordered 2 times (no answer)"
    book.carried_out(order)
    (failed,) = book.failed
    assert failed.carried_out
    assert "a repetition was carried out" in str(failed)


def test_an_order_that_is_carried_out_at_once_leaves_nothing() -> None:
    book = OrderBook()
    book.carried_out(book.give(3, "land", 10.0))
    assert book.failed == ()
