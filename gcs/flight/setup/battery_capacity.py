"""Compares the battery capacity that a vehicle is set to with that of `[vehicle.power]`."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gcs.link.session.status_report import VehicleReport
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.preflight_table import PreflightTable
from gcs.scenario.schema.scenario import Power

_CELL_V = 3.7  # nominal, lithium polymer
_CHARGED_CELL_V = 4.35  # no cell has more


@dataclass(frozen=True)
class CapacityComparison:
    """What was found, and what to do if the two differ. Without a value on either side nothing is compared."""

    text: str
    warning: str = ""


def nominal_V(power: Power, reported_V: float | None) -> float | None:
    """Return the nominal voltage of a battery: its own, else 3.7 V for each cell of a charged one that reports."""
    if power.battery_V is not None:
        return power.battery_V
    if reported_V is None or not reported_V > 0.0:
        return None
    return _CELL_V * math.ceil(reported_V / _CHARGED_CELL_V)


def compare_capacity(report: VehicleReport, power: Power | None, tolerance: float) -> CapacityComparison:
    """Return the comparison for one vehicle."""
    name, own_mAh = report.capacity_parameter, report.capacity_mAh
    if name is None or own_mAh is None:
        return CapacityComparison("not reported")
    if not own_mAh > 0.0:
        return CapacityComparison(f"not set on board ({name} is {own_mAh:g})")
    volt = None if power is None else nominal_V(power, report.battery_V)
    if power is None or volt is None:
        return CapacityComparison(f"{own_mAh:.0f} mAh")
    planned_mAh = 1000.0 * power.battery_Wh / volt
    if abs(own_mAh - planned_mAh) <= tolerance * planned_mAh:
        return CapacityComparison(f"{own_mAh:.0f} mAh")
    known = f"{planned_mAh:.0f} mAh ({power.battery_Wh:g} Wh at {volt:g} V)"
    return CapacityComparison(
        f"{own_mAh:.0f} mAh",
        f"{name} is {own_mAh:.0f} mAh, [vehicle.power] has {known}: its charge in percent is not "
        "that of the plan. Set both to the battery that flies",
    )


def capacity_required(plan: Plan, limits: PreflightTable) -> str:
    """Return the capacity of the scenario, as far as it is known without a vehicle."""
    power = plan.scenario.vehicle.power
    if power is None:
        return "any: no [vehicle.power]"
    if power.battery_V is None:
        return f"{power.battery_Wh:g} Wh"
    return f"{1000.0 * power.battery_Wh / power.battery_V:.0f} mAh ± {limits.capacity_tolerance:.0%}"
