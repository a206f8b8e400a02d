"""The active faults of one vehicle over simulated time.

A fault timed from take-off begins with every take-off. One timed from an upload begins with the first upload that
reaches its item.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

from sim_bridge.faults.fault_spec import Fault, FaultKind, Since


@dataclass(eq=False)
class ScheduledFault:
    """A fault with its times in simulated seconds; `begun` once it is active."""

    fault: Fault
    from_s: float
    until_s: float
    begun: bool = field(default=False)


class FaultSchedule:
    """The faults of one vehicle. `awaits_takeoff` and `awaits_upload` say which events it needs."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._later: list[Fault] = []
        self._scheduled: list[ScheduledFault] = []
        self.due_s = math.inf
        for fault in faults:
            self.add(fault, 0.0)

    @property
    def active(self) -> list[Fault]:
        """The active faults, in the order in which they began."""
        return [scheduled.fault for scheduled in self._scheduled if scheduled.begun]

    @property
    def awaits_takeoff(self) -> bool:
        """Whether a fault is timed from take-off."""
        return any(fault.when.since is Since.TAKEOFF for fault in self._later)

    def awaits_upload(self, item: int) -> bool:
        """Whether a fault is timed from the arrival of this item."""
        return any(fault.when.since is Since.UPLOAD and fault.when.item == item for fault in self._later)

    def add(self, fault: Fault, start_s: float) -> None:
        """Add a fault; times since the start count from `start_s`."""
        if fault.when.since is Since.START:
            self._anchor(fault, start_s)
        else:
            self._later.append(fault)

    def took_off(self, t_s: float) -> None:
        """Record a take-off."""
        for fault in self._later:
            if fault.when.since is Since.TAKEOFF:
                self._anchor(fault, t_s)

    def uploaded(self, item: int, t_s: float) -> None:
        """Record that item number `item` of an upload arrives."""
        for fault in list(self._later):
            if fault.when.since is Since.UPLOAD and fault.when.item == item:
                self._later.remove(fault)
                self._anchor(fault, t_s)

    def end(self, kinds: Iterable[FaultKind]) -> None:
        """End all faults of these kinds, present and future."""
        ended = set(kinds)
        self._later = [fault for fault in self._later if fault.kind not in ended]
        self._scheduled = [scheduled for scheduled in self._scheduled if scheduled.fault.kind not in ended]
        self.due_s = -math.inf

    def step(self, t_s: float) -> list[Fault] | None:
        """Return the faults that begin at `t_s`; None if no fault begins or ends."""
        if t_s < self.due_s:
            return None
        began = []
        for scheduled in self._scheduled:
            if not scheduled.begun and scheduled.from_s <= t_s:
                scheduled.begun = True
                began.append(scheduled.fault)
        self._scheduled = [s for s in self._scheduled if t_s < s.until_s and not (s.begun and s.fault.kind.at_once)]
        edges = (scheduled.until_s if scheduled.begun else scheduled.from_s for scheduled in self._scheduled)
        self.due_s = min(edges, default=math.inf)
        return began

    def _anchor(self, fault: Fault, moment_s: float) -> None:
        when = fault.when
        self._scheduled.append(ScheduledFault(fault, moment_s + when.from_s, moment_s + when.until_s))
        self.due_s = -math.inf
