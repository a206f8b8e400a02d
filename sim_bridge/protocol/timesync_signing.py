"""TIMESYNC and message signing of one vehicle. `t_ns` is its time since boot, `now_s` is wall time."""

from __future__ import annotations

from gcs.link.wire.message import Message, Station
from gcs.link.wire.signing import KEY_BYTES, Signature, Signing
from sim_bridge.personality.link_traits import LinkTraits

_NS_PER_S = 1_000_000_000


class TimesyncResponder:
    """TIMESYNC: answers with the vehicle's clock at the resolution of the original, and sends its own requests."""

    def __init__(self, traits: LinkTraits, me: Station) -> None:
        self._traits = traits
        self._me = me
        self._next_ns: float | None = None

    def receive(self, message: Message, t_ns: int) -> list[Message]:
        """Answer a request; answers to the vehicle's own requests are ignored."""
        if message.fields["tc1"] != 0:
            return []
        step = self._traits.clock_step_ns
        return [Message("TIMESYNC", {"tc1": t_ns // step * step, "ts1": message.fields["ts1"]})]

    def due(self, t_ns: int) -> list[Message]:
        """Return the vehicle's own request when it is due. It contains the system id, which identifies the answer."""
        if self._next_ns is not None and t_ns < self._next_ns:
            return []
        first, self._next_ns = self._next_ns is None, t_ns + self._traits.timesync_period_s * _NS_PER_S
        if first:
            return []
        return [Message("TIMESYNC", {"tc1": 0, "ts1": t_ns // 1000 * 1000 + self._me.sysid})]


class SigningState:
    """Message signing: SETUP_SIGNING sets the key, or switches signing off."""

    def __init__(self, traits: LinkTraits) -> None:
        self._traits = traits
        self._signing = Signing()

    def remember(self, earlier: SigningState) -> None:
        """Take over the key from before a restart."""
        self._signing = earlier._signing

    @property
    def known(self) -> bool:
        """Whether the original can sign."""
        return self._traits.signs

    def begin(self, key: bytes, ticks: int, now_s: float) -> None:
        """Sign with `key` from the start, as a vehicle that was given its key before."""
        self._signing.set_up(key, ticks, now_s)

    def believes(self, message: Message, now_s: float) -> bool:
        """Whether the signature of the frame permits this message."""
        return self._signing.accepts(message.raw, now_s)

    def set_up(self, message: Message, now_s: float, *, armed: bool) -> None:
        """Take the key of SETUP_SIGNING; not while armed, and not where the original ignores the message."""
        if not self._traits.signs or armed:
            return
        key = bytes(message.fields["secret_key"])
        if len(key) == KEY_BYTES:
            self._signing.set_up(key, int(message.fields["initial_timestamp"]), now_s)

    def signature(self, now_s: float) -> Signature | None:
        """Return the signature for the next frame; None while signing is off."""
        return self._signing.signature(now_s)
