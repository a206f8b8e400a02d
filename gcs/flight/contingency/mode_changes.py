"""Tells a failsafe's mode change from a pilot's, by texts, system_status and sticks. Time is an argument.

A text of a failsafe counts, and so does a system_status that turned critical, unless a pilot moved sticks or switches.
Without any sign a pilot, or another ground station, has changed the mode.
"""

import math
from enum import Enum

from gcs.autopilots.columns import FailsafeCause, FlightBehaviour
from gcs.link.wire.message import Message
from gcs.mavlink import MavState

_MOVED_US = 60  # of one RC channel: more than noise
_CHANNELS = 8
_UNUSED = (0, 65535)


class ModeOrigin(Enum):
    """What chose a mode that was not ordered."""

    FAILSAFE = "failsafe"
    PILOT = "pilot"


class ModeChanges:
    """The mode of one vehicle, and the signs of its origin. `cause` is that of the last failsafe.

    A sign holds for `evidence_s`. It may come `text_within_s` after the HEARTBEAT with the mode.
    """

    def __init__(self, behaviour: FlightBehaviour, text_within_s: float, evidence_s: float) -> None:
        self.mode: int | None = None
        self.cause = FailsafeCause.OTHER
        self._signs = behaviour.failsafe
        self._text_within_s = text_within_s
        self._evidence_s = evidence_s
        self._text_s = self._critical_s = self._pilot_s = self._sticks_s = self._cause_s = -math.inf
        self._critical = False
        self._channels: tuple[int, ...] = ()
        self._reported: int | None = None  # the mode last reported
        self._unclear_s = math.nan  # since when a mode is shown without a sign

    def begin(self, mode: int | None) -> None:
        """Begin with the mode that was shown last; None: none was."""
        self.mode = mode

    def receive(self, message: Message, unix_s: float) -> None:
        """Take in a message of the vehicle."""
        fields = message.fields
        match message.name:
            case "HEARTBEAT":
                critical = fields.get("system_status", MavState.ACTIVE) in (MavState.CRITICAL, MavState.EMERGENCY)
                if critical and not self._critical:
                    self._critical_s = unix_s
                self._critical = critical
                self.mode = int(fields["custom_mode"])
            case "STATUSTEXT":
                self._hear(str(fields["text"]), unix_s)
            case "RC_CHANNELS":
                now = tuple(int(fields.get(f"chan{n}_raw", 0)) for n in range(1, _CHANNELS + 1))
                pairs = [pair for pair in zip(now, self._channels, strict=False) if not set(pair) & set(_UNUSED)]
                if any(abs(a - b) > _MOVED_US for a, b in pairs):
                    self._sticks_s = unix_s
                self._channels = now

    def excuse(self, seconds: float, unix_s: float) -> None:
        """Let no sign become old in these seconds before `unix_s`: this program did not listen."""
        self._text_s, self._critical_s, self._pilot_s, self._sticks_s, self._cause_s = (
            min(sign_s + seconds, unix_s)
            for sign_s in (self._text_s, self._critical_s, self._pilot_s, self._sticks_s, self._cause_s)
        )

    def settle(self) -> None:
        """Resets mode-change detection: the mode is an ordered one, or about to be."""
        self._reported = None
        self._unclear_s = math.nan

    def origin_of_change(self, unix_s: float) -> ModeOrigin | None:
        """Return what chose a mode that was not ordered, once for every change; None: reported, or not yet clear."""
        if self.mode == self._reported:
            return None
        taken = self._judge(unix_s)
        if taken is None and math.isnan(self._unclear_s):
            self._unclear_s = unix_s
        if taken is None and unix_s - self._unclear_s < self._text_within_s:
            return None
        self.settle()
        self._reported = self.mode
        return taken or ModeOrigin.PILOT

    def _judge(self, unix_s: float) -> ModeOrigin | None:
        recent_s = unix_s - self._evidence_s
        if self._cause_s < recent_s:
            self.cause = FailsafeCause.OTHER
        if self._pilot_s >= recent_s:
            return ModeOrigin.PILOT
        moved = self._sticks_s >= recent_s
        shown = self._text_s >= recent_s and self.mode in self._signs.modes
        if shown and (self._critical or not self._signs.always_critical):
            return ModeOrigin.FAILSAFE
        began = self._signs.always_critical or self._critical_s >= recent_s  # else an earlier failsafe's is still shown
        if self._critical and began and not moved:
            return ModeOrigin.FAILSAFE
        return ModeOrigin.PILOT if moved else None

    def _hear(self, text: str, unix_s: float) -> None:
        if self._signs.pilot(text):
            self._pilot_s = unix_s
        cause = self._signs.cause(text)
        if cause is None:
            return
        self._text_s = unix_s
        if cause is not FailsafeCause.OTHER:  # a general text follows the one with the cause
            self.cause, self._cause_s = cause, unix_s
