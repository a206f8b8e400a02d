"""The vehicles that this process armed or took up. It brings these down, and orders no other vehicle to land.

A vehicle that a pilot or another ground station armed is theirs: it is never taken.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from gcs.errors import FlightError
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.message import Message


class Custody:
    """The vehicles of `sessions` (by system id) that this process has to bring down: none, until it takes them."""

    def __init__(self, sessions: Mapping[int, VehicleSession]) -> None:
        self._sessions = sessions
        self._seen_armed: dict[int, bool] = {}  # of those taken
        self._stops: list[Callable[[], None]] = []

    def take_to_arm(self, sysid: int) -> None:
        """Take a vehicle before the first order to it leaves: its answer may be lost. Raises `FlightError`."""
        self.refuse_armed([sysid])
        self._take(sysid)

    def take_up(self) -> None:
        """Take the vehicles that are in the air: the operator ordered to continue a flight that was left.

        One that is not heard yet may be there too.
        """
        for sysid, session in self._sessions.items():
            if session.armed or not session.heard:
                self._take(sysid)

    def holds(self, sysid: int) -> bool:
        """Whether a vehicle was taken."""
        return sysid in self._seen_armed

    def may_be_up(self, sysid: int) -> bool:
        """Whether a vehicle was taken and may be armed. After an order to arm, its HEARTBEAT may not say so yet."""
        return self.holds(sysid) and (self._sessions[sysid].armed or not self._seen_armed[sysid])

    def refuse_armed(self, sysids: list[int] | None = None) -> None:
        """Raises `FlightError` if one of these vehicles, or any, is armed and was not taken."""
        asked = self._sessions if sysids is None else sysids
        if foreign := [i for i in asked if self._sessions[i].armed and not self.holds(i)]:
            named = f"vehicle{'s' if len(foreign) > 1 else ''} {', '.join(map(str, foreign))}"
            raise FlightError(
                f"{named} armed, and not by this flight.",
                hint="it got no order: leave it to its pilot or ground station until it is disarmed, then fly again; "
                "`--waive disarmed` does not change whose it is",
            )

    def close(self) -> None:
        """Listen no more."""
        for stop in self._stops:
            stop()
        self._stops.clear()

    def _take(self, sysid: int) -> None:
        session = self._sessions[sysid]
        self._seen_armed.setdefault(sysid, session.armed)

        def receive(message: Message) -> None:
            if message.name == "HEARTBEAT" and session.armed:
                self._seen_armed[sysid] = True

        self._stops.append(session.subscribe(receive))
