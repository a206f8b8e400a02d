"""Unknown systems on a link: counted, reported once, and limited in their cost. Time is an argument.

The budget is for addresses where no vehicle of the flight is. What exceeds it is dropped unread, so that a flood from
there costs the price of receiving it.
"""

from typing import NamedTuple

from gcs.link.session.routing_table import LinkAddress

_REPORT_AFTER_S = 1.0  # so that the number reported is that of a flood, not of its first datagram
_PARSED_BPS, _PARSED_BURST = 200_000, 64_000  # bytes: some hundred vehicles that begin to send
_LOGGED_BPS, _LOGGED_BURST = 2_000, 64_000


class LinkNotice(NamedTuple):
    """A text for the operator about one system, or about the links: `system` 0."""

    system: int
    text: str


class ByteBudget:
    """A limit of bytes per second, of which `burst` may come at once."""

    def __init__(self, rate_Bps: float, burst: float) -> None:
        self._rate_Bps = rate_Bps
        self._burst = burst
        self._left = burst
        self._at_s = 0.0

    def take(self, size: int, now_s: float) -> bool:
        """Whether `size` bytes may be spent now. What exceeds the budget is missing later."""
        self._left = min(self._left + self._rate_Bps * max(now_s - self._at_s, 0.0), self._burst)
        self._at_s = now_s
        if self._left <= 0.0:
            return False
        self._left -= size
        return True


class UnknownSystems:
    """The systems that are not in the flight, and the addresses that no vehicle is at."""

    def __init__(self) -> None:
        self.systems: set[int] = set()
        self.dropped = 0  # datagrams, unread
        self._parsed = ByteBudget(_PARSED_BPS, _PARSED_BURST)
        self._logged = ByteBudget(_LOGGED_BPS, _LOGGED_BURST)
        self._first: tuple[int, LinkAddress, float] | None = None  # system, its address, when
        self._first_dropped: tuple[LinkAddress, float] | None = None
        self._systems_reported = self._flood_reported = False

    def admits(self, size: int, address: LinkAddress, now_s: float) -> bool:
        """Whether to read `size` bytes of an address where no vehicle is."""
        if self._parsed.take(size, now_s):
            return True
        self.dropped += 1
        if self._first_dropped is None:
            self._first_dropped = address, now_s
        return False

    def logs(self, size: int, now_s: float) -> bool:
        """Whether to log a frame of a system that is not in the flight."""
        return self._logged.take(size, now_s)

    def note(self, system: int, address: LinkAddress, now_s: float) -> None:
        """Record the heartbeat of a vehicle that is not in the flight."""
        self.systems.add(system)
        if self._first is None:
            self._first = system, address, now_s

    def notices(self, now_s: float) -> list[str]:
        """Return the texts for the operator that are due, each once."""
        found = []
        if self._first is not None and now_s - self._first[2] > _REPORT_AFTER_S and not self._systems_reported:
            self._systems_reported = True
            system, address, _ = self._first
            count = len(self.systems)
            heard = f"{count} systems that are" if count > 1 else f"system {system}, which is"
            first = f"first system {system} at {address}" if count > 1 else f"at {address}"
            found.append(f"heard {heard} not in the plan, {first}: ignored")
        if self._first_dropped and now_s - self._first_dropped[1] > _REPORT_AFTER_S and not self._flood_reported:
            self._flood_reported = True
            found.append(
                f"{self.dropped} datagrams from addresses without a vehicle were dropped unread, the first from "
                f"{self._first_dropped[0]}: more arrives than vehicles send"
            )
        return found
