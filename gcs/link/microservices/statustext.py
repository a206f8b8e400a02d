"""STATUSTEXT messages joined into whole texts (https://mavlink.io/en/messages/common.html#STATUSTEXT).

A long text comes in chunks of 50 characters, identified by source, id and chunk number; id 0 means not chunked. After
`timeout_s` a missing chunk is written as "[...]".
"""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs.link.wire.message import Message, Station

_CHUNK_LENGTH = 50


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
        pending = self._pending.setdefault(key, _Pending(severity, now_s + self._timeout_s))
        pending.chunks[chunk] = text
        if len(text.encode()) < _CHUNK_LENGTH:
            pending.last = chunk
        return [self._finish(key)] if pending.whole else []

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
