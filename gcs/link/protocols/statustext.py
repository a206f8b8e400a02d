"""STATUSTEXT messages joined into whole texts (https://mavlink.io/en/messages/common.html#STATUSTEXT).

A long text comes in chunks of 50 characters, identified by source, id and chunk number; id 0 means not chunked. After
`timeout_s` a missing chunk is written as "[...]". A chunk that comes again so soon after its text is a copy.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from gcs.link.wire.message import Message, Station
from gcs.mavlink import Severity

_CHUNK_LENGTH = 50
_KEPT = 200


@dataclass(frozen=True)
class StatusText:
    """One text of a vehicle."""

    source: Station
    severity: int
    text: str


@dataclass
class _Pending:
    severity: int
    until_s: float
    chunks: dict[int, str] = field(default_factory=dict)
    last: int | None = None  # number of the final chunk, once it has arrived

    @property
    def whole(self) -> bool:
        return self.last is not None and len(self.chunks) > self.last

    def text(self) -> str:
        end = max(self.chunks) if self.last is None else self.last
        parts = [self.chunks.get(n, "[...]") for n in range(end + 1)]
        return "".join(parts) + ("" if self.last is not None else "[...]")


class StatusTextJoiner:
    """Joins the chunks of all sources of one link."""

    def __init__(self, timeout_s: float = 2.0) -> None:
        self._timeout_s = timeout_s
        self._pending: dict[tuple[Station, int], _Pending] = {}
        self._told_s: dict[tuple[Station, int], float] = {}  # when a text was whole

    def receive(self, message: Message, now_s: float) -> list[StatusText]:
        """Return the texts that this message completes."""
        if message.name != "STATUSTEXT":
            return []
        text, number = message.fields["text"], message.fields.get("id", 0)
        severity = message.fields["severity"]
        if not number:
            return [StatusText(message.source, severity, text)]
        key = (message.source, number)
        chunk = message.fields["chunk_seq"]
        if now_s < self._told_s.get(key, -math.inf) + self._timeout_s:
            return []
        pending = self._pending.setdefault(key, _Pending(severity, now_s + self._timeout_s))
        pending.chunks[chunk] = text
        if len(text.encode()) < _CHUNK_LENGTH:
            pending.last = chunk
        if not pending.whole:
            return []
        self._told_s = {one: at_s for one, at_s in self._told_s.items() if now_s < at_s + self._timeout_s}
        self._told_s[key] = now_s
        return [self._finish(key)]

    def tick(self, now_s: float) -> list[StatusText]:
        """Return the texts whose timeout has passed, with gaps."""
        expired = [key for key, pending in self._pending.items() if now_s >= pending.until_s]
        return [self._finish(key) for key in expired]

    @property
    def deadline_s(self) -> float | None:
        """The time of the next `tick`; None if no text is incomplete."""
        return min((p.until_s for p in self._pending.values()), default=None)

    def _finish(self, key: tuple[Station, int]) -> StatusText:
        pending = self._pending.pop(key)
        return StatusText(key[0], pending.severity, pending.text())


TextListener = Callable[[float, StatusText], None]  # event loop time, text


class VehicleTexts:
    """The texts of one vehicle: joined, kept with their times, passed on; the critical ones since it was found.

    Texts that begin as `startup_texts` belong to the start-up: they count once the vehicle is ready.
    """

    def __init__(self, startup_texts: tuple[str, ...]) -> None:
        self.kept: deque[tuple[float, StatusText]] = deque(maxlen=_KEPT)  # event loop time, text
        self._startup_texts = startup_texts
        self._critical: dict[str, tuple[float, StatusText]] = {}  # the last time of each
        self._joiner = StatusTextJoiner()
        self._listeners: list[TextListener] = []

    def receive(self, message: Message, now_s: float) -> None:
        """Process one STATUSTEXT."""
        self._keep(self._joiner.receive(message, now_s), now_s)

    def tick(self, now_s: float) -> None:
        """End the wait for lost chunks."""
        self._keep(self._joiner.tick(now_s), now_s)

    def subscribe(self, listener: TextListener) -> Callable[[], None]:
        """Call `listener` with every whole text from now on. Return the function that ends this."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener) if listener in self._listeners else None

    def critical(self, ready_since_s: float | None) -> tuple[str, ...]:
        """Return the texts of severity CRITICAL or worse that count, each once, in the order of their last time."""
        counted = [said for at_s, said in self._critical.values() if self._counts(at_s, said, ready_since_s)]
        return tuple(said.text.strip() for said in counted)

    def startup(self, since_s: float) -> tuple[str, ...]:
        """Return the texts of the start-up since then, each once: the reasons for which a vehicle is not ready."""
        said = (text for at_s, text in self.kept if at_s >= since_s and text.text.startswith(self._startup_texts))
        return tuple(dict.fromkeys(text.text.strip() for text in said)) if self._startup_texts else ()

    def _counts(self, at_s: float, said: StatusText, ready_since_s: float | None) -> bool:
        if not said.text.startswith(self._startup_texts):
            return True
        return ready_since_s is not None and at_s > ready_since_s

    def _keep(self, texts: list[StatusText], now_s: float) -> None:
        for said in texts:
            self.kept.append((now_s, said))
            if said.severity <= Severity.CRITICAL:
                self._critical.pop(said.text, None)
                self._critical[said.text] = (now_s, said)
                if len(self._critical) > _KEPT:
                    del self._critical[next(iter(self._critical))]
            for listener in tuple(self._listeners):
                listener(now_s, said)
