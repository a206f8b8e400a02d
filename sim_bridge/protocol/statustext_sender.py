"""Sends texts as STATUSTEXT: in one message, or in chunks with a common id."""

from __future__ import annotations

from gcs.link.wire.message import Message

_CHUNK_BYTES = 50
_HIGHEST_ID = 0xFFFF


class StatusTextSender:
    """Numbers the texts of one vehicle."""

    def __init__(self, numbers_all: bool) -> None:
        self._numbers_all = numbers_all
        self._id = 0

    def messages(self, severity: int, text: str) -> list[Message]:
        """Return the chunks of one text."""
        data = text.encode()
        chunks = [data[at : at + _CHUNK_BYTES] for at in range(0, len(data), _CHUNK_BYTES)] or [b""]
        if len(chunks) > 1 and len(chunks[-1]) == _CHUNK_BYTES:
            chunks.append(b"")  # a text ends with a chunk that is not full
        number = 0
        if self._numbers_all or len(chunks) > 1:
            self._id = self._id % _HIGHEST_ID + 1
            number = self._id
        return [
            Message(
                "STATUSTEXT",
                {"severity": int(severity), "text": chunk.decode(errors="replace"), "id": number, "chunk_seq": seq},
            )
            for seq, chunk in enumerate(chunks)
        ]
