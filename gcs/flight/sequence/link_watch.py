"""Watches the links of a flight: a flight ends when vehicles are silent for too long."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping

from gcs.aio import LOOK_S
from gcs.errors import FlightError
from gcs.flight.progress import Step
from gcs.link.session.vehicle_session import VehicleSession


async def watch_links(sessions: Mapping[int, VehicleSession], step: Callable[[], Step], lost_after_s: float) -> None:
    """Raises FlightError as soon as a vehicle has been silent for too long; in flight, as soon as all have."""
    while True:
        await asyncio.sleep(LOOK_S)
        silent = {s.sysid: s.heartbeat_age_s() for s in sessions.values()}
        lost = [sysid for sysid, silent_s in silent.items() if silent_s > lost_after_s]
        if step() in (Step.FLY, Step.LAND) and len(lost) < len(silent):
            continue  # the contingency policy handles this
        if lost:
            lost_words = f"vehicle {lost[0]} was" if len(lost) == 1 else f"vehicles {', '.join(map(str, lost))} were"
            raise FlightError(
                f"{lost_words} lost ({step().value}): no heartbeat for {silent[lost[0]]:.1f} s.",
                hint="the others were ordered to land; search for it at its last reported position",
            )
