"""The STATUSTEXTs of one vehicle: joined, kept with their times, passed on; the critical ones since it was found."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from gcs.link.microservices.statustext import StatusText, StatusTextJoiner
from gcs.link.wire.message import Message
from gcs.mavlink import Severity

_KEPT = 200

TextListener = Callable[[float, StatusText], None]  # event loop time, text


class VehicleTexts:
    """Texts that begin as `startup_texts` belong to the start-up: they count once the vehicle is ready."""

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
            if is_critical(said):
                self._critical.pop(said.text, None)
                self._critical[said.text] = (now_s, said)
                if len(self._critical) > _KEPT:
                    del self._critical[next(iter(self._critical))]
            for listener in tuple(self._listeners):
                listener(now_s, said)


def is_critical(said: StatusText) -> bool:
    """Whether a text is of severity CRITICAL or worse."""
    return said.severity <= Severity.CRITICAL
