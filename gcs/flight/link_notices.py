"""What the links have to tell, as events of a flight: strangers, claimed system ids, vehicles at new addresses."""

from __future__ import annotations

import math
from collections.abc import Mapping

from gcs.flight.progress import OURSELVES, Event
from gcs.link.routing.strangers import LinkNotice

_RULE = "Only the vehicles of the plan are listened to, each at its own address"


def notice_event(
    notice: LinkNotice, systems: Mapping[int, int], unix_s: float | None, t0_unix_s: float | None
) -> Event:
    """Return the event of a notice. `systems` are the MAVLink systems of vehicles that differ from their numbers."""
    vehicle_of = {system: sysid for sysid, system in systems.items()}
    now_s = math.nan if unix_s is None else unix_s
    t_s = math.nan if t0_unix_s is None else now_s - t0_unix_s
    sysid = vehicle_of.get(notice.system, notice.system) if notice.system else OURSELVES
    return Event(now_s, t_s, sysid, notice.text, _RULE)
