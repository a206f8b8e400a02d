"""Applies active faults: to links, to the physics of the vehicles, and to their autopilots.

`FaultSchedule` decides when a fault is active.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from sim_bridge.dynamics.airframes import Airframes
from sim_bridge.dynamics.failures import Failure, Sensor
from sim_bridge.faults import fault_spec as f
from sim_bridge.faults.fault_spec import Fault, FaultKind, LinkDirection, Since
from sim_bridge.faults.lossy_link import NO_IMPAIRMENT, LinkImpairment, LossyLink
from sim_bridge.protocol.conversation import Conversation, VehicleFaults

_UP, _DOWN = 0, 1  # last part of the link seeds
_LINK_SEED = 2  # keeps link seeds apart from those of sensors and clocks


class Radio:
    """Both directions of the link of one vehicle."""

    def __init__(self, seed: int, sysid: int) -> None:
        self.up = LossyLink(seed, _LINK_SEED, sysid, _UP)
        self.down = LossyLink(seed, _LINK_SEED, sysid, _DOWN)


_IMPAIRMENT_OF: dict[FaultKind, Callable[[LinkImpairment, Sequence[float]], LinkImpairment]] = {
    f.LOSS: lambda impairment, v: replace(impairment, loss=v[0]),
    f.DUPLICATE: lambda impairment, v: replace(impairment, duplicate=v[0]),
    f.REORDER: lambda impairment, v: replace(impairment, reorder=v[0]),
    f.CORRUPT: lambda impairment, v: replace(impairment, corrupt=v[0]),
    f.DELAY: lambda impairment, v: replace(impairment, delay_s=v[0], jitter_s=v[1]),
    f.SILENT: lambda impairment, v: replace(impairment, loss=1.0),
}

_FAILURE_OF: dict[FaultKind, Callable[[Sequence[float]], Failure]] = {
    f.GNSS_OUTAGE: lambda v: Failure(gnss_lost=True),
    f.GNSS_JUMP: lambda v: Failure(offset_ned_m=(v[0], v[1], v[2])),
    f.MOTOR: lambda v: Failure(motor=round(v[0]), share=v[1]),
    f.BATTERY: lambda v: Failure(remaining=v[0]),
    f.STUCK: lambda v: Failure(sensor=Sensor(round(v[0]))),
    f.SLOW: lambda v: Failure(speed_mps=v[0]),
    f.WIND: lambda v: Failure(wind_ned_mps=(v[0], v[1], v[2])),
    f.PUSH: lambda v: Failure(push_ned_mps2=(v[0], v[1], v[2])),
}


class FaultInjector:
    """The faults of a fleet, by row. `reboot` restarts the autopilot of a row."""

    def __init__(
        self,
        vehicles: Sequence[Conversation],
        airframes: Airframes,
        faults: Mapping[int, Sequence[Fault]],
        seed: int,
        reboot: Callable[[int], None],
    ) -> None:
        """`faults` are given by system id; rows follow the order of `vehicles`, whose members may be replaced."""
        self._vehicles = vehicles
        self._airframes = airframes
        self._seed = seed
        self._reboot = reboot
        self._by_row: dict[int, FaultSchedule] = {}
        self.radios: dict[int, Radio] = {}  # only of vehicles with link faults
        for row, vehicle in enumerate(vehicles):
            for fault in faults.get(vehicle.station.sysid, ()):
                self.add(row, fault, 0.0)

    def add(self, row: int, fault: Fault, t_s: float) -> None:
        """Add a fault; its times count from now unless it names another event."""
        if fault.kind.directed and row not in self.radios:
            self.radios[row] = Radio(self._seed, self._vehicles[row].station.sysid)
        self._by_row.setdefault(row, FaultSchedule()).add(fault, t_s)
        self._update(row, t_s)

    def end(self, row: int, kinds: Sequence[FaultKind], t_s: float) -> None:
        """End all active and future faults of these kinds. A vehicle that died stays dead."""
        if row in self._by_row:
            self._by_row[row].end(kinds)
            self._update(row, t_s)

    def uploaded(self, row: int, item: int, t_s: float) -> None:
        """Report that an item of an upload is about to reach the vehicle."""
        if row in self._by_row and self._by_row[row].awaits_upload(item):
            self._by_row[row].uploaded(item, t_s)
            self._update(row, t_s)

    def step(self, t_s: float) -> None:
        """Begin and end faults whose time has come."""
        for row, schedule in self._by_row.items():
            schedule.flies(self._vehicles[row].autopilot.flying, t_s)
            self._update(row, t_s)

    def _update(self, row: int, t_s: float) -> None:
        began = self._by_row[row].step(t_s)
        if began is None:
            return
        active = self._by_row[row].active
        vehicle = self._vehicles[row]
        kinds = {fault.kind for fault in active}
        vehicle.suffer(
            VehicleFaults(
                rejects_missions=f.REJECT_MISSION in kinds,
                wrong_checksums=f.WRONG_CRC in kinds,
                refuses_commands=f.REFUSE in kinds,
                ignores_commands=f.IGNORE in kinds,
                refuses_arming=f.REFUSE_ARMING in kinds,
                fails_checks=f.FAIL_CHECKS in kinds,
                slow_down=next((round(one.values[0]) for one in reversed(active) if one.kind is f.SLOW_DOWN), None),
                sag_V=sum(fault.values[0] for fault in active if fault.kind is f.SAG),
                gnss_ahead_s=sum(fault.values[0] for fault in active if fault.kind is f.CLOCK_JUMP),
            )
        )
        if row in self.radios:
            radio = self.radios[row]
            radio.up.impair(_impairment(active, LinkDirection.UP))
            radio.down.impair(_impairment(active, LinkDirection.DOWN))
        failures = [_FAILURE_OF[fault.kind](fault.values) for fault in active if fault.kind in _FAILURE_OF]
        self._airframes.fail(row, failures)
        for fault in began:
            if fault.kind is f.DIE:
                vehicle.die()
            elif fault.kind is f.REBOOT:
                self._reboot(row)


def _impairment(active: Sequence[Fault], direction: LinkDirection) -> LinkImpairment:
    impairment = NO_IMPAIRMENT
    for fault in active:
        if fault.kind in _IMPAIRMENT_OF and fault.direction in (LinkDirection.BOTH, direction):
            impairment = _IMPAIRMENT_OF[fault.kind](impairment, fault.values)
    return impairment


@dataclass(eq=False)
class ScheduledFault:
    """A fault with its times in simulated seconds; `begun` once it is active."""

    fault: Fault
    from_s: float
    until_s: float
    begun: bool = field(default=False)


class FaultSchedule:
    """The active faults of one vehicle over simulated time.

    A fault timed from take-off begins with every take-off. One timed from an upload begins with the first upload that
    reaches its item.
    """

    def __init__(self) -> None:
        self._flying = False
        self._later: list[Fault] = []
        self._scheduled: list[ScheduledFault] = []
        self.due_s = math.inf

    @property
    def active(self) -> list[Fault]:
        """The active faults, in the order in which they began."""
        return [scheduled.fault for scheduled in self._scheduled if scheduled.begun]

    def awaits_upload(self, item: int) -> bool:
        """Whether a fault is timed from the arrival of this item."""
        return any(fault.when.since is Since.UPLOAD and fault.when.item == item for fault in self._later)

    def add(self, fault: Fault, start_s: float) -> None:
        """Add a fault; times since the start count from `start_s`."""
        if fault.when.since is Since.START:
            self._anchor(fault, start_s)
        else:
            self._later.append(fault)

    def flies(self, flying: bool, t_s: float) -> None:
        """Record whether the vehicle flies now."""
        for fault in self._later if flying and not self._flying else ():
            if fault.when.since is Since.TAKEOFF:
                self._anchor(fault, t_s)
        self._flying = flying

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
