"""What all machines of one session share: both stations, the autopilot's timers, the round trips measured so far."""

from __future__ import annotations

from gcs.autopilots.protocol_timers import ProtocolTimers
from gcs.autopilots.traits import link_behaviour
from gcs.link.protocols.rtt import RttEstimator
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import GENERIC_AUTOPILOT

_SEQS, _SESSIONS = 0x10000, 255
_BURST_MAX = 4096


class FtpNumbers:
    """The last sequence and session numbers of the requests of MAVLink FTP to one vehicle."""

    def __init__(self, seq: int = 0, session: int = 0) -> None:
        self._seq, self._session = seq % _SEQS, session % _SESSIONS

    def next_seq(self) -> int:
        """Return the number of the next request."""
        self._seq = (self._seq + 1) % _SEQS
        return self._seq

    def skip(self) -> None:
        """Skip the numbers of a burst: ArduPilot detects repeated requests by the number of its last reply."""
        self._seq = (self._seq + _BURST_MAX) % _SEQS

    def next_session(self) -> int:
        """Return the session of the next file, 1 to 255. Servers use it, or answer with a number of their own."""
        self._session = self._session % _SESSIONS + 1
        return self._session


class Exchange:
    """The station `me` talks with the station `peer`, whose MAV_AUTOPILOT is `autopilot`.

    `timers` replace those of the autopilot. A vehicle's side may do without `estimates` of the round trip: it then
    repeats as the MAVLink guide says.
    """

    def __init__(
        self,
        peer: Station,
        autopilot: int = GENERIC_AUTOPILOT,
        *,
        me: Station = GROUND,
        timers: ProtocolTimers | None = None,
        round_trip: RttEstimator | None = None,
        estimates: bool = True,
        numbers: FtpNumbers | None = None,
    ) -> None:
        self.peer = peer
        self.me = me
        self.autopilot = autopilot
        self.link = link_behaviour(autopilot)
        self.timers = timers or self.link.timers
        self.round_trip = round_trip or RttEstimator(self.timers.round_trip)
        self.estimates = estimates
        self.numbers = numbers or FtpNumbers()

    def hears(self, message: Message) -> bool:
        """Whether the peer sent it, to us or to no station."""
        return message.comes_from(self.peer) and message.is_for(self.me)
