"""When which fault of one vehicle is in force.

Knows: faults, simulated time as an argument, the moments that times are counted from. Does not know: what a fault does.

A fault counted from take-off comes with every take-off; one counted from an upload with the first that gets so far.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

from sim_bridge.faults.fault_spec import Fault, FaultKind, Since


@dataclass(eq=False)
class Spell:
    """A fault with its times in simulated seconds; `begun` when its time has come."""

    fault: Fault
    from_s: float
    until_s: float
    begun: bool = field(default=False)


class FaultSchedule:
    """The faults of one vehicle. `awaits_takeoff` and `awaits_upload` tell what is worth being told."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._later: list[Fault] = []
        self._spells: list[Spell] = []
        self.due_s = math.inf
        for fault in faults:
            self.add(fault, 0.0)

    @property
    def active(self) -> list[Fault]:
        """What is in force, in the order in which it began."""
        return [spell.fault for spell in self._spells if spell.begun]

    @property
    def awaits_takeoff(self) -> bool:
        """Whether take-offs matter."""
        return any(fault.when.since is Since.TAKEOFF for fault in self._later)

    def awaits_upload(self, item: int) -> bool:
        """Whether the arrival of this item of a mission matters."""
        return any(fault.when.since is Since.UPLOAD and fault.when.item == item for fault in self._later)

    def add(self, fault: Fault, start_s: float) -> None:
        """One more; times since the start count from `start_s`."""
        if fault.when.since is Since.START:
            self._anchor(fault, start_s)
        else:
            self._later.append(fault)

    def took_off(self, t_s: float) -> None:
        """The vehicle left the ground."""
        for fault in self._later:
            if fault.when.since is Since.TAKEOFF:
                self._anchor(fault, t_s)

    def uploaded(self, item: int, t_s: float) -> None:
        """Item number `item` of a mission is coming in."""
        for fault in list(self._later):
            if fault.when.since is Since.UPLOAD and fault.when.item == item:
                self._later.remove(fault)
                self._anchor(fault, t_s)

    def end(self, kinds: Iterable[FaultKind]) -> None:
        """No more faults of these kinds, now or later."""
        ended = set(kinds)
        self._later = [fault for fault in self._later if fault.kind not in ended]
        self._spells = [spell for spell in self._spells if spell.fault.kind not in ended]
        self.due_s = -math.inf

    def step(self, t_s: float) -> list[Fault] | None:
        """What begins at `t_s`; None where nothing begins or ends."""
        if t_s < self.due_s:
            return None
        began = []
        for spell in self._spells:
            if not spell.begun and spell.from_s <= t_s:
                spell.begun = True
                began.append(spell.fault)
        self._spells = [s for s in self._spells if t_s < s.until_s and not (s.begun and s.fault.kind.at_once)]
        edges = (spell.until_s if spell.begun else spell.from_s for spell in self._spells)
        self.due_s = min(edges, default=math.inf)
        return began

    def _anchor(self, fault: Fault, moment_s: float) -> None:
        when = fault.when
        self._spells.append(Spell(fault, moment_s + when.from_s, moment_s + when.until_s))
        self.due_s = -math.inf
