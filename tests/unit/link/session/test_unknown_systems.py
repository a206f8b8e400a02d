"""What unknown may cost, and what is told of them."""

from __future__ import annotations

import pytest

from gcs.link.session.routing_table import LinkAddress
from gcs.link.session.unknown_systems import ByteBudget, UnknownSystems

FIRST, SECOND = LinkAddress(0, ("10.0.0.9", 5001)), LinkAddress(1, ("::1", 5002))


def test_a_budget_is_so_much_at_once_and_so_much_per_second() -> None:
    budget = ByteBudget(1_000.0, 5_000.0)
    spent = sum(100 for tick in range(10_000) if budget.take(100, 50.0 + tick / 1e3))
    assert spent == pytest.approx(5_000 + 10 * 1_000, rel=0.02)
    assert budget.take(100_000, 80.0), "one large piece is taken, and is missing later"
    assert not budget.take(1, 81.0)
    assert not budget.take(1, 20.0), "a clock that runs back gives nothing"


def test_systems_are_counted_and_told_once() -> None:
    unknown = UnknownSystems()
    for n in range(60_000):
        unknown.note(4 + n % 248, FIRST if n == 0 else SECOND, n / 9e3)
    assert unknown.notices(0.5) == []
    (text,) = unknown.notices(8.0)
    assert text == "heard 248 systems that are not in the plan, first system 4 at 10.0.0.9:5001: ignored"
    assert unknown.notices(9.0) == []
    assert len(unknown.systems) == 248


def test_one_system_is_named() -> None:
    unknown = UnknownSystems()
    unknown.note(200, SECOND, 0.0)
    assert unknown.notices(5.0) == ["heard system 200, which is not in the plan, at [::1]:5002: ignored"]


def test_a_flood_is_dropped_unread_and_told_once() -> None:
    unknown = UnknownSystems()
    read = sum(unknown.admits(65_000, FIRST, tick / 300) for tick in range(3_000))
    assert 10 < read < 40, "of 195 MB in ten seconds"
    assert unknown.dropped == 3_000 - read
    (text,) = unknown.notices(10.0)
    assert text.startswith(f"{unknown.dropped} datagrams from addresses without a vehicle were dropped unread")
    assert unknown.notices(11.0) == []
