"""The page in a real Chromium: what stands in it was planned and flown, and it asks nobody else for anything."""

from __future__ import annotations

import io
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot as plt

from gcs.flight.recording.recording import Recording, VehicleTrack
from gcs.flight.scene.plan_scene import rally_of, scene_of_plan
from gcs.flight.scene.recording_scene import scene_of_recording
from gcs.flight.scene.scene_json import event_json, picture_json, scene_json
from gcs.flight.scene.scene_model import FlightPicture, Happening, Scene, SceneKind, VehiclePicture
from gcs.page.page_feed import PageFeed
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from tests.browser import CHROMIUM, WHY_NOT, Browser
from tests.real_flights import plan_of
from tests.unit.flight.scene.test_scene import NAME, recording_of

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason=WHY_NOT)]
DRAWN = "skein.world.markers.size"


@pytest.fixture(scope="module")
def plan() -> Plan:
    return plan_of(NAME)


@pytest.fixture
def browser() -> Iterator[Browser]:
    """One of its own for each test: after a page that drew in software, Chromium may open no other for a minute."""
    with Browser() as opened:
        yield opened


@pytest.fixture
def shown(browser: Browser) -> Iterator[Browser]:
    """The browser, which must have asked nobody else, and reported no error, when the test ends."""
    browser.asked.clear()
    browser.said.clear()
    yield browser
    assert browser.asked and browser.elsewhere() == [] and browser.said == []


@contextmanager
def page_of(scene: Scene, browser: Browser, first: bytes | None = None) -> Iterator[PageFeed]:
    """The page of a scene, opened and drawn; `first` is the picture that a flight under way begins with."""
    with PageFeed(scene_json(scene)) as feed:
        if first is not None:
            feed.show(first)
        browser.go(feed.url)
        browser.until(DRAWN)
        yield feed
        browser.go("about:blank")  # before the page ends, which it would report


def at(browser: Browser, t_s: float) -> None:
    """Show a time, and wait until it is drawn, in the table as well."""
    browser.value(f"skein.seek({t_s}), skein.tableMs = undefined")
    browser.value("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def cell(browser: Browser, sysid: int, column: str) -> str:
    """A cell of the table of vehicles."""
    names = browser.value("[...document.querySelectorAll('th')].map((one) => one.innerText)")
    number = next(n for n, name in enumerate(names) if name.startswith(column))
    found: str = browser.value(f"skein.table.rows.get({sysid}).cells[{number}].textContent")
    return found


def off_m(browser: Browser, places: Any, sysids: tuple[int, ...]) -> float:
    """How far markers stand from places (V, 3) at most; a marker that is missing is infinitely far."""
    drawn = [browser.value(f"skein.world.placeOf({sysid})") or [np.inf] * 3 for sysid in sysids]
    return float(np.linalg.norm(np.array(drawn) - places, axis=1).max())


def test_a_plan_is_drawn_where_it_flies_at_every_time(plan: Plan, shown: Browser, tmp_path: Path) -> None:
    with page_of(scene_of_plan(plan), shown):
        for t_s in (plan.t_start_s, -10.0, 0.0, 33.3, 130.0, plan.landing_s, plan.t_end_s - 0.01):
            at(shown, t_s)
            assert off_m(shown, plan.states(np.array([t_s]))[:, 0, POSITION], plan.sysids) < 0.1
        at(shown, 130.0)
        separation = shown.value("skein.curves.words(skein.curves.lines[1], 130).text")
        assert separation.startswith(f"least separation: {plan.separations_m(np.array([130.0]))[0]:.2f} m (vehicles ")
        speed_mps = np.linalg.norm(plan.named_states(np.array([130.0])).velocity_ned_mps[0, 0])
        assert float(cell(shown, plan.sysids[0], "speed")) == pytest.approx(speed_mps, abs=0.06)
        rally = rally_of(plan)
        assert rally is not None and shown.value("skein.world.rally") == pytest.approx(rally.reshape(-1, 3), abs=0.1)
        least = shown.value("skein.curves.lines.length")
        shown.value("document.querySelector('.more input').click()")
        assert shown.value("skein.curves.lines.length") == least + 4
        at(shown, 130.0)
        foot = "document.querySelector('.strip').getBoundingClientRect()"
        assert shown.value(f"{foot}.height > 30 && {foot}.bottom <= innerHeight"), "the phases stay in sight"
        assert shown.value("document.querySelector('.events').offsetHeight") == 0, "this plan has no events to come"
        each = np.array(shown.value("skein.curves.lines.find((one) => one.name === 'greatest speed').each"))
        assert each.shape[0] == len(plan.sysids)
        speeds = np.linalg.norm(plan.named_states(each[2, 100:900, 0]).velocity_ned_mps[2], axis=-1)
        assert each[2, 100:900, 1] == pytest.approx(speeds, abs=0.01), "of each vehicle"
        thrust_N = np.abs(plan.controls(np.array([130.0]))[:, 0, 0]).max()
        words = shown.value("skein.curves.words(skein.curves.lines.at(-4), 130).text")
        assert float(words.split()[2]) == pytest.approx(thrust_N, rel=0.01) and words.startswith("U1, largest: ")
        shown.picture(tmp_path / "plan.png")
        space = plt.imread(io.BytesIO((tmp_path / "plan.png").read_bytes()))[100:450, 50:700, :3]
        assert len(np.unique((255 * space).astype(int).reshape(-1, 3), axis=0)) > 50, "no blank ground"


def test_a_replay_is_played_dragged_and_sought_by_its_events(plan: Plan, shown: Browser) -> None:
    recording = recording_of(plan)
    with page_of(scene_of_recording(recording, 0.0, 79.5), shown):
        shown.value("[...document.querySelectorAll('li button')].at(-1).click()")
        assert shown.value("skein.t") == 40.0 and "told to land" in shown.value("skein.log.list.innerText")
        at(shown, 40.0)
        assert off_m(shown, recording.at(np.array([40.0]))[0][:, 0], plan.sysids) < 0.1
        for _ in range(2):  # the second turns the order round
            shown.value("skein.table.heads.find((one) => one.innerText.startsWith('error')).firstChild.click()")
        assert shown.value("document.querySelector('tbody td').innerText") == "3", "the vehicle that is off comes first"
        assert float(cell(shown, 3, "error")) == pytest.approx(2.0, abs=0.1)
        at(shown, 25.0)
        assert shown.value("skein.world.placeOf(2)") is None, "a silent vehicle has no place"
        assert cell(shown, 2, "heard").startswith("! ")
        frames = shown.value("skein.world.renderer.info.render.frame")
        shown.value("new Promise((done) => setTimeout(done, 1000))")
        assert shown.value("skein.world.renderer.info.render.frame") <= frames + 1, (
            "nothing has changed, nothing is drawn"
        )
        shown.press("Home")
        shown.press("]")
        shown.press(" ")
        assert shown.until("skein.t > 2.5 && skein.rate === 2")
        shown.press(" ")
        t_s = shown.value("skein.t")
        shown.press("ArrowLeft")
        assert shown.value("skein.t") == pytest.approx(t_s - 1.0)
        box = shown.value("(({ left, top, width }) => [left, top, width])(skein.curves.canvas.getBoundingClientRect())")
        for kind in ("mousePressed", "mouseReleased"):
            place = {"x": box[0] + 0.5 * box[2], "y": box[1] + 80, "button": "left", "clickCount": 1}
            shown.call("Input.dispatchMouseEvent", type=kind, **place)
        assert shown.value("skein.t") == pytest.approx(40.0, abs=2.0)


def picture(plan: Plan, t_s: float, aside_m: float) -> bytes:
    """All vehicles where the plan has them at 50 s, and so far aside."""
    places = plan.states(np.array([50.0]))[:, 0, POSITION] + (0.0, 3.0, 0.0)
    vehicles = tuple(
        VehiclePicture(
            sysid,
            (float(north), float(east) + aside_m, float(down)),
            *(0.5, 7.0, "GUIDED", True, 63.0, 0.1, 0.02, 3.0, 20.0, plan.sysids[row - 1], 5.0),
        )
        for row, (sysid, (north, east, down)) in enumerate(zip(plan.sysids, places, strict=True))
    )
    return picture_json(FlightPicture(t_s, "flying: mission", vehicles, 5.0, (1, 2), 0.4))


def test_a_silent_flight_under_way_shows_its_newest_picture_and_its_events(plan: Plan, shown: Browser) -> None:
    places = plan.states(np.array([50.0]))[:, 0, POSITION] + (0.0, 3.0, 0.0)

    with page_of(scene_of_plan(plan, SceneKind.FLIGHT), shown, picture(plan, 49.0, -1.0)) as feed:
        feed.tell(event_json(Happening(49.5, 3, "is told to hold", is_bad=True)))
        feed.show(picture(plan, 50.0, 0.0))
        shown.until("skein.t === 50 && skein.log.lines.length === 1")
        assert off_m(shown, places, plan.sysids) < 0.1
        flat = "{ name: 'x', unit: 'm', true: [], flown: [[0, -0.001]], planned: [], behind: () => [] }"
        assert shown.value(f"skein.curves.words({flat}, 1).text") == "x: 0.00 m"
        each = shown.value("skein.curves.lines.find((one) => one.name === 'greatest position error').each")
        assert [row[-1] for row in each] == [[50.0, 3.0]] * len(plan.sysids)
        assert shown.until("skein.table.rows.get(3).row.innerText.includes('GUIDED')")
        assert "flying: mission" in shown.until("document.querySelector('.now').innerText")
        words = shown.value("skein.curves.lines.map((curve) => skein.curves.words(curve, 50).text)")
        assert "least separation: 5.00 m (vehicles 1, 2)" in words and "formation error: 0.40 m" in words
        at(shown, 49.0)
        assert off_m(shown, places - (0.0, 1.0, 0.0), plan.sysids) < 0.1, "the past can be looked at"
        feed.show(picture(plan, 51.0, 1.0))
        shown.until("skein.scene.newest.t_s === 51")
        assert shown.value("skein.t") == 49.0, "and stays until you ask for now"
        shown.value("document.querySelector('.live').click()")
        shown.until("skein.t === 51")


def test_checks_the_word_that_arms_and_the_report_stand_beside_the_scene(
    plan: Plan, shown: Browser, tmp_path: Path
) -> None:
    rows = [
        {"sysid": sysid, "name": name, "measured": "12 %", "required": "30 %", "ok": ok, "warning": "", "waived": False}
        for sysid in plan.sysids
        for name, ok in (("home", True), ("battery", sysid != 2))
    ]
    (tmp_path / "map.png").write_bytes(b"no picture")
    shown_board = "document.querySelector('.board')"
    with page_of(scene_of_plan(plan, SceneKind.FLIGHT), shown, picture(plan, 50.0, 0.0)) as feed:
        feed.put("checks", {"title": "NO-GO", "rows": rows})
        assert "NO-GO" in shown.until(f"{shown_board}.querySelector('summary').innerText")
        assert shown.value(f"{shown_board}.querySelectorAll('td.bad').length") == 1
        assert shown.value(f"{shown_board}.querySelector('.question').hidden"), "nothing is to be confirmed"
        more = [{**one, "ok": True, "name": f"{one['name']} {n}"} for n in range(20) for one in rows]
        feed.put("checks", {"title": "GO", "rows": more})
        feed.put("question", "Type 'arm' to continue:")
        shown.until(f"!{shown_board}.querySelector('.question').hidden")
        assert shown.value("document.querySelector('.command').offsetHeight") == 0, "nothing flies that could obey"
        bottoms = (
            f"[{shown_board}.querySelector('input'), {shown_board}].map((one) => one.getBoundingClientRect().bottom)"
        )
        word, board = shown.value(bottoms)
        assert word <= board, "a long table does not hide where the word is typed"
        shown.value(f"{shown_board}.querySelector('input').focus()")
        for key in "arm":
            shown.press(key)
        assert shown.value("skein.t") == 50.0, "letters typed there are no keys of the page"
        shown.press("Enter")
        end_s = time.monotonic() + 20.0
        while not (asks := feed.asks()):
            assert time.monotonic() < end_s
            time.sleep(0.02)
        assert [(one.word, one.client) for one in asks] == [("arm", "127.0.0.1")]
        feed.answer(asks[0].number, "confirmed", may=True)
        feed.put("question", None)
        shown.until(f"{shown_board}.querySelector('.question').hidden && !{shown_board}.querySelector('.checks').open")
        assert feed.readers == 1
        assert shown.value("document.querySelector('.command').offsetHeight") > 0
        rights = "['tbody tr', '.fleet'].map((one) => document.querySelector(one).getBoundingClientRect().right)"
        row, fleet = shown.value(rights)
        assert row <= fleet + 1, "every column is in sight"
        feed.offer([tmp_path / "map.png"])
        criterion = {"name": "separation", "definition": "of centres", "measured": "0.8 m", "vehicles": "vehicles 1, 2"}
        criterion |= {"t_s": 12.0, "limit": "at least 1.3 m", "verdict": "FAILED", "is_bad": True}
        feed.put("report", {"outcome": "flight FAILED", "text": "", "criteria": [criterion], "files": ["map.png"]})
        shown.until("document.querySelector('.command').hidden")
        words = shown.value(f"{shown_board}.querySelector('.report').innerText")
        assert "flight FAILED" in words and "0.8 m (vehicles 1, 2)" in words and "! FAILED" in words
        assert shown.value(f"{shown_board}.querySelector('.report a').href").endswith("/files/map.png")


def test_a_thousand_vehicles_leave_the_page_in_its_window(shown: Browser) -> None:
    t_s = np.arange(0.0, 60.0)
    tracks = []
    for number in range(1000):
        place = np.stack([5.0 * (number % 32) + t_s, np.full(60, 5.0 * (number // 32)), np.full(60, -20.0)], axis=1)
        none = np.zeros(60, dtype=np.int64)
        tracks.append(VehicleTrack(number + 1, 3, t_s, place, np.gradient(place, axis=0), none == 0, none, none))
    recording = Recording("thousand", tuple(tracks), (), (), None)
    with page_of(scene_of_recording(recording, 0.0, 59.0), shown):
        at(shown, 30.0)
        assert shown.value("skein.world.placeOf(1000)") == pytest.approx([5.0 * 7 + 30.0, 5.0 * 31, -20.0], abs=0.1)
        shown.value("skein.look('1000')")
        at(shown, 30.0)
        numbers = shown.value("skein.world.names.filter((one) => one.style.display === '').map((one) => one.innerText)")
        assert "1000" in " ".join(numbers).split(), "what is near has its number, however many there are"
        bottoms = (
            "['.fleet', '.space', 'footer'].map((one) => document.querySelector(one).getBoundingClientRect().bottom)"
        )
        fleet, space, footer = shown.value(bottoms)
        assert fleet <= space + 1 <= footer <= 901
