"""What a vehicle does for its link besides flying: its clock for others, and signatures.

Knows: the habits of its make of autopilot (`LinkTraits`). Does not know: sockets, which messages matter.
Two clocks, as everywhere: `t_ns` is the vehicle's own time since boot, `now_s` the wall's.
"""

from __future__ import annotations

from gcs.link.wire.message import Message, Station
from gcs.link.wire.signing import KEY_BYTES, Signature, Signing
from sim_bridge.personality.link_traits import LinkTraits

_NS_PER_S = 1_000_000_000


class TimeKeeper:
    """TIMESYNC: answers with the vehicle's clock as finely as the original tells it, and asks in turn."""

    def __init__(self, habits: LinkTraits, me: Station) -> None:
        self._habits = habits
        self._me = me
        self._next_ns: float | None = None

    def receive(self, message: Message, t_ns: int) -> list[Message]:
        """Answer a question; answers to own questions are of no use to a vehicle."""
        if message.fields["tc1"] != 0:
            return []
        step = self._habits.clock_step_ns
        return [Message("TIMESYNC", {"tc1": t_ns // step * step, "ts1": message.fields["ts1"]})]

    def due(self, t_ns: int) -> list[Message]:
        """Its own question, when its time has come; marked with its id, so that it knows the answer from others'."""
        if self._next_ns is not None and t_ns < self._next_ns:
            return []
        first, self._next_ns = self._next_ns is None, t_ns + self._habits.asks_time_every_s * _NS_PER_S
        if first:
            return []
        return [Message("TIMESYNC", {"tc1": 0, "ts1": t_ns // 1000 * 1000 + self._me.sysid})]


class Trust:
    """Signing as a vehicle does it: SETUP_SIGNING sets the key, or switches signing off."""

    def __init__(self, habits: LinkTraits) -> None:
        self._habits = habits
        self._signing = Signing()

    def remember(self, earlier: Trust) -> None:
        """Take over the key from before a restart."""
        self._signing = earlier._signing

    def believes(self, message: Message, now_s: float) -> bool:
        """Whether to listen to a message, judged by the frame it came in."""
        return self._signing.accepts(message.raw, now_s)

    def set_up(self, message: Message, now_s: float, *, armed: bool) -> None:
        """Take the key of SETUP_SIGNING; not in flight, and not where the original does not know it."""
        if not self._habits.signs or armed:
            return
        key = bytes(message.fields["secret_key"])
        if len(key) == KEY_BYTES:
            self._signing.set_up(key, int(message.fields["initial_timestamp"]), now_s)

    def signature(self, now_s: float) -> Signature | None:
        """What the next frame is to be signed with; None while signing is off."""
        return self._signing.signature(now_s)
