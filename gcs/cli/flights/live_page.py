"""The page of a flight: its checks and the word that arms, pictures and events under way, and in the end its report.

The flight never waits for it. After the flight it stays as long as a browser shows it, if somebody is at the terminal.
"""

import asyncio
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from gcs.errors import GcsError, UsageError
from gcs.flight.assessment.criterion import FlightOutcome
from gcs.flight.assessment.judge import Verdict
from gcs.flight.contingency.order_words import order_of
from gcs.flight.monitoring.preflight_check import PreflightCheck, checks_data
from gcs.flight.monitoring.progress import AskedOrder, Event, InFlight, PredictedPlaces
from gcs.flight.recording.flight_folder import limit_text
from gcs.flight.recording.load_recording import load_recording
from gcs.flight.scene.flight_picture import picture_of
from gcs.flight.scene.plan_scene import scene_of_plan
from gcs.flight.scene.predicted_band import band_of
from gcs.flight.scene.recording_scene import happening, scene_of_recording
from gcs.flight.scene.scene_json import band_json, event_json, picture_json, scene_json, way_json
from gcs.flight.scene.scene_model import SceneKind
from gcs.flight.setup.own_process import in_own_process
from gcs.page.page_feed import PageFeed
from gcs.page.page_orders import PageAsk
from gcs.plan.formation_orders import PlanOrder
from gcs.plan.trajectory.plan import Plan
from gcs.util.aio import Work, ended

_STEP_S = 0.1  # between pictures at least
_CONFIRM_S = 60.0  # an order that was said before that is said again
_LEFT_S = 10.0  # without a browser, after which a page of a flight that is over ends; one that loads again is back
_LOOK_S = 0.2
_SHARE = 0.05  # of the time at most goes into pictures: of a large fleet there are fewer

_Band = Callable[[PredictedPlaces], object]


class _Said(NamedTuple):
    """An order that was said in numbers: to the vehicles that would obey it, and when."""

    number: int
    order: AskedOrder | PlanOrder
    vehicles: tuple[int, ...]
    at_s: float


class LivePage:
    """Feeds a page from a flight. The end of the page is reported once."""

    def __init__(self, feed: PageFeed, say: Callable[[str], None], band: _Band | None = None) -> None:
        """`band` gives the page what stands for the predicted tracks of missions on board."""
        self._feed = feed
        self._band = band
        self._say = say
        self._said: _Said | None = None  # not given yet
        self._word = ""  # that arms, while it is waited for
        self._typed_at = ""  # where it was typed
        self._plan: Plan | None = None  # that the page shows
        self._beside: set[asyncio.Task[None]] = set()  # that the page waits for

    def checks(self, checks: tuple[PreflightCheck, ...], title: str) -> None:
        """Show the pre-flight table, and whether it is a go."""
        self._feed.put("checks", {"title": title, "rows": checks_data(checks)})

    async def typed(self, word: str, question: str) -> str:
        """Wait until the word was typed on the page; return where. Empty once the page has ended."""
        self._word, self._typed_at = word, ""
        self._feed.put("question", question)
        try:
            while not self._typed_at and not self._feed.has_ended:
                await asyncio.sleep(_STEP_S)
            return self._typed_at
        finally:
            self._word = ""
            self._feed.put("question", None)

    def report(self, outcome: str, text: str, verdict: Verdict | None, folder: Path | None) -> None:
        """Show how the flight ended, by criterion, and offer the files of its folder."""
        files = [] if folder is None else sorted(one for one in folder.iterdir() if one.is_file())
        criteria = () if verdict is None else verdict.criteria
        rows = [
            {
                "name": c.name,
                "definition": c.name.definition,
                "measured": f"{c.value:.3f} {c.unit}",
                "vehicles": c.vehicles,
                "t_s": c.t_s,
                "limit": limit_text(c),
                "verdict": c.verdict,
                "is_bad": c.outcome is not FlightOutcome.OK,
            }
            for c in criteria
        ]
        self._feed.offer(files)
        names = [one.name for one in files]
        self._feed.put("report", {"outcome": outcome, "text": text, "criteria": rows, "files": names})

    def stays(self, *, keep: bool) -> bool:
        """Whether the page of a flight that is over has a reader, and somebody at the terminal; or is kept anyway."""
        at_terminal = sys.stdin is not None and not sys.stdin.closed and sys.stdin.isatty()
        return not self._feed.has_ended and (keep or (at_terminal and self._feed.readers > 0))

    def stay(self, *, keep: bool) -> None:
        """Return at Ctrl-C, when the page has ended, and unless it is kept when its last browser is closed."""
        seen_s = time.monotonic()
        with suppress(KeyboardInterrupt):
            while not self._feed.has_ended and (keep or time.monotonic() - seen_s < _LEFT_S):
                for asked in self._feed.asks():
                    self._feed.answer(asked.number, "not given: the flight is over", may=False)
                if self._feed.readers:
                    seen_s = time.monotonic()
                time.sleep(_LOOK_S)

    def event(self, event: Event) -> None:
        """Add an event to the page's log."""
        self._feed.tell(event_json(happening(event, is_bad=not event.is_remark)))

    def replay(self, folder: Path) -> None:
        """Show the recording of the flight that is over instead, with what was true where that is known."""
        try:
            recording = load_recording(folder).recording
            scene = scene_of_recording(recording, *recording.span_s)
        except GcsError as problem:
            self._say(f"the page keeps what was reported: {problem.message}")
            return
        self._feed.put("band", None)
        self._feed.replace(scene_json(scene), same_flight=False)

    def _answer(self, flight: InFlight, asked: PageAsk) -> tuple[str, bool]:
        """Say an order in numbers, or give the one that was said last, within a minute; with whether it may be."""
        where = f"the page at {asked.client}" if asked.client else "the page"
        if asked.word:
            return self._take_word(asked.word, where)
        try:
            if asked.confirms is None:
                order = AskedOrder(asked.order)
                found = flight.forecast(order, asked.vehicles)
                self._said = _Said(asked.number, order, found.vehicles, time.monotonic())
                return found.words, True
            said, self._said = self._said, None
            if said is None or said.number != asked.confirms or time.monotonic() - said.at_s > _CONFIRM_S:
                return "not given: it was not said, or too long ago. Ask again", False
            if not isinstance(said.order, AskedOrder):
                flight.ask(said.order, by=where)
                self._start(self._outcome(flight))
                return "ordered; it is planned from now on", True
            now = flight.forecast(said.order, said.vehicles)
            if set(now.vehicles) != set(said.vehicles):
                return f"not given: by now {now.words}. Ask again", False
            flight.ask(said.order, said.vehicles, by=where)
        except GcsError as refusal:
            return f"{refusal.message} {refusal.hint}".strip(), False
        except Exception as failure:
            self._say(f"WARNING: an order of the page failed: {type(failure).__name__}: {failure}")
            return f"not given: {type(failure).__name__}", False
        return "ordered", True

    async def _propose(self, flight: InFlight, asked: PageAsk) -> None:
        """Plan an order that changes the plan, and answer with what it would lead to."""
        self._said = None
        text, may, way = "", False, None
        try:
            order = order_of(asked.change.split(), flight.plan.scenario)
            if isinstance(order, AskedOrder):
                raise UsageError(f"{order} changes no plan", hint="it has a button of its own")
            found = await flight.propose(order)
            self._said = _Said(asked.number, order, flight.plan.sysids, time.monotonic())
            text, may, way = f"{order}: {found.words}", True, way_json(found.places_ned_m)
        except GcsError as refusal:
            text = f"{refusal.message} {refusal.hint}".strip()
        except Exception as failure:
            self._say(f"WARNING: an order of the page failed: {type(failure).__name__}: {failure}")
            text = f"not planned: {type(failure).__name__}"
        self._feed.answer(asked.number, text, may=may, way=way)

    async def _outcome(self, flight: InFlight) -> None:
        """Have the page say what came of the order that was given last."""
        try:
            said = await flight.answer()
        except GcsError as refusal:
            said = refusal.message
        self._feed.put("outcome", said)

    async def _show_plan(self, plan: Plan) -> None:
        """Show the new plan that is flown; its scene takes seconds to make."""
        try:
            scene = await in_own_process(_flight_scene, plan)
        except Exception as failure:
            self._say(f"WARNING: the page shows the plan before this one: {type(failure).__name__}: {failure}")
            return
        if plan is self._plan:
            self._feed.replace(scene, same_flight=True)

    def _start(self, work: Work[None]) -> None:
        task = asyncio.ensure_future(work)
        self._beside.add(task)
        task.add_done_callback(self._beside.discard)

    def _take_word(self, word: str, where: str) -> tuple[str, bool]:
        if not self._word:
            return "not armed: nothing is to be confirmed. Every check has to pass first, and a word counts once", False
        if word.strip() != self._word:
            return f"not armed: the word is '{self._word}'", False
        self._word, self._typed_at = "", where
        return "confirmed", True

    async def run(self, flight: InFlight) -> None:
        """Send pictures, and take orders, until cancelled, or until the page ends."""
        if flight.predicted is not None and self._band is not None:
            self._feed.put("band", self._band(flight.predicted))
        self._plan = flight.plan
        try:
            await self._feeds(flight)
        finally:
            await ended(*self._beside)

    async def _feeds(self, flight: InFlight) -> None:
        while not self._feed.has_ended:
            if self._plan is not flight.plan:
                self._plan = flight.plan
                self._start(self._show_plan(flight.plan))
            for asked in self._feed.asks():
                if asked.change:
                    self._start(self._propose(flight, asked))
                    continue
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


def _flight_scene(plan: Plan) -> bytes:
    return scene_json(scene_of_plan(plan, SceneKind.FLIGHT))


@contextmanager
def live_page(
    plan: Plan, say: Callable[[str], None], address: str = "", *, orders_from_afar: bool = False, tiles: str = ""
) -> Iterator[LivePage]:
    """Open the page of a plan's flight, say its address, and end it with the block. Raises as `PageFeed`."""
    scene = scene_of_plan(plan, SceneKind.FLIGHT)
    with PageFeed(scene_json(scene), address, orders_from_afar=orders_from_afar, tiles=tiles) as feed:
        say(f"page: {feed.url}")
        if address:
            say(f"page for other machines, {'orders too' if orders_from_afar else 'read-only'}: {feed.far_url}")
        yield LivePage(feed, say, lambda tracks: band_json(band_of(tracks, plan, scene.t_s)))
