"""The page as its parent sees it: a process that is fed through a pipe, and never waited for.

A thread writes to the pipe. While the page does not read, the newest picture replaces the one before it, and events
are kept: a frozen page delays nothing, and knows all events once it reads again.
"""

import json
import re
import secrets
import subprocess
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Iterable
from concurrent.futures import Future
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import IO, Self

from gcs.errors import GcsError, UsageError
from gcs.page.page_orders import MESSAGE_BYTES, PageAsk
from gcs.page.pipe_frames import PageFrame, read_frame, write_frame

_PROCESS = ("-m", "gcs.page.page_process")
_START_S = 60.0  # a busy machine needs long to import NiceGUI
_EVENTS = 10_000  # kept for a page that does not read; then the oldest go
_ASKS = 16  # messages of the page that wait; then the oldest go
_TILES = re.compile(r"(https?://[\w.-]+(?::\d+)?)(/[^\s\"'<>]*)")
_TAIL = 400  # characters of what the process said before it failed


def refuse_without_nicegui() -> None:
    """Raise UsageError where the page's library is not installed. It is looked for, not imported."""
    if find_spec("nicegui") is None:
        raise UsageError("--page needs NiceGUI, which is not installed", hint="pip install 'skein-gcs[page]'")


def origin_of_tiles(tiles: str) -> str:
    """Return scheme and host of an address of map tiles; empty for none. Raises UsageError."""
    found = _TILES.fullmatch(tiles) if tiles else None
    if tiles and (found is None or not all(f"{{{name}}}" in found[2] for name in "zxy")):
        raise UsageError(
            f"--tiles {tiles}: not an address of map tiles",
            hint="it has {z}, {x} and {y}, as https://tile.openstreetmap.org/{z}/{x}/{y}.png",
        )
    return found[1] if found else ""


class PageFeed:
    """One page of one scene. Use it as a context manager: the page ends with it."""

    def __init__(self, scene: bytes, address: str = "", *, orders_from_afar: bool = False, tiles: str = "") -> None:
        """Start the process and wait until it answers at its address. Raises UsageError and GcsError.

        `address`, numeric and of this machine: other machines see the page there, and order with `orders_from_afar`.
        `tiles`, an address with {z}, {x} and {y}: the browser lays this map under the scene.
        """
        refuse_without_nicegui()
        settings = json.dumps([address, orders_from_afar, origin_of_tiles(tiles)])
        self._token = secrets.token_urlsafe(16)
        self._wake = threading.Condition()
        self._frames: deque[tuple[PageFrame, bytes]] = deque(maxlen=_EVENTS)
        self._picture: bytes | None = None
        self._asks: deque[PageAsk] = deque(maxlen=_ASKS)
        self.readers = 0  # browsers that show the page
        self._closed = False
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 (closed with the page)
        self._process = subprocess.Popen(
            [sys.executable, *_PROCESS, settings],
            stdin=subprocess.PIPE,  # closes when this program ends, however it ends, and the page ends with it
            stdout=subprocess.PIPE,
            stderr=self._errors,
            start_new_session=True,  # Ctrl-C is for the flight
        )
        self._frames.extend([(PageFrame.TOKEN, self._token.encode()), (PageFrame.SCENE, scene)])
        if tiles:
            self.put("tiles", tiles)
        self._writer = threading.Thread(target=self._write, daemon=True, name="page")
        self._writer.start()
        self.url = f"http://127.0.0.1:{self._port()}/?token={self._token}"
        self.far_url = self.url.replace("127.0.0.1", address) if address else ""

    @property
    def has_ended(self) -> bool:
        """Whether the page's process has ended by itself, or was killed."""
        return self._process.poll() is not None and not self._closed

    def show(self, picture: bytes) -> None:
        """Show this picture next, instead of one that is not sent yet."""
        with self._wake:
            self._picture = picture
            self._wake.notify()

    def replace(self, scene: bytes, *, same_flight: bool) -> None:
        """Show another scene: of the same flight with another plan, or one with pictures and events of its own."""
        with self._wake:
            self._frames.append((PageFrame.PLAN if same_flight else PageFrame.SCENE, scene))
            self._wake.notify()

    def tell(self, event: bytes) -> None:
        """Add an event to the page's log."""
        with self._wake:
            self._frames.append((PageFrame.EVENT, event))
            self._wake.notify()

    def put(self, name: str, value: object) -> None:
        """Have something plain stand beside the scene, in place of what had this name; None takes it away."""
        with self._wake:
            self._frames.append((PageFrame.BOARD, json.dumps({name: value}).encode()))
            self._wake.notify()

    def offer(self, files: Iterable[Path]) -> None:
        """Have the page offer these files, each by its name, and no others."""
        paths = {file.name: str(file.resolve()) for file in files}
        with self._wake:
            self._frames.append((PageFrame.FILES, json.dumps(paths).encode()))
            self._wake.notify()

    def asks(self) -> list[PageAsk]:
        """Return what the page has asked since the last call."""
        return [self._asks.popleft() for _ in range(len(self._asks))]

    def answer(self, number: int, text: str, *, may: bool, way: object = None) -> None:
        """Answer what the page asked under this number. `may`: it was said or given; else `text` has the reason.

        `way`: the tracks of a proposed plan, as plain values.
        """
        answer = {"number": number, "text": text, "may": may, "way": way}
        with self._wake:
            self._frames.append((PageFrame.ANSWER, json.dumps(answer).encode()))
            self._wake.notify()

    def wait(self) -> None:
        """Wait until the page's process has ended."""
        self._process.wait()

    def close(self) -> None:
        """End the page."""
        with self._wake:
            self._closed = True
            self._wake.notify()
        self._process.kill()
        self._process.wait()
        self._writer.join(1.0)
        for pipe in (self._process.stdin, self._process.stdout, self._errors):
            with suppress(OSError):
                if pipe is not None:
                    pipe.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _write(self) -> None:
        pipe = self._process.stdin
        assert pipe is not None
        with suppress(OSError, ValueError):  # the page has ended
            while (frame := self._next()) is not None:
                write_frame(pipe, *frame)  # type: ignore[arg-type]

    def _next(self) -> tuple[PageFrame, bytes] | None:
        """The next frame, as soon as there is one; None at the end."""
        with self._wake:
            while not (self._frames or self._picture is not None or self._closed):
                self._wake.wait()
            if self._closed:
                return None
            if self._frames:
                return self._frames.popleft()
            picture, self._picture = self._picture, None
            assert picture is not None
            return PageFrame.PICTURE, picture

    def _port(self) -> int:
        first: Future[bytes] = Future()
        threading.Thread(target=self._read, args=(first,), daemon=True, name="page orders").start()
        with suppress(TimeoutError):
            if (port := first.result(_START_S).strip()).isdigit():
                return int(port)
        said = self._said()
        self.close()
        raise GcsError(f"the page did not start: {said or f'no answer within {_START_S:.0f} s'}")

    def _read(self, first: Future[bytes]) -> None:
        """Read the first line, and then what the page asks, until it ends or says anything else."""
        pipe = self._process.stdout
        assert pipe is not None
        with suppress(OSError, ValueError):
            first.set_result(pipe.readline())
            while (frame := read_frame(pipe, MESSAGE_BYTES)) is not None:  # type: ignore[arg-type]
                if frame[0] is PageFrame.ASK:
                    self._asks.append(PageAsk.of(frame[1]))
                elif frame[0] is PageFrame.READERS:
                    self.readers = int(frame[1])
        if not first.done():
            first.set_result(b"")

    def _said(self) -> str:
        with suppress(OSError, ValueError):
            self._errors.seek(0)
            lines = self._errors.read().decode(errors="replace").strip().splitlines()
            return lines[-1][-_TAIL:] if lines else ""
        return ""
