"""Watches the links of a flight: a flight ends when vehicles are silent for too long. It tells own standstills."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping

from gcs.aio import LOOK_S
from gcs.errors import FlightError
from gcs.flight.progress import OURSELVES, Step
from gcs.link.session.vehicle_session import VehicleSession
from gcs.steady_loop import stalls_of

STOOD_RULE = "It was stopped, suspended or too busy; nothing counts as silence of vehicles for it"


async def watch_links(
    sessions: Mapping[int, VehicleSession],
    step: Callable[[], Step],
    lost_after_s: float,
    tell: Callable[[int, str, str], None],
) -> None:
    """Raises FlightError as soon as a vehicle has been silent for too long; in flight, as soon as all have.

    `tell` gets each standstill of this program once. In one no vehicle becomes silent: the loop's clock stands too.
    """
    stalls = stalls_of(asyncio.get_running_loop())
    told = stalls.count
    while True:
        await asyncio.sleep(LOOK_S)
        if stalls.count > told:
            told = stalls.count
            tell(OURSELVES, f"stood still for {stalls.last_s:.1f} s", STOOD_RULE)
        silent = {s.sysid: s.silent_s() for s in sessions.values()}
        lost = [sysid for sysid, silent_s in silent.items() if silent_s > lost_after_s]
        if step() in (Step.FLY, Step.LAND) and len(lost) < len(silent):
            continue  # the contingency policy handles this
        if lost:
            lost_words = f"vehicle {lost[0]} was" if len(lost) == 1 else f"vehicles {', '.join(map(str, lost))} were"
            raise FlightError(
                f"{lost_words} lost ({step().value}): no message for {silent[lost[0]]:.1f} s.",
                hint="check it and its link"
                if step() in (Step.READY, Step.UPLOAD)
                else "the others were ordered to land; search for it at its last reported position",
            )
