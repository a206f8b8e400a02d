"""What a flight calls on its way: events, steps, and the question before anything is uploaded.

A log, a screen or a picture that fails does not reach the flight: its first failure is reported, and all are dropped.
"""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import ParamSpec

from gcs.flight.progress import Event, Step

P = ParamSpec("P")


def _log(text: str) -> None:
    logging.getLogger(__name__).error(text)


def spared(call: Callable[P, object], what: str, say: Callable[[str], None] = _log) -> Callable[P, None]:
    """Return `call` without its failures. `say` gets the first: "`what` failed ..."."""
    told = False

    def spare(*arguments: P.args, **named: P.kwargs) -> None:
        nonlocal told
        try:
            call(*arguments, **named)
        except Exception as failure:
            if told:
                return
            told = True
            with suppress(Exception):
                say(f"{what} failed, the flight goes on without it: {type(failure).__name__}: {failure}")

    return spare


def _ignore(*_: object) -> None:
    pass


@dataclass(frozen=True)
class FlightHooks:
    """What is called during a flight. `on_ready` may raise to stop it before the upload."""

    on_event: Callable[[Event], None] = _ignore
    on_step: Callable[[Step, float | None], None] = _ignore  # the step begun, and T0 once it is known
    on_ready: Callable[[], Awaitable[None]] | None = None

    def spared(self) -> FlightHooks:
        """Return the same hooks, without the failures of those that only report."""
        return replace(
            self, on_event=spared(self.on_event, "the report of events"), on_step=spared(self.on_step, "that of steps")
        )
