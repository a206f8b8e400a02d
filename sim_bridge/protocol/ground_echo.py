"""How far the ground station has read: it answers a PING after everything that was sent before it.

A ground station reads what its processor allows, and a socket that is full loses messages without a word. Vehicles that
run faster than real time therefore send PING, and time goes on by at most `BEHIND_S` beyond one that is not answered. A
station that answers none is not waited for. https://mavlink.io/en/services/ping.html

`BEHIND_S` is long enough that a station which keeps up is never waited for: it measures how fast the vehicles' time is,
and one that sends setpoints just in time would take every wait for a slower time.
"""

from __future__ import annotations

from gcs.link.wire.message import Message

PERIOD_S = 0.1  # of simulated time
BEHIND_S = 0.5
UNANSWERED_PERIOD_S = 1.0


class GroundEcho:
    """The requests to the ground station, and how far it has read. All times are simulated."""

    def __init__(self) -> None:
        self._sent: dict[int, float] = {}  # by number; the unanswered ones
        self._number = 0
        self._next_s = 0.0
        self._read_s = 0.0  # all that was sent until then was read
        self._answers = False

    def due(self, t_s: float) -> Message | None:
        """Return the request that is due, to be sent after all other messages."""
        return self.again(t_s) if t_s >= self._next_s else None

    def again(self, t_s: float) -> Message:
        """Return a request, because the one before may have been lost."""
        self._next_s = t_s + (UNANSWERED_PERIOD_S if self._sent else PERIOD_S)
        self._number += 1
        if not self._answers:
            self._sent.clear()
        self._sent[self._number] = t_s
        target = {"target_system": 0, "target_component": 0}
        return Message("PING", {"time_usec": round(t_s * 1e6), "seq": self._number} | target)

    def receive(self, message: Message) -> None:
        """Take an answer: what was sent before its request was read."""
        number = message.fields["seq"]
        if number in self._sent:
            self._answers = True
            self._read_s = self._sent[number]
            self._sent = {n: sent_s for n, sent_s in self._sent.items() if n > number}
            self._next_s = min(self._next_s, self._read_s + PERIOD_S)

    def awaits_after_s(self, t_s: float) -> float | None:
        """Return the time up to which the station has read, if it is too far behind; None to go on."""
        oldest_s = next(iter(self._sent.values()), t_s)
        return self._read_s if self._answers and t_s - oldest_s >= BEHIND_S else None
