"""The battery that a vehicle has: its own capacity and voltage, and the current that it draws in a hover.

They replace those of `[vehicle.power]` where they are known. The fall of the percentage is no measurement of seconds: a
vehicle without a current sensor has it from the voltage, which sags as soon as the motors turn.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from gcs.link.session.status_report import VehicleReport, reported_V
from gcs.link.wire.message import Message
from gcs.plan.trajectory.energy import BatteryModel
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Power

_CELL_V = 3.7  # nominal, lithium polymer
_CHARGED_CELL_V = 4.35  # no cell has more
_OTHER_BATTERY = (0.87, 1.2)  # of the nominal voltage: outside of it the battery is another one
_LEAST_USE = 1.0 / 3.0  # of the expected current: a sensor that reports less is not believed


@dataclass(frozen=True)
class OwnBattery:
    """One vehicle's battery: the capacity that it is set to, and its nominal voltage. None: not known."""

    capacity_mAh: float | None = None
    nominal_V: float | None = None

    @property
    def full_Wh(self) -> float | None:
        """The energy of the full battery, Wh."""
        if self.capacity_mAh is None or self.nominal_V is None:
            return None
        return self.capacity_mAh * self.nominal_V / 1000.0

    def scale(self, power: Power | None) -> float:
        """Return the factor from shares of the battery of `[vehicle.power]` to shares of this one; 1 if not known."""
        own_Wh = self.full_Wh
        return 1.0 if power is None or own_Wh is None else power.battery_Wh / own_Wh

    def measured_scale(
        self, power: Power | None, model: BatteryModel, current_A: float, voltage_V: float
    ) -> float | None:
        """Return the same factor by the current in hover: measured over modelled use. None: no such measurement.

        With the own capacity Q the use is I / Q, else U I over the energy of `[vehicle.power]`.
        """
        if not current_A > 0.0:
            return None
        if self.capacity_mAh is not None:
            use_per_s = current_A / (3.6 * self.capacity_mAh)
        elif power is not None:
            use_per_s = current_A * voltage_V / (3600.0 * power.battery_Wh)
        else:
            return None
        scale = use_per_s / model.hover_per_s
        return scale if scale >= _LEAST_USE * self.scale(power) else None

    def __str__(self) -> str:
        return "its battery" if self.capacity_mAh is None else f"{self.capacity_mAh:.0f} mAh"


def measured_draw(statuses: Sequence[Message]) -> tuple[float, float]:
    """Return the medians of current, A, and voltage, V, in SYS_STATUS messages; NaN for a voltage that none tells."""
    known_V = [volt for one in statuses if (volt := reported_V(one)) is not None]
    return median(one.fields["current_battery"] for one in statuses) / 100.0, median(known_V or [math.nan])


def own_battery(report: VehicleReport, power: Power | None) -> OwnBattery:
    """Return the battery of a vehicle as it reports it. A capacity of 0 or less is not set on board."""
    own_mAh = report.capacity_mAh
    known = own_mAh is not None and own_mAh > 0.0 and math.isfinite(own_mAh)
    return OwnBattery(own_mAh if known else None, None if power is None else nominal_V(power, report.battery_V))


def nominal_V(power: Power, reported_V: float | None) -> float | None:
    """Return the nominal voltage of a battery: that of `[vehicle.power]` if the reported voltage can be of it.

    Otherwise 3.7 V for each cell that a charged battery of the reported voltage has.
    """
    if reported_V is None or not reported_V > 0.0:
        return power.battery_V
    low, high = _OTHER_BATTERY
    if power.battery_V is not None and low <= reported_V / power.battery_V <= high:
        return power.battery_V
    return _CELL_V * math.ceil(reported_V / _CHARGED_CELL_V)


@dataclass(frozen=True)
class ChargeRule:
    """The charge that every vehicle must have left at the end, share of a full battery, and what they fly with.

    `effort` is the energy for climbs and wind over that of hover, where the model has hover alone.
    """

    reserve: float
    effort: float
    batteries: Mapping[int, OwnBattery]  # by vehicle

    def left_at_end(self, plan: Plan, model: BatteryModel, sysid: int, left: float, scale: float) -> float:
        """Return the share left after the plan of a vehicle that has `left` in the hover before T0."""
        need = model.planned_use(plan.sysids.index(sysid), plan.airborne_s, plan.t_end_s)
        return left - scale * need * (self.effort if model.full_J is None else 1.0)
