"""What the page's process knows: the scene, the newest picture, some pictures before it, and all events."""

import json
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import BinaryIO

from gcs.page.pipe_frames import PageFrame, read_frame

_APART_S = 1.0  # of plan time, between pictures that are kept
_SCENE = "scene"  # on the board, the number of the change that brought the scene: a page reads it again
_KEPT = 7200  # pictures; then every other one goes


@dataclass
class PageState:
    """Filled by one thread, read by another; every change is one assignment or one append."""

    scene: bytes
    newest: bytes | None = None
    number: int = 0  # of pictures, events and changes of the board, so far
    board: dict[str, bytes] = field(default_factory=dict)
    changed: dict[str, int] = field(default_factory=dict)  # `number` after the last change of each on the board
    files: dict[str, str] = field(default_factory=dict)  # path of each that may be read, by name
    events: list[bytes] = field(default_factory=list)
    past: list[bytes] = field(default_factory=list)
    _on_answer: Callable[[bytes], None] | None = None
    _last_s: float = -float("inf")

    def answer_to(self, on_answer: Callable[[bytes], None]) -> None:
        """Pass answers to orders on from now on."""
        self._on_answer = on_answer

    def receive(self, pipe: BinaryIO) -> None:
        """Take in frames until the pipe ends."""
        while (frame := read_frame(pipe)) is not None:
            self.take(*frame)

    def take(self, kind: PageFrame, data: bytes) -> None:
        """Take in one frame."""
        if kind is PageFrame.ANSWER:
            if self._on_answer is not None:
                self._on_answer(data)
            return
        if kind is PageFrame.FILES:
            self.files = json.loads(data)
            return
        if kind is PageFrame.BOARD:
            for name, value in json.loads(data).items():
                self.changed = {**self.changed, name: self.number + 1}
                self.board = {**self.board, name: json.dumps(value).encode()}
        if kind in (PageFrame.SCENE, PageFrame.PLAN):
            if kind is PageFrame.SCENE:
                self.newest, self.past, self.events = None, [], []
            self.scene = data
            self.changed = {**self.changed, _SCENE: self.number + 1}
            self.board = {**self.board, _SCENE: json.dumps(self.number + 1).encode()}
        if kind is PageFrame.EVENT:
            self.events.append(data)
        elif kind is PageFrame.PICTURE:
            self.newest = data
            self._keep(data)
        self.number += 1

    def whole(self) -> bytes:
        """Return all that a page needs that opens now, as one JSON object."""
        parts = {"pictures": [*self.past, *([self.newest] if self.newest else [])], "events": self.events}
        lists = b",".join(b'"%s":[%s]' % (name.encode(), b",".join(list(one))) for name, one in parts.items())
        return b'{"scene":%s,%s,"board":%s}' % (self.scene, lists, self._board(0))

    def since(self, events: int, number: int = 0) -> str:
        """Return the newest picture, events after the first `events`, and the board's changes after `number`: JSON."""
        later = b",".join(self.events[events:])
        newest = self.newest or b"null"
        return (b'{"picture":%s,"events":[%s],"board":%s}' % (newest, later, self._board(number))).decode()

    def _board(self, after: int) -> bytes:
        board, changed = self.board, self.changed
        parts = (b'"%s":%s' % (name.encode(), value) for name, value in board.items() if changed[name] > after)
        return b"{%s}" % b",".join(parts)

    def _keep(self, picture: bytes) -> None:
        t_s = json.loads(picture).get("t_s")
        if t_s is None or t_s < self._last_s + _APART_S:
            return
        self._last_s = t_s
        self.past.append(picture)
        if len(self.past) > _KEPT:
            self.past = self.past[::2]


def read_state(pipe: BinaryIO) -> tuple[str, PageState] | None:
    """Return the token and the state from the first two frames; None if the pipe ends before."""
    token, scene = read_frame(pipe), read_frame(pipe)
    if token is None or scene is None:
        return None
    return token[1].decode(), PageState(scene[1])


def in_thread(state: PageState, pipe: BinaryIO, at_end: threading.Event) -> None:
    """Fill the state in a thread of its own, and set `at_end` when the pipe ends."""

    def receive() -> None:
        state.receive(pipe)
        at_end.set()

    threading.Thread(target=receive, daemon=True, name="feed").start()
