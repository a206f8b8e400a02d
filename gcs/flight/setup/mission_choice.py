"""Which missions a flight uploads, and who flies their waypoints.

Knows: modes, navigators of emulated vehicles, when a scenario is content with a prediction. Does not know: how missions
are made, how they are flown.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from gcs.flight.options import FlightMode
from gcs.mission.export.export import export
from gcs.mission.export.index import ExportIndex
from gcs.mission.formats.registry import DEFAULT
from gcs.mission.predicted.timing import Timing
from gcs.plan.trajectory.plan import Plan

IDEAL, OWN, AUTO = "ideal", "own", "auto"
NAVIGATORS = (AUTO, OWN, IDEAL)
_SHARE = 0.5  # of what the judge allows may be lost by the autopilot; sensors and wind take the rest


@dataclass(frozen=True)
class TimeKeeping:
    """How a flight's missions are to keep time: `navigator` is that of emulated vehicles."""

    mode: FlightMode
    emulated: bool
    navigator: str = AUTO
    gates: int = 0


def export_for_flight(
    plan: Plan, folder: Path, keeping: TimeKeeping, say: Callable[[str], None]
) -> tuple[ExportIndex, str]:
    """Export what will be uploaded; returns the index and the navigator of emulated vehicles.

    Streams need no corrected speeds, and ideal vehicles keep the plan's own. Raises `VerificationError` where vehicles
    that fly by themselves may come too near to each other.
    """
    if keeping.mode is FlightMode.STREAM or (keeping.emulated and keeping.navigator == IDEAL):
        return export(plan, folder, timed=False), IDEAL
    start_s = 0 if keeping.gates else None  # the common start is known when all are ready
    if not keeping.emulated or keeping.navigator == OWN:
        return export(plan, folder, formats=DEFAULT, gates=keeping.gates, start_s=start_s), OWN
    index = export(plan, folder, gates=keeping.gates, start_s=start_s)
    why = index.refused or (_discontent(plan, index.timing) if index.timing else "")
    if not why or keeping.gates:
        return index, OWN
    say(f"emulated vehicles keep the plan's own speeds (--nav ideal): {why}")
    return export(plan, folder, timed=False), IDEAL


def _discontent(plan: Plan, timing: Timing) -> str:
    """Why the judge would not be content with a flight as predicted; empty if he would."""
    asked = plan.scenario.judge
    worst = max(timing.vehicles, key=lambda vehicle: vehicle.error_rms_m)
    if worst.error_rms_m > _SHARE * asked.position_rms_m:
        return (
            f"flown as by its autopilot, vehicle {worst.sysid} would be {worst.error_rms_m:.2f} m from the plan (RMS); "
            f"the scenario asks for {asked.position_rms_m:g} m"
        )
    if abs(timing.arrival_late_s) > _SHARE * asked.arrival_time_s:
        return (
            f"flown as by their autopilot, vehicles would arrive {timing.arrival_late_s:+.2f} s late; the scenario "
            f"asks for {asked.arrival_time_s:g} s"
        )
    return ""
