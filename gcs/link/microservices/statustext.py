"""STATUSTEXT messages joined into whole sentences.

Knows: chunks of 50 characters, told apart by source, id and chunk number (id 0: not chunked). Does not know:
clocks beyond `now_s`. A chunk that never comes is written as "[...]"; a text waits for it for `patience_s`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs.link.wire.message import Message, Station

_CHUNK_LENGTH = 50


@dataclass(frozen=True)
class StatusText:
    """One sentence of a vehicle."""

    source: Station
    severity: int
    text: str


@dataclass
class _Pending:
    severity: int
    until_s: float
    chunks: dict[int, str] = field(default_factory=dict)
    last: int | None = None  # number of the chunk that ends the text, once it came

    @property
    def whole(self) -> bool:
        return self.last is not None and len(self.chunks) > self.last

    def text(self) -> str:
        end = max(self.chunks) if self.last is None else self.last
        parts = [self.chunks.get(n, "[...]") for n in range(end + 1)]
        return "".join(parts) + ("" if self.last is not None else "[...]")


class StatusTextJoiner:
    """Joins the chunks of all sources of one link."""

    def __init__(self, patience_s: float = 2.0) -> None:
        self._patience_s = patience_s
        self._pending: dict[tuple[Station, int], _Pending] = {}

    def receive(self, message: Message, now_s: float) -> list[StatusText]:
        """The texts that this message completes."""
        if message.name != "STATUSTEXT":
            return []
        text, number = message.fields["text"], message.fields.get("id", 0)
        severity = message.fields["severity"]
        if not number:
            return [StatusText(message.source, severity, text)]
        key = (message.source, number)
        chunk = message.fields["chunk_seq"]
        pending = self._pending.setdefault(key, _Pending(severity, now_s + self._patience_s))
        pending.chunks[chunk] = text
        if len(text.encode()) < _CHUNK_LENGTH:
            pending.last = chunk
        return [self._finish(key)] if pending.whole else []

    def tick(self, now_s: float) -> list[StatusText]:
        """The texts whose missing chunks are no longer waited for."""
        late = [key for key, pending in self._pending.items() if now_s >= pending.until_s]
        return [self._finish(key) for key in late]

    @property
    def deadline_s(self) -> float | None:
        """When `tick` next has something to do."""
        return min((p.until_s for p in self._pending.values()), default=None)

    def _finish(self, key: tuple[Station, int]) -> StatusText:
        pending = self._pending.pop(key)
        return StatusText(key[0], pending.severity, pending.text())
