"""What all machines of one session share: both stations, the autopilot's timers, the round trips measured so far."""

from gcs.autopilots.protocol_timers import STANDARD, ProtocolTimers, RoundTripTimers
from gcs.autopilots.traits import link_behaviour
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import GENERIC_AUTOPILOT

_GAIN, _DEVIATION_GAIN = 1 / 8, 1 / 4
_GROWTH, _MOST_GROWTH = 1.1, 1.3


class RttEstimator:
    """The estimate for one vehicle: `first_s` before the first measurement, then between the two bounds."""

    def __init__(self, timers: RoundTripTimers = STANDARD.round_trip) -> None:
        self._wait_min_s, self._wait_max_s = timers.least_s, timers.most_s
        self._wait_s = timers.first_s
        self._mean_s: float | None = None
        self._deviation_s = 0.0

    @property
    def mean_s(self) -> float | None:
        """The smoothed round trip; None before the first measurement."""
        return self._mean_s

    def learn(self, sample_s: float) -> None:
        """Add one measured round trip."""
        if self._mean_s is None:
            self._mean_s, self._deviation_s = sample_s, sample_s / 2
        else:
            self._deviation_s += _DEVIATION_GAIN * (abs(sample_s - self._mean_s) - self._deviation_s)
            self._mean_s += _GAIN * (sample_s - self._mean_s)
        self._wait_s = self._mean_s + max(4 * self._deviation_s, self._wait_min_s)

    def wait_s(self, repeats: int = 0) -> float:
        """Return the wait after a request that has been repeated `repeats` times."""
        grown_s = self._wait_s * min(_GROWTH ** min(repeats, 9), _MOST_GROWTH)
        return min(max(grown_s, self._wait_min_s), self._wait_max_s)


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
