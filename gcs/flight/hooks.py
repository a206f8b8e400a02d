"""What a flight calls on its way: events, steps, and the question before anything is uploaded."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from gcs.flight.progress import Event, Step


def _ignore(*_: object) -> None:
    pass


@dataclass(frozen=True)
class FlightHooks:
    """What is called during a flight. `on_ready` may raise to stop it before the upload."""

    on_event: Callable[[Event], None] = _ignore
    on_step: Callable[[Step, float | None], None] = _ignore  # the step begun, and T0 once it is known
    on_ready: Callable[[], Awaitable[None]] | None = None
