"""Who is told how a flight goes: nobody, unless somebody overrides these.

Knows: what there is to tell. Does not know: screens.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gcs.flight.fly import Flight
    from gcs.flight.preflight import Check


class Watcher:
    """Hears everything and says nothing."""

    @property
    def laps_s(self) -> dict[str, float]:
        """Where the time went, for the report."""
        return {}

    def say(self, text: str) -> None:
        """One line for people."""

    def lap(self, name: str) -> None:
        """This part of the work is done."""

    def checks(self, checks: tuple[Check, ...]) -> None:
        """What the pre-flight found, good or not."""

    async def confirm(self) -> None:
        """All vehicles on a link are fit to fly: may they be armed? Raises `UsageError` for a no."""

    async def follow(self, flight: Flight) -> None:
        """Runs beside the flight until it is cancelled: `flight.snapshot()` tells how it goes."""
