"""Orders in a crisis, repeated with growing pauses until they are carried out. Time is an argument.

An order ends when the vehicle shows the ordered mode, has landed, or is out of reach. What was refused or not answered
stays known to the end of the flight. A planned landing is repeated too; it failed only if nothing came of it.
"""

from dataclasses import dataclass, field, replace

FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 20.0


@dataclass(frozen=True)
class FailedOrder:
    """An order that a vehicle refused or did not answer. `attempts`: how often it was given in vain."""

    sysid: int
    what: str
    reason: str
    attempts: int
    planned: bool  # by the plan, not in a crisis
    carried_out: bool = False  # by a later repetition

    def __str__(self) -> str:
        times = "once" if self.attempts == 1 else f"{self.attempts} times"
        end = "; a repetition was carried out" if self.carried_out else ""
        return f"vehicle {self.sysid} did not {self.what} when ordered {times} ({self.reason}{end})"


@dataclass
class StandingOrder:
    """One order to one vehicle. `due_s` is the local time of the next attempt."""

    sysid: int
    what: str
    due_s: float
    planned: bool
    attempts: int = 0
    reason: str = ""
    _pause_s: float = field(default=FIRST_PAUSE_S)

    def wait_s(self, now_s: float) -> float:
        """Return how long to wait before the next attempt."""
        return max(self.due_s - now_s, 0.0)

    def failed(self, now_s: float, reason: str) -> None:
        """Take in an attempt that was refused or not answered."""
        self.attempts += 1
        self.reason = reason
        self.due_s = now_s + self._pause_s
        self._pause_s = min(2.0 * self._pause_s, LONGEST_PAUSE_S)


class OrderBook:
    """The standing orders of a fleet: a new order to a vehicle replaces the one before."""

    def __init__(self) -> None:
        self._orders: dict[int, StandingOrder] = {}
        self._failed: dict[tuple[int, str], FailedOrder] = {}

    def give(self, sysid: int, what: str, now_s: float, *, planned: bool = False) -> StandingOrder:
        """Begin an order, due at once."""
        order = StandingOrder(sysid, what, now_s, planned)
        self._orders[sysid] = order
        return order

    def stands(self, order: StandingOrder) -> bool:
        """Whether an order was neither replaced nor ended."""
        return self._orders.get(order.sysid) is order

    def has(self, sysid: int) -> bool:
        """Whether an order to this vehicle stands."""
        return sysid in self._orders

    def note_failure(self, order: StandingOrder, now_s: float, reason: str) -> None:
        """Take in an attempt that failed."""
        order.failed(now_s, reason)
        self._failed[order.sysid, order.what] = FailedOrder(
            order.sysid, order.what, reason, order.attempts, order.planned
        )

    def carried_out(self, order: StandingOrder) -> None:
        """Note that the vehicle did what the order asked: the order ends."""
        if self.stands(order):
            self.end(order.sysid)
        if order.planned:
            self._failed.pop((order.sysid, order.what), None)
        before = self._failed.get((order.sysid, order.what))
        if before is not None:
            self._failed[order.sysid, order.what] = replace(before, carried_out=True, planned=False)

    def end(self, sysid: int) -> None:
        """End the order to a vehicle: it has landed, is out of reach, or a pilot flies it."""
        self._orders.pop(sysid, None)

    @property
    def failed(self) -> tuple[FailedOrder, ...]:
        """Every order that failed at least once."""
        return tuple(self._failed.values())
