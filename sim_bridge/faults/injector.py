"""Brings faults about: what is in force now becomes trouble on links, breakage of bodies, and orders to vehicles.

Knows: every kind of fault and who has to suffer for it. Does not know: when faults begin (that is `FaultSchedule`),
how links and bodies fail.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from sim_bridge.dynamics.body.airframes import Airframes
from sim_bridge.dynamics.body.failures import (
    Failure,
    GnssJump,
    GnssOutage,
    LowBattery,
    MotorLoss,
    Push,
    Sensor,
    Slow,
    StuckSensor,
    WindStep,
)
from sim_bridge.faults import fault_spec as f
from sim_bridge.faults.fault_spec import Fault, FaultKind, LinkDirection
from sim_bridge.faults.lossy_link import NO_TROUBLE, LossyLink, Trouble
from sim_bridge.faults.schedule import FaultSchedule
from sim_bridge.protocol.conversation import Conversation

_UP, _DOWN = 0, 1  # in the links' seeds
_LINK_SEED = 2  # apart from the seeds of sensors and clocks


class Radio:
    """Both directions of one vehicle's link."""

    def __init__(self, seed: int, sysid: int) -> None:
        self.up = LossyLink(seed, _LINK_SEED, sysid, _UP)
        self.down = LossyLink(seed, _LINK_SEED, sysid, _DOWN)


_TROUBLE: dict[FaultKind, Callable[[Trouble, Sequence[float]], Trouble]] = {
    f.LOSS: lambda trouble, v: replace(trouble, loss=v[0]),
    f.DUPLICATE: lambda trouble, v: replace(trouble, duplicate=v[0]),
    f.REORDER: lambda trouble, v: replace(trouble, reorder=v[0]),
    f.CORRUPT: lambda trouble, v: replace(trouble, corrupt=v[0]),
    f.DELAY: lambda trouble, v: replace(trouble, delay_s=v[0], jitter_s=v[1]),
    f.SILENT: lambda trouble, v: replace(trouble, loss=1.0),
}

_BREAKDOWN: dict[FaultKind, Callable[[float, Sequence[float]], Failure]] = {
    f.GNSS_OUTAGE: lambda t_s, v: GnssOutage(from_s=t_s),
    f.GNSS_JUMP: lambda t_s, v: GnssJump(from_s=t_s, offset_ned_m=(v[0], v[1], v[2])),
    f.MOTOR: lambda t_s, v: MotorLoss(from_s=t_s, motor=round(v[0]), share=v[1]),
    f.BATTERY: lambda t_s, v: LowBattery(from_s=t_s, remaining=v[0]),
    f.STUCK: lambda t_s, v: StuckSensor(from_s=t_s, sensor=Sensor(round(v[0]))),
    f.SLOW: lambda t_s, v: Slow(from_s=t_s, speed_mps=v[0]),
    f.WIND: lambda t_s, v: WindStep(from_s=t_s, wind_ned_mps=(v[0], v[1], v[2])),
    f.PUSH: lambda t_s, v: Push(from_s=t_s, push_ned_mps2=(v[0], v[1], v[2])),
}


@dataclass
class _Patient:
    """One vehicle with faults."""

    agenda: FaultSchedule
    flying: bool = False
    broken: dict[int, Failure] = field(default_factory=dict)  # by identity of the fault


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
        """`faults` by system id; rows follow the order of `vehicles`, whose members may be replaced."""
        self._vehicles = vehicles
        self._airframes = airframes
        self._seed = seed
        self._reboot = reboot
        self._patients: dict[int, _Patient] = {}
        self.radios: dict[int, Radio] = {}  # of those whose link is not to be relied on
        for row, vehicle in enumerate(vehicles):
            for fault in faults.get(vehicle.station.sysid, ()):
                self.add(row, fault, 0.0)

    def add(self, row: int, fault: Fault, t_s: float) -> None:
        """One more fault; its times count from now unless it names another moment."""
        if row not in self._patients:
            self._patients[row] = _Patient(FaultSchedule(()))
        if fault.kind.directed and row not in self.radios:
            self.radios[row] = Radio(self._seed, self._vehicles[row].station.sysid)
        self._patients[row].agenda.add(fault, t_s)
        self._go_on(row, self._patients[row], t_s)

    def end(self, row: int, kinds: Sequence[FaultKind], t_s: float) -> None:
        """End the faults of these kinds, those to come included. What died stays dead."""
        if row in self._patients:
            self._patients[row].agenda.end(kinds)
            self._go_on(row, self._patients[row], t_s)

    def uploaded(self, row: int, item: int, t_s: float) -> None:
        """An item of a mission is about to reach the vehicle."""
        patient = self._patients.get(row)
        if patient is not None and patient.agenda.awaits_upload(item):
            patient.agenda.uploaded(item, t_s)
            self._go_on(row, patient, t_s)

    def step(self, t_s: float) -> None:
        """Let begin and end what has come to its time."""
        for row, patient in self._patients.items():
            flying = self._vehicles[row].autopilot.flying
            if flying and not patient.flying:
                patient.agenda.took_off(t_s)
            patient.flying = flying
            self._go_on(row, patient, t_s)

    def _go_on(self, row: int, patient: _Patient, t_s: float) -> None:
        began = patient.agenda.step(t_s)
        if began is None:
            return
        active = patient.agenda.active
        vehicle = self._vehicles[row]
        vehicle.rejects_missions = any(fault.kind is f.REJECT_MISSION for fault in active)
        if row in self.radios:
            radio = self.radios[row]
            radio.up.trouble = _trouble(active, LinkDirection.UP)
            radio.down.trouble = _trouble(active, LinkDirection.DOWN)
        self._break(row, patient, active, t_s)
        for fault in began:
            if fault.kind is f.DIE:
                vehicle.die()
            elif fault.kind is f.REBOOT:
                self._reboot(row)

    def _break(self, row: int, patient: _Patient, active: Sequence[Fault], t_s: float) -> None:
        broken = {
            id(fault): patient.broken.get(id(fault)) or _BREAKDOWN[fault.kind](t_s, fault.values)
            for fault in active
            if fault.kind in _BREAKDOWN
        }
        if broken.keys() != patient.broken.keys():
            schedule = self._airframes.faults[row]
            schedule.clear()
            for breakdown in broken.values():
                schedule.add(breakdown)
            patient.broken = broken


def _trouble(active: Sequence[Fault], direction: LinkDirection) -> Trouble:
    trouble = NO_TROUBLE
    for fault in active:
        if fault.kind in _TROUBLE and fault.direction in (LinkDirection.BOTH, direction):
            trouble = _TROUBLE[fault.kind](trouble, fault.values)
    return trouble
