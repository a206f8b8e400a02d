"""The page of a flight under way: pictures several times a second, and every event. The flight never waits for it."""

import asyncio
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from gcs.errors import GcsError
from gcs.flight.monitoring.progress import AskedOrder, Event, InFlight
from gcs.flight.scene.flight_picture import picture_of
from gcs.flight.scene.plan_scene import scene_of_plan
from gcs.flight.scene.recording_scene import happening
from gcs.flight.scene.scene_json import event_json, picture_json, scene_json
from gcs.flight.scene.scene_model import SceneKind
from gcs.page.page_feed import PageFeed
from gcs.page.page_orders import PageAsk
from gcs.plan.trajectory.plan import Plan

_STEP_S = 0.1  # between pictures at least
_CONFIRM_S = 60.0  # an order that was said before that is said again
_WHO = "the page"
_SHARE = 0.05  # of the time at most goes into pictures: of a large fleet there are fewer


class _Said(NamedTuple):
    """An order that was said in numbers: to the vehicles that would obey it, and when."""

    number: int
    order: AskedOrder
    vehicles: tuple[int, ...]
    at_s: float


class LivePage:
    """Feeds a page from a flight. A page that ends is told once."""

    def __init__(self, feed: PageFeed, say: Callable[[str], None]) -> None:
        self._feed = feed
        self._say = say
        self._said: _Said | None = None  # not given yet

    def event(self, event: Event) -> None:
        """Add an event to the page's log."""
        self._feed.tell(event_json(happening(event, is_bad=True)))

    def _answer(self, flight: InFlight, asked: PageAsk) -> tuple[str, bool]:
        """Say an order in numbers, or give the one that was said last, within a minute; with whether it may be."""
        try:
            if asked.confirms is None:
                order = AskedOrder(asked.order)
                found = flight.forecast(order, asked.vehicles)
                self._said = _Said(asked.number, order, found.vehicles, time.monotonic())
                return found.words, True
            said, self._said = self._said, None
            if said is None or said.number != asked.confirms or time.monotonic() - said.at_s > _CONFIRM_S:
                return "not given: it was not said, or too long ago. Ask again", False
            now = flight.forecast(said.order, said.vehicles)
            if set(now.vehicles) != set(said.vehicles):
                return f"not given: by now {now.words}. Ask again", False
            flight.ask(said.order, said.vehicles, by=_WHO)
        except GcsError as refusal:
            return f"{refusal.message} {refusal.hint}".strip(), False
        except Exception as failure:
            self._say(f"WARNING: an order of the page failed: {type(failure).__name__}: {failure}")
            return f"not given: {type(failure).__name__}", False
        return "ordered", True

    async def run(self, flight: InFlight) -> None:
        """Send pictures, and take orders, until cancelled, or until the page ends."""
        while not self._feed.has_ended:
            for asked in self._feed.asks():
                text, may = self._answer(flight, asked)
                self._feed.answer(asked.number, text, may=may)
            began_s = time.perf_counter()
            try:
                self._feed.show(picture_json(picture_of(flight)))
            except Exception as failure:
                self._say(f"WARNING: the flight goes on without its page: {type(failure).__name__}: {failure}")
                return
            spent_s = time.perf_counter() - began_s
            await asyncio.sleep(max(_STEP_S, spent_s / _SHARE))
        self._say("WARNING: the page has ended; the flight goes on without it")


@contextmanager
def live_page(
    plan: Plan, say: Callable[[str], None], address: str = "", *, orders_from_afar: bool = False
) -> Iterator[LivePage]:
    """Open the page of a plan's flight, say its address, and end it with the block. Raises as `PageFeed`."""
    scene = scene_json(scene_of_plan(plan, SceneKind.FLIGHT))
    with PageFeed(scene, address, orders_from_afar=orders_from_afar) as feed:
        say(f"page: {feed.url}")
        if address:
            say(f"page for other machines, {'orders too' if orders_from_afar else 'read-only'}: {feed.far_url}")
        yield LivePage(feed, say)
