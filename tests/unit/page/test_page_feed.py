"""The pipe to the page, and what the page knows: nothing waits for a page that does not read."""

from __future__ import annotations

import io
import json
import os
import signal
import socket
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import suppress
from http.client import HTTPConnection
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from gcs.errors import GcsError, UsageError
from gcs.page import page_feed
from gcs.page.page_feed import PageFeed, refuse_without_nicegui
from gcs.page.page_process import PageReaders
from gcs.page.page_state import PageState, read_state
from gcs.page.pipe_frames import PageFrame, read_frame, write_frame

SCENE = b'{"name":"a plan"}'


def picture(t_s: float | None) -> bytes:
    return json.dumps({"t_s": t_s}).encode()


@given(st.lists(st.tuples(st.sampled_from(PageFrame), st.binary(max_size=40))), st.integers(0, 200))
def test_frames_arrive_whole_and_in_order_and_a_broken_end_is_the_end(
    frames: list[tuple[PageFrame, bytes]], cut: int
) -> None:
    pipe = io.BytesIO()
    for frame in frames:
        write_frame(pipe, *frame)
    whole, sizes = pipe.getvalue(), [5 + len(data) for _, data in frames]
    left = whole[:cut]
    fits = sum(sum(sizes[: n + 1]) <= len(left) for n in range(len(frames)))
    pipe = io.BytesIO(left)
    assert [read_frame(pipe) for _ in range(fits + 1)] == [*frames[:fits], None]


def test_a_page_that_opens_late_gets_the_past_and_all_events() -> None:
    state = PageState(SCENE)
    for t_s in (None, 0.0, 0.1, 0.9, 1.0, 1.5, 2.5, 2.6):
        state.take(PageFrame.PICTURE, picture(t_s))
    state.take(PageFrame.EVENT, b'{"text":"is armed"}')
    whole = json.loads(state.whole())
    assert whole["scene"] == {"name": "a plan"} and whole["events"] == [{"text": "is armed"}]
    assert [one["t_s"] for one in whole["pictures"]] == [0.0, 1.0, 2.5, 2.6]
    assert json.loads(state.since(0)) == {"picture": {"t_s": 2.6}, "events": [{"text": "is armed"}], "board": {}}
    assert json.loads(state.since(1))["events"] == []


def test_what_stands_beside_the_scene_is_sent_whole_at_first_and_then_when_it_changes() -> None:
    state, view = PageState(SCENE), View()
    readers = PageReaders(state, lambda *_: None)

    def boards() -> list[object]:
        readers.drawn(view, 0)  # type: ignore[arg-type]
        readers.send()
        found, view.got = [json.loads(one)["board"] for one in view.got], []
        return found

    state.take(PageFrame.BOARD, b'{"checks":[1],"question":"arm?"}')
    assert json.loads(state.whole())["board"] == {"checks": [1], "question": "arm?"}
    assert boards() == [{"checks": [1], "question": "arm?"}]
    state.take(PageFrame.PICTURE, picture(1.0))
    assert boards() == [{}]
    state.take(PageFrame.BOARD, b'{"question":null}')
    assert boards() == [{"question": None}]


def test_a_new_plan_keeps_what_the_flight_reported_and_the_scene_of_a_replay_begins_anew() -> None:
    state, view = PageState(SCENE), View()
    readers = PageReaders(state, lambda *_: None)
    state.take(PageFrame.PICTURE, picture(1.0))
    state.take(PageFrame.EVENT, b'{"text":"is armed"}')
    state.take(PageFrame.PLAN, b'{"name":"another plan"}')
    whole = json.loads(state.whole())
    assert whole["scene"] == {"name": "another plan"} and len(whole["events"]) == 1 and len(whole["pictures"]) == 2
    first = whole["board"]["scene"]
    readers.drawn(view, 1)  # type: ignore[arg-type]
    readers.send()
    assert json.loads(view.got[0])["board"] == {"scene": first}, "the page is told to read it again"
    state.take(PageFrame.SCENE, b'{"name":"replay"}')
    whole = json.loads(state.whole())
    assert whole["scene"] == {"name": "replay"} and whole["events"] == whole["pictures"] == []
    assert whole["board"]["scene"] > first


def test_a_state_needs_token_and_scene() -> None:
    pipe = io.BytesIO()
    write_frame(pipe, PageFrame.TOKEN, b"word")
    assert read_state(io.BytesIO(pipe.getvalue())) is None
    write_frame(pipe, PageFrame.SCENE, SCENE)
    found = read_state(io.BytesIO(pipe.getvalue()))
    assert found is not None and (found[0], found[1].scene) == ("word", SCENE)


class View:
    """A view without a browser."""

    def __init__(self) -> None:
        self.is_deleted = False
        self.got: list[str] = []

    def receive(self, update: str) -> None:
        self.got.append(update)


def test_a_reader_gets_the_newest_picture_when_it_has_drawn_the_last_and_no_other() -> None:
    state, slow, quick = PageState(SCENE), View(), View()
    readers = PageReaders(state, lambda *_: None)
    for view in (slow, quick):
        readers.drawn(view, 0)  # type: ignore[arg-type]
    readers.send()
    for t_s in (1.0, 2.0, 3.0):
        state.take(PageFrame.PICTURE, picture(t_s))
        readers.send()
        readers.drawn(quick, 0)  # type: ignore[arg-type]
        readers.send()  # nothing is new
    times = {name: [json.loads(one)["picture"] for one in view.got] for name, view in (("s", slow), ("q", quick))}
    assert times["q"] == [None, {"t_s": 1.0}, {"t_s": 2.0}, {"t_s": 3.0}]
    assert times["s"] == [None], "it has not drawn the first"
    readers.drawn(slow, 0)  # type: ignore[arg-type]
    readers.send()
    assert json.loads(slow.got[-1])["picture"] == {"t_s": 3.0}
    quick.is_deleted = True
    state.take(PageFrame.PICTURE, picture(4.0))
    readers.drawn(quick, 0)  # type: ignore[arg-type]
    readers.send()
    assert len(quick.got) == 4


def test_without_nicegui_the_command_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_feed, "find_spec", lambda name: None)
    with pytest.raises(UsageError, match="NiceGUI") as refused:
        refuse_without_nicegui()
    assert "skein-gcs[page]" in refused.value.hint


def test_a_page_that_cannot_start_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_feed, "_PROCESS", ("-c", "raise RuntimeError('no such port')"))
    with pytest.raises(GcsError, match="no such port"):
        PageFeed(SCENE)


def wait_for(feed: PageFeed, within_s: float = 20.0) -> bool:
    end_s = time.monotonic() + within_s
    while not feed.has_ended and time.monotonic() < end_s:
        time.sleep(0.02)
    return feed.has_ended


@pytest.fixture(scope="module")
def feed() -> Iterator[PageFeed]:
    with PageFeed(SCENE) as made:
        yield made


def test_the_page_is_served_to_whom_has_the_token(feed: PageFeed) -> None:
    where = urlsplit(feed.url)
    assert where.hostname == "127.0.0.1" and where.port is not None
    link = HTTPConnection(where.hostname, where.port)

    def get(path: str, cookie: str = "") -> tuple[int, str, str]:
        link.request("GET", path, headers={"Cookie": cookie} if cookie else {})
        answer = link.getresponse()
        return answer.status, answer.read().decode(), answer.getheader("Set-Cookie") or ""

    assert get("/")[0] == get("/scene")[0] == get("/_nicegui/3.18.0/static/nicegui.js")[0] == 403
    status, _, given = get(f"/?{where.query}")
    assert status == 200
    cookie = given.split(";")[0]
    assert "formation_view" in get("/", cookie)[1]
    assert json.loads(get("/scene", cookie)[1])["scene"] == {"name": "a plan"}
    address = f"ws://{where.netloc}/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
    origin = f"http://{where.netloc}"
    with connect(address, origin=origin, additional_headers={"Cookie": cookie}) as link_to_page:
        assert str(link_to_page.recv(timeout=10)).startswith("0{")
    for wrong_origin, headers in (
        (origin, {}),
        ("http://evil.example", {"Cookie": cookie}),
        (None, {"Cookie": cookie}),
    ):
        with pytest.raises(InvalidStatus, match="403"):
            connect(address, origin=wrong_origin, additional_headers=headers)  # type: ignore[arg-type]


def test_an_order_of_the_page_reaches_the_flight_and_its_answer_the_page(feed: PageFeed) -> None:
    where = urlsplit(feed.url)
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    opener.open(feed.url).read()
    origin = {"Origin": f"http://{where.netloc}"}

    def post(body: bytes) -> Any:
        request = urllib.request.Request(f"http://{where.netloc}/orders", body, origin)
        return json.loads(opener.open(request, timeout=20).read())

    def answer() -> None:
        end_s = time.monotonic() + 20.0
        while not (asks := feed.asks()) and time.monotonic() < end_s:
            time.sleep(0.02)
        for one in asks:
            feed.answer(one.number, f"{one.order} {one.vehicles}", may=True)

    flight = threading.Thread(target=answer)
    flight.start()
    assert post(b'{"order":"return","vehicles":[2,3]}')["text"] == "return (2, 3)"
    flight.join()
    for body, status in ((b'{"order":"disarm"}', 400), (b" " * 10_000, 413)):
        with pytest.raises(urllib.error.HTTPError, match=str(status)):
            post(body)
    assert feed.asks() == []


def test_the_page_offers_the_files_that_it_was_given_and_no_others(feed: PageFeed, tmp_path: Path) -> None:
    (tmp_path / "report.md").write_text("all went well")
    (tmp_path / "other.md").write_text("nobody's")
    feed.offer([tmp_path / "report.md"])
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    opener.open(feed.url).read()
    root, end_s = f"http://{urlsplit(feed.url).netloc}/files/", time.monotonic() + 20.0
    while True:
        try:
            answer = opener.open(f"{root}report.md")
            break
        except urllib.error.HTTPError:
            assert time.monotonic() < end_s
            time.sleep(0.02)
    assert answer.read() == b"all went well" and "attachment" in answer.headers["Content-Disposition"]
    for other in ("other.md", "..%2Freport.md", "%2Fetc%2Fhostname", "../files/other.md", ""):
        try:
            assert b"formation_view" in opener.open(root + other).read(), "NiceGUI answers with the page"
        except urllib.error.HTTPError as refused:
            assert refused.code == 404
    with pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(f"{root}report.md")


def test_a_frozen_page_delays_nobody_and_gets_the_newest_picture_and_every_event_later(feed: PageFeed) -> None:
    os.kill(feed._process.pid, signal.SIGSTOP)
    try:
        longest_s = 0.0
        for n in range(400):
            begin_s = time.perf_counter()
            feed.show(picture(float(n)) + b" " * 100_000)
            if n % 100 == 0:
                feed.tell(json.dumps({"text": f"event {n}"}).encode())
            longest_s = max(longest_s, time.perf_counter() - begin_s)
        assert longest_s < 0.25, "40 MB did not wait for a pipe of 64 KiB"
    finally:
        os.kill(feed._process.pid, signal.SIGCONT)
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    opener.open(feed.url).read()
    where, end_s = urlsplit(feed.url), time.monotonic() + 20.0
    while time.monotonic() < end_s:
        whole = json.loads(opener.open(f"http://{where.netloc}/scene").read())
        if whole["pictures"] and whole["pictures"][-1]["t_s"] == 399.0 and len(whole["events"]) == 4:
            break
        time.sleep(0.05)
    assert [one["text"] for one in whole["events"]] == [f"event {n}" for n in (0, 100, 200, 300)]
    assert whole["pictures"][-1]["t_s"] == 399.0 and len(whole["pictures"]) < 100


def test_a_page_that_was_killed_is_noticed_and_feeding_it_does_no_harm() -> None:
    with PageFeed(SCENE) as feed:
        assert not feed.has_ended
        os.kill(feed._process.pid, signal.SIGKILL)
        assert wait_for(feed)
        for n in range(100):
            feed.show(picture(float(n)))
            feed.tell(b"{}")
    assert feed._process.poll() is not None and not feed._writer.is_alive()


def test_the_page_ends_when_its_pipe_does() -> None:
    with PageFeed(SCENE) as feed:
        assert feed._process.stdin is not None
        feed._process.stdin.close()  # as when the parent is killed
        assert wait_for(feed)


def own_address() -> str:
    """An address of this machine that is not its loopback; empty without one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp, suppress(OSError):
        udp.connect(("192.0.2.1", 9))  # sends nothing
        return str(udp.getsockname()[0])
    return ""


@pytest.mark.skipif(own_address() in ("", "127.0.0.1"), reason="this machine has its loopback alone")
def test_from_an_address_beyond_loopback_the_page_is_read_only() -> None:
    with PageFeed(SCENE, own_address()) as feed:
        for url, status in ((feed.far_url, 403), (feed.url, 400)):
            origin = f"http://{urlsplit(url).netloc}"
            opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
            opener.open(url).read()
            assert json.loads(opener.open(f"{origin}/scene").read())["scene"] == {"name": "a plan"}
            request = urllib.request.Request(
                f"{origin}/orders", b"{}", {"Origin": origin, "X-Forwarded-For": "127.0.0.1"}
            )
            with pytest.raises(urllib.error.HTTPError, match=str(status)):
                opener.open(request)
