"""When the rows `[[on]]` of a scenario are due: once, after the event has lasted, again after a refusal."""

from __future__ import annotations

import math

from gcs.flight.contingency.event_watch import AGAIN_S, ATTEMPTS, HOLDS_S, EventWatch, Observed
from gcs.scenario.schema.scenario import EventTable

BATTERY = EventTable(battery_below_percent=30.0, order="home", otherwise="return")
WIND = EventTable(wind_above_mps=8.0, order="scale", factor=0.6)
SILENT = EventTable(silent_for_s=3.0, order="return")
LATER = EventTable(at_s=12.0, order="land")
NAMED = EventTable(event="storm", order="land")


def seen(battery_pct: float = 80.0, wind_mps: float = math.nan, silent_s: float = 0.1) -> list[Observed]:
    return [Observed(1, 90.0, 2.0, 0.0), Observed(2, battery_pct, wind_mps, silent_s)]


def test_a_low_battery_is_due_once_when_it_has_lasted() -> None:
    watch = EventWatch([BATTERY])
    assert watch.due(0.0, 0.0, seen(29.0)) == []
    assert watch.due(HOLDS_S / 2, 1.0, seen(31.0)) == []  # that report erred
    assert watch.due(HOLDS_S, 2.0, seen(29.0)) == []
    (due,) = watch.due(2 * HOLDS_S, 4.0, seen(28.0))
    assert (due.row, due.why) == (0, "vehicle 2 has 28 % battery")
    assert watch.due(9 * HOLDS_S, 18.0, seen(5.0)) == []


def test_a_row_is_due_at_its_limit_only_beyond_it_and_never_for_what_is_not_reported() -> None:
    watch = EventWatch([BATTERY, WIND])
    for now_s in (0.0, 2.0, 4.0):
        assert watch.due(now_s, now_s, seen(30.0, 8.0)) == []
        assert watch.due(now_s, now_s, seen(math.nan, math.nan)) == []
    watch.due(10.0, 10.0, seen(wind_mps=8.1))
    assert [due.row for due in watch.due(12.0, 12.0, seen(wind_mps=8.1))] == [1]


def test_silence_and_time_are_due_at_once() -> None:
    watch = EventWatch([SILENT, LATER, NAMED])
    assert watch.due(0.0, -math.inf, seen(silent_s=2.9)) == []
    assert [due.row for due in watch.due(1.0, 11.9, seen(silent_s=3.1))] == [0]
    assert [due.row for due in watch.due(2.0, 12.0, seen(silent_s=4.1))] == [1]


def test_a_refused_order_is_due_again_while_its_event_lasts_three_times_in_all() -> None:
    watch, now_s = EventWatch([SILENT]), 0.0
    for attempt in range(1, ATTEMPTS + 1):
        assert len(watch.due(now_s, 0.0, seen(silent_s=9.0))) == 1
        assert watch.refused(0, now_s) == (attempt < ATTEMPTS)
        assert watch.due(now_s + AGAIN_S - 0.1, 0.0, seen(silent_s=9.0)) == []
        now_s += AGAIN_S
    assert watch.due(now_s, 0.0, seen(silent_s=9.0)) == []


def test_a_time_that_had_passed_when_a_flight_is_taken_up_again_is_not_due() -> None:
    watch = EventWatch([LATER])
    assert watch.due(0.0, 40.0, seen()) == []
    assert len(EventWatch([LATER]).due(0.0, 12.25, seen())) == 1  # the first look at a row of T0 comes a little later
