"""The page of a flight under way: its pictures are what the vehicles report, and the flight goes on without it."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gcs.cli.flights import live_page
from gcs.cli.flights.fly_view import FlightView
from gcs.cli.flights.live_page import LivePage
from gcs.cli.shared.console import Screen
from gcs.cli.shared.plan_argument import Stopwatch
from gcs.errors import FlightError, PlanningError, UsageError
from gcs.flight.assessment.criterion import Criterion, CriterionName
from gcs.flight.assessment.judge import Verdict
from gcs.flight.monitoring.predicted_tracks import PredictedTracks
from gcs.flight.monitoring.progress import (
    AskedOrder,
    Event,
    FlightPart,
    NearestPair,
    OrderForecast,
    PlanForecast,
    Snapshot,
    VehicleNow,
)
from gcs.flight.scene.flight_picture import picture_of
from gcs.page.page_orders import PageAsk
from gcs.plan.formation_orders import Avoid, Scale
from tests.virtual_clock import VirtualLoop

USUAL = VehicleNow(1, "GUIDED", True, 20.0, 5.0, 80.0, 0.1, 0.0, 0.3, 12.0, 20.0)
AT = ((0.0, 0.0, -20.0), (3.0, 4.0, -20.0), (30.0, 0.0, -20.0))
FLEET = tuple(
    replace(USUAL, sysid=sysid, place_ned_m=place, velocity_ned_mps=(0.0, 5.0, 0.0))
    for sysid, place in zip((1, 2, 7), AT, strict=True)
)
NEAREST = NearestPair(FlightPart.FLIGHT, (1, 2), 5.0, 1.7e9)
NOW = Snapshot("flying", 0.4, 61.0, {}, {}, {}, 5.0, 0.02, "mission", 120.0, 1.7e9, NEAREST, 3.0)


class Flight:
    """A flight that stands still."""

    def __init__(self, now: Snapshot = NOW, fleet: tuple[VehicleNow, ...] = FLEET) -> None:
        self.now, self.fleet = now, fleet

    def snapshot(self) -> Snapshot:
        return self.now

    predicted: PredictedTracks | None = None
    plan: Any = SimpleNamespace(scenario=None, sysids=(1, 2, 7))

    def vehicles_now(self) -> tuple[VehicleNow, ...]:
        return self.fleet

    def ground_margins_m(self, sysids: Collection[int]) -> dict[int, float]:
        raise AssertionError("takes long: a picture does not ask for it")

    def forecast(self, order: AskedOrder, vehicles: Collection[int] = ()) -> OrderForecast:
        raise AssertionError("nobody asks")

    def ask(self, order: AskedOrder, vehicles: Collection[int] = (), *, by: str = "") -> tuple[int, ...]:
        raise AssertionError("nobody asks")


class Feed:
    """A page without a process."""

    def __init__(self) -> None:
        self.has_ended = False
        self.pictures: list[bytes] = []
        self.events: list[bytes] = []
        self.asked: list[PageAsk] = []
        self.later: list[tuple[int, PageAsk]] = []  # each after so many pictures
        self.ways: list[list[int]] = []  # shapes of proposed tracks
        self.scenes: list[tuple[bytes, bool]] = []
        self.answers: list[tuple[int, str, bool]] = []
        self.board: dict[str, Any] = {}
        self.readers = 0

    def put(self, name: str, value: Any) -> None:
        self.board[name] = value

    def offer(self, files: Collection[Path]) -> None:
        self.board["offered"] = [one.name for one in files]

    def asks(self) -> list[PageAsk]:
        asked, self.asked = self.asked, []
        while self.later and len(self.pictures) >= self.later[0][0]:
            asked.append(self.later.pop(0)[1])
        return asked

    def answer(self, number: int, text: str, *, may: bool, way: Any = None) -> None:
        self.answers.append((number, text, may))
        if way is not None:
            self.ways.append(way["shape"])

    def replace(self, scene: bytes, *, same_flight: bool) -> None:
        self.scenes.append((scene, same_flight))

    def show(self, picture: bytes) -> None:
        self.pictures.append(picture)

    def tell(self, event: bytes) -> None:
        self.events.append(event)


def test_a_picture_has_every_vehicle_as_it_reports_itself() -> None:
    picture = picture_of(Flight())
    assert (picture.t_s, picture.step, picture.nearest, picture.separation_m) == (61.0, "flying: mission", (1, 2), 5.0)
    first, second, last = picture.vehicles
    assert [one.sysid for one in picture.vehicles] == [1, 2, 7]
    assert first.place_ned_m == AT[0] and first.heading_rad == pytest.approx(math.pi / 2)
    assert (first.neighbour, first.neighbour_m) == (2, 5.0) and second.neighbour == 1
    assert last.neighbour == 2 and last.neighbour_m == pytest.approx(math.hypot(27.0, 4.0))
    assert (first.mode, first.armed, first.battery_pct, first.error_m) == ("GUIDED", True, 80.0, 0.3)


@pytest.mark.parametrize(
    ("step", "plan_phase", "shown"),
    [("landing", "mission", "landing"), ("landed", "hover", "landed"), ("take-off", "hover", "take-off: hover")],
)
def test_a_picture_names_the_phase_of_the_plan_only_while_the_plan_is_flown(
    step: str, plan_phase: str, shown: str
) -> None:
    assert picture_of(Flight(replace(NOW, phase=step, plan_phase=plan_phase))).step == shown


def test_before_the_first_report_a_picture_says_that_nothing_is_known() -> None:
    unheard = VehicleNow(3, "", False, *[math.nan] * 3, math.inf, math.nan, math.nan, math.inf, math.nan)
    before = replace(NOW, plan_time_s=None, nearest=None, separation_m=math.nan, plan_phase="")
    feed = Feed()
    followed(feed, Flight(before, (unheard,)), 0.05)
    picture = json.loads(feed.pictures[0])
    assert (picture["t_s"], picture["separation_m"], picture["nearest"]) == (None, None, [0, 0])
    assert picture["vehicles"][0]["place_ned_m"] == [None] * 3 and picture["vehicles"][0]["link_age_s"] is None


def followed(feed: Feed, flight: Flight, seconds: float, ends_s: float = math.inf) -> list[str]:
    """What is said while a page follows a flight, which ends by itself after `ends_s`."""
    said: list[str] = []

    async def follow() -> None:
        running = asyncio.ensure_future(LivePage(feed, said.append).run(flight))  # type: ignore[arg-type]
        asyncio.get_running_loop().call_later(min(ends_s, 1e6), setattr, feed, "has_ended", True)
        await asyncio.sleep(seconds)
        running.cancel()
        await asyncio.wait({running})

    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        runner.run(follow())
    return said


def test_pictures_come_ten_times_a_second_or_less_often() -> None:
    feed = Feed()
    assert followed(feed, Flight(), 5.0) == []
    assert 10 <= len(feed.pictures) <= 51


def test_a_page_that_ends_is_told_once_and_the_flight_goes_on() -> None:
    feed = Feed()
    assert followed(feed, Flight(), 5.0, ends_s=1.0) == ["WARNING: the page has ended; the flight goes on without it"]
    assert len(feed.pictures) <= 11


def test_a_picture_that_fails_is_told_once_and_the_flight_goes_on() -> None:
    flight = Flight()
    flight.vehicles_now = lambda: 1 / 0  # type: ignore[assignment, method-assign, return-value]
    said = followed(Feed(), flight, 5.0)
    assert said == ["WARNING: the flight goes on without its page: ZeroDivisionError: division by zero"]


def test_every_event_reaches_the_log_in_words() -> None:
    feed = Feed()
    LivePage(feed, print).event(Event(1.7e9, 12.5, 3, "is silent", "lost: land"))  # type: ignore[arg-type]
    assert json.loads(feed.events[0]) == {"t_s": 12.5, "sysid": 3, "text": "is silent. lost: land", "is_bad": True}
    LivePage(feed, print).event(Event(1.7e9, -10.0, 0, "start their missions"))  # type: ignore[arg-type]
    assert json.loads(feed.events[1])["is_bad"] is False


class ReplanningFlight(Flight):
    """A flight whose plan changes, and that notes what it is asked."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[tuple[object, str]] = []

    async def propose(self, order: object) -> PlanForecast:
        if order == Scale(9.0):
            raise PlanningError("the new plan failed verification", hint="the old plan is flown on")
        await asyncio.sleep(1.0)
        return PlanForecast("verified; 5 s later", np.arange(2.0), np.zeros((3, 2, 3)))

    def ask(self, order: object, vehicles: Collection[int] = (), *, by: str = "") -> tuple[int, ...]:
        self.asked.append((order, by))
        return (1, 2, 7)

    async def answer(self) -> str:
        await asyncio.sleep(1.0)
        return "a new plan is flown"


def test_a_change_of_the_plan_is_proposed_with_its_cost_and_way_and_ordered_once_it_is_accepted() -> None:
    feed, flight = Feed(), ReplanningFlight()
    feed.asked = [PageAsk(1, change="avoid 10,20,3")]
    assert followed(feed, flight, 0.5) == [] and feed.answers == [], "it is being planned, and pictures go on"
    assert len(feed.pictures) > 2 and flight.asked == []
    feed.asked = [PageAsk(1, change="avoid 10,20,3")]
    feed.later = [(40, PageAsk(2, confirms=1)), (45, PageAsk(3, confirms=1))]
    feed.pictures.clear()
    followed(feed, flight, 20.0)
    assert feed.answers[0] == (1, "avoid 3 m around (10, 20): verified; 5 s later", True)
    assert [order for order, _ in flight.asked] == [Avoid(10.0, 20.0, 3.0)], "once"
    assert feed.ways == [[3, 2, 3]] and feed.board["outcome"] == "a new plan is flown"


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ("scale 9", "the new plan failed verification the old plan is flown on"),
        ("avoid", "avoid of what? give NORTH,EAST,RADIUS in m, or three corners NORTH,EAST or more"),
        ("land", "land changes no plan it has a button of its own"),
    ],
)
def test_a_change_that_cannot_be_planned_is_refused_with_the_reason(change: str, reason: str) -> None:
    feed, flight = Feed(), ReplanningFlight()
    feed.asked = [PageAsk(1, change=change)]
    feed.later = [(10, PageAsk(2, confirms=1))]
    assert followed(feed, flight, 5.0) == []
    assert feed.answers[0] == (1, reason, False) and flight.asked == []
    assert feed.answers[1][2] is False


def test_the_scene_of_a_new_plan_replaces_the_one_before(monkeypatch: pytest.MonkeyPatch) -> None:
    feed, flight = Feed(), ReplanningFlight()

    async def made(work: object, plan: object) -> bytes:
        return b"{}" if plan is flight.plan else b"old"

    monkeypatch.setattr(live_page, "in_own_process", made)
    changes = iter([SimpleNamespace(), SimpleNamespace()])
    flight.vehicles_now = lambda: (setattr(flight, "plan", next(changes, flight.plan)), FLEET)[1]  # type: ignore
    followed(feed, flight, 3.0)
    assert feed.scenes[-1] == (b"{}", True) and len(feed.scenes) <= 2


class ControlledFlight(Flight):
    """A flight that notes what it is asked."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[tuple[str, tuple[int, ...], str]] = []
        self.lost: set[int] = set()

    def forecast(self, order: AskedOrder, vehicles: Collection[int] = ()) -> OrderForecast:
        if 9 in vehicles:
            raise FlightError("no vehicle 9 in this flight.", hint="it has vehicles 1, 2")
        obey = tuple(sysid for sysid in vehicles or (1, 2) if sysid not in self.lost)
        return OrderForecast(obey, f"{len(obey)} {order.value}")

    def ask(self, order: AskedOrder, vehicles: Collection[int] = (), *, by: str = "") -> tuple[int, ...]:
        self.asked.append((order, tuple(vehicles), by))
        return tuple(vehicles)


@pytest.mark.parametrize(
    ("asks", "given", "last"),
    [
        ([PageAsk(1, "return", (1, 2))], [], ("2 return", True)),
        ([PageAsk(1, "return", (1, 2)), PageAsk(2, confirms=1)], [("return", (1, 2), "the page")], ("ordered", True)),
        (
            [PageAsk(1, "return", (1, 2)), PageAsk(2, confirms=1), PageAsk(3, confirms=1)],
            [("return", (1, 2), "the page")],
            None,
        ),
        ([PageAsk(1, confirms=0)], [], None),
        ([PageAsk(1, "return", (1,)), PageAsk(2, "land", (2,)), PageAsk(3, confirms=1)], [], None),
        ([PageAsk(1, "land", (9,)), PageAsk(2, confirms=1)], [], None),
        ([PageAsk(1, "land", (9,))], [], ("no vehicle 9 in this flight. it has vehicles 1, 2", False)),
    ],
)
def test_an_order_of_the_page_is_given_once_it_was_said_and_confirmed(
    asks: list[PageAsk], given: list[tuple[str, tuple[int, ...], str]], last: tuple[str, bool] | None
) -> None:
    feed, flight = Feed(), ControlledFlight()
    feed.asked = list(asks)
    assert followed(feed, flight, 0.5) == []
    assert flight.asked == given
    assert [number for number, *_ in feed.answers] == [one.number for one in asks]
    assert feed.answers[-1][1:] == (last or ("not given: it was not said, or too long ago. Ask again", False))


def test_an_order_goes_to_the_vehicles_that_were_said_or_to_none() -> None:
    """One is lost between the two messages: the operator is told what would be done now, and decides again."""
    feed, flight = Feed(), ControlledFlight()
    page = LivePage(feed, print)  # type: ignore[arg-type]
    assert page._answer(flight, PageAsk(1, "return")) == ("2 return", True)  # type: ignore[arg-type]
    flight.lost.add(2)
    assert page._answer(flight, PageAsk(2, confirms=1)) == ("not given: by now 1 return. Ask again", False)  # type: ignore[arg-type]
    assert flight.asked == []
    assert page._answer(flight, PageAsk(3, "return")) == ("1 return", True)  # type: ignore[arg-type]
    assert page._answer(flight, PageAsk(4, confirms=3)) == ("ordered", True)  # type: ignore[arg-type]
    assert flight.asked == [("return", (1,), "the page")]


def test_who_gave_an_order_is_named_by_the_address_of_the_browser() -> None:
    feed, flight = Feed(), ControlledFlight()
    feed.asked = [PageAsk(1, "land", (1,), client="192.0.2.9"), PageAsk(2, confirms=1, client="192.0.2.9")]
    followed(feed, flight, 0.5)
    assert flight.asked == [("land", (1,), "the page at 192.0.2.9")]


def test_the_word_counts_once_it_is_asked_for_and_not_before() -> None:
    feed, typed = Feed(), []
    page = LivePage(feed, print)  # type: ignore[arg-type]

    def answer(word: str) -> tuple[str, bool]:
        return page._answer(Flight(), PageAsk(1, word=word, client="192.0.2.9"))

    async def ask() -> None:
        assert answer("arm")[1] is False, "before every check has passed nothing is asked"
        asking = asyncio.ensure_future(page.typed("arm", "Type 'arm'"))
        await asyncio.sleep(0.3)
        assert feed.board == {"question": "Type 'arm'"} and not asking.done()
        assert answer("Arm") == ("not armed: the word is 'arm'", False)
        assert answer("arm") == ("confirmed", True)
        assert answer("arm")[1] is False, "it counts once"
        typed.append(await asking)
        feed.has_ended = True
        typed.append(await page.typed("arm", ""))

    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        runner.run(ask())
    assert typed == ["the page at 192.0.2.9", ""] and feed.board == {"question": None}


@pytest.mark.parametrize(
    ("here", "there", "by"),
    [
        ("arm", None, "the terminal"),
        (None, "the page at ::1", "the page at ::1"),
        ("arm", "", "the terminal"),
        ("no", None, None),
        (None, "", None),
    ],
    ids=["terminal", "page", "page ended", "another word", "neither"],
)
def test_the_word_is_typed_in_the_terminal_or_on_the_page_and_the_first_counts(
    monkeypatch: pytest.MonkeyPatch, here: str | None, there: str | None, by: str | None
) -> None:
    """`there` is None where nobody types on the page, and empty where the page ends."""
    page = LivePage(Feed(), print)  # type: ignore[arg-type]

    async def typed(word: str, question: str) -> str:
        return there if there is not None else await asyncio.Future()

    async def line() -> str | None:
        return here

    monkeypatch.setattr(page, "typed", typed)
    monkeypatch.setattr("gcs.cli.flights.fly_view.typed_line", line)
    view = FlightView(Screen(), Stopwatch(0.0), "Type 'arm'", page)
    if by is None:
        with pytest.raises(UsageError, match="not armed"):
            asyncio.run(view.confirm())
    else:
        assert asyncio.run(view.confirm()) == by


def test_a_report_has_every_criterion_and_offers_the_files_of_the_flight(tmp_path: Path) -> None:
    low = Criterion(CriterionName.SEPARATION, "m", 0.8, 1.3, at_least=True, sysid=1, t_s=12.0, other=2)
    verdict = Verdict((low,), {1: 0.1}, {1: 0.2}, 0.1)
    (tmp_path / "map.png").write_bytes(b"png")
    (tmp_path / "export").mkdir()
    feed = Feed()
    LivePage(feed, print).report("flight FAILED", "too near", verdict, tmp_path)  # type: ignore[arg-type]
    report = feed.board["report"]
    assert (report["outcome"], report["files"], feed.board["offered"]) == ("flight FAILED", ["map.png"], ["map.png"])
    (row,) = report["criteria"]
    assert (row["measured"], row["vehicles"], row["verdict"], row["is_bad"]) == (
        "0.800 m",
        "vehicles 1, 2",
        "FAILED",
        True,
    )


@pytest.mark.parametrize(
    ("at_terminal", "readers", "keep", "stays"),
    [(True, 1, False, True), (True, 0, False, False), (False, 1, False, False), (False, 0, True, True)],
)
def test_after_the_flight_the_page_stays_for_a_reader_and_somebody_at_the_terminal_or_when_kept(
    monkeypatch: pytest.MonkeyPatch, at_terminal: bool, readers: int, keep: bool, stays: bool
) -> None:
    feed = Feed()
    feed.readers = readers
    monkeypatch.setattr("sys.stdin", SimpleNamespace(closed=False, isatty=lambda: at_terminal))
    page = LivePage(feed, print)  # type: ignore[arg-type]
    assert page.stays(keep=keep) is stays
    feed.has_ended = True
    assert not page.stays(keep=keep)


def test_a_page_that_stays_ends_after_its_last_browser_and_takes_no_order(monkeypatch: pytest.MonkeyPatch) -> None:
    feed, slept = Feed(), []
    feed.asked = [PageAsk(7, "land")]
    feed.readers = 1

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        if len(slept) == 3:
            feed.readers = 0

    now_s = iter(range(1000))
    monkeypatch.setattr("gcs.cli.flights.live_page.time", SimpleNamespace(sleep=sleep, monotonic=lambda: next(now_s)))
    LivePage(feed, print).stay(keep=False)  # type: ignore[arg-type]
    assert feed.answers == [(7, "not given: the flight is over", False)] and 3 < len(slept) < 20

    def stop(seconds: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("gcs.cli.flights.live_page.time", SimpleNamespace(sleep=stop, monotonic=lambda: next(now_s)))
    LivePage(feed, print).stay(keep=True)  # type: ignore[arg-type]


def test_an_order_that_was_said_too_long_ago_is_not_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs.cli.flights.live_page._CONFIRM_S", -1.0)
    feed, flight = Feed(), ControlledFlight()
    feed.asked = [PageAsk(1, "land"), PageAsk(2, confirms=1)]
    followed(feed, flight, 0.5)
    assert flight.asked == [] and feed.answers[-1][2] is False


def test_an_order_that_fails_ends_neither_page_nor_flight() -> None:
    feed, flight = Feed(), ControlledFlight()
    flight.forecast = lambda *_: 1 / 0  # type: ignore[assignment, method-assign, return-value]
    feed.asked = [PageAsk(1, "land")]
    said = followed(feed, flight, 0.5)
    assert said == ["WARNING: an order of the page failed: ZeroDivisionError: division by zero"]
    assert feed.answers == [(1, "not given: ZeroDivisionError", False)] and len(feed.pictures) > 1
