"""Which missions a flight uploads, and which navigator of the emulated vehicles flies them."""

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
from gcs.plan.verification.verify import Report

IDEAL, OWN, AUTO = "ideal", "own", "auto"
NAVIGATORS = (AUTO, OWN, IDEAL)
_SHARE = 0.5  # of a limit that the autopilot may use; sensors and wind take the rest


@dataclass(frozen=True)
class TimeKeeping:
    """How a flight's missions keep time. `navigator` is that of emulated vehicles."""

    mode: FlightMode
    emulated: bool
    navigator: str = AUTO
    gates: int = 0


def export_for_flight(
    plan: Plan, report: Report, folder: Path, keeping: TimeKeeping, say: Callable[[str], None]
) -> tuple[ExportIndex, str]:
    """Export what is uploaded; return the index and the navigator of emulated vehicles.

    `report` is that of the plan's verification. A setpoint stream needs no corrected speeds, and the ideal navigator
    keeps the plan's own. Raises `VerificationError` if vehicles that fly their missions may come too close to each
    other.
    """
    if keeping.mode is FlightMode.STREAM or (keeping.emulated and keeping.navigator == IDEAL):
        return export(plan, folder, timed=False, report=report), IDEAL
    start_s = 0 if keeping.gates else None  # the common start is known when all are ready
    if not keeping.emulated or keeping.navigator == OWN:
        return export(plan, folder, formats=DEFAULT, gates=keeping.gates, start_s=start_s, report=report), OWN
    index = export(plan, folder, gates=keeping.gates, start_s=start_s, report=report)
    reason = index.refused or (_predicted_failure(plan, index.timing) if index.timing else "")
    if not reason or keeping.gates:
        return index, OWN
    say(f"emulated vehicles keep the plan's own speeds (--nav ideal): {reason}")
    return export(plan, folder, timed=False, report=report), IDEAL


def _predicted_failure(plan: Plan, timing: Timing) -> str:
    """The criterion that the predicted flight fails with a margin, in words; empty if it fails none."""
    limits = plan.scenario.judge
    worst = max(timing.vehicles, key=lambda vehicle: vehicle.error_rms_m)
    if worst.error_rms_m > _SHARE * limits.position_rms_m:
        return (
            f"flown as by its autopilot, vehicle {worst.sysid} would be {worst.error_rms_m:.2f} m from the plan (RMS); "
            f"the scenario asks for {limits.position_rms_m:g} m"
        )
    if abs(timing.arrival_late_s) > _SHARE * limits.arrival_time_s:
        return (
            f"flown as by their autopilot, vehicles would arrive {timing.arrival_late_s:+.2f} s late; the scenario "
            f"asks for {limits.arrival_time_s:g} s"
        )
    return ""
