"""The index of an export: a JSON file beside the others, with their hashes, checks and predictions."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field

from gcs.autopilots.traits import Autopilot
from gcs.mission.check.fleet_check import FleetReport
from gcs.mission.export.flight_volumes import ProvedVolumes
from gcs.mission.export.separations import Separation
from gcs.mission.machine_independent import rounded, rounded_down
from gcs.mission.model import Altitude, VehicleMission
from gcs.mission.predicted.timing import Timing
from gcs.mission.returns.fence_areas import INCLUSION_MARGIN_M
from gcs.mission.returns.fence_rally import Safety
from gcs.mission.returns.rtl_cases import WorstReturn
from gcs.mission.waypoints.placement import Deviation
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.navigation_error import judged_separation_m

_VERSION = 3


@dataclass(frozen=True)
class Smoothing:
    """The difference of smoothed setpoints from the plan."""

    knots_every_s: float
    deviation_m: float
    yaw_deviation_deg: float
    clearance_min_m: float


@dataclass(frozen=True)
class ExportIndex:
    """The contents of an export, and how far they are from the plan."""

    scenario: str
    plan_hash: str
    autopilots: tuple[Autopilot, ...]  # of each vehicle, in the plan's order
    altitude: Altitude
    setpoint_rate_hz: float
    waypoints: int  # positions with a planned time, per vehicle
    items: int  # mission items of the longest mission, home not counted
    deviation: Deviation
    sha256: dict[str, str]  # by file name
    safety: Safety
    report: FleetReport | None  # of the missions as written; None without missions
    smoothing: Smoothing | None = None  # of the setpoints; waypoints are always the plan's
    timing: Timing | None = None  # of missions whose speeds are corrected for their autopilot
    refused: str = ""  # why the missions of the default formats are left out
    missions: tuple[VehicleMission, ...] = field(default=(), repr=False)
    separations: tuple[Separation, ...] = ()
    volumes: ProvedVolumes | None = None

    def firmware_data(self, sysids: Sequence[int]) -> str | dict[str, str]:
        """The autopilot of all vehicles, or that of each by system id, for index.json and `--json`."""
        if len(set(self.autopilots)) == 1:
            return self.autopilots[0].key
        return {str(sysid): known.key for sysid, known in zip(sysids, self.autopilots, strict=True)}


def index_document(index: ExportIndex, plan: Plan) -> dict[str, object]:
    """The index as a JSON document."""
    document = {
        "version": _VERSION,
        "scenario": index.scenario,
        "plan_hash": index.plan_hash,
        "firmware": index.firmware_data(plan.sysids),
        "altitude": index.altitude.value,
        "setpoint_rate_hz": index.setpoint_rate_hz,
        "waypoints": index.waypoints,
        "items": index.items,
        "deviation": rounded(asdict(index.deviation)),
        "separation_min_m": judged_separation_m(plan.scenario),
        "verified": None if index.report is None else rounded(_verified(index, index.report, plan)),
        "timing": None if index.timing is None else rounded(index.timing.data()),
        "refused": index.refused or None,
        "separations": rounded([row.data() for row in index.separations]),
        "fence": {
            "inclusion_margin_m": INCLUSION_MARGIN_M,
            "zones": rounded([asdict(zone) for zone in index.safety.fence.zones]),
        },
        "returns": rounded(_returns(index.safety)),
        "parameters": {
            str(sysid): dict(values) for sysid, values in zip(plan.sysids, index.safety.parameters, strict=True)
        },
        "sha256": index.sha256,
    }
    if index.smoothing is not None:
        document["smoothing"] = rounded(asdict(index.smoothing))
    if index.volumes is not None:
        document["volumes"] = index.volumes.data()
    return document


def _verified(index: ExportIndex, report: FleetReport, plan: Plan) -> dict[str, object]:
    """The verified flight of the missions as written, at their planned speeds or by the model of their autopilot."""
    closest = report.closest
    timing = "planned speeds" if index.timing is None else "model of the autopilot"
    verified: dict[str, object] = {"timing": timing, "clearance_min_m": report.clearance_min_m}
    if report.clearance_proved_m is not None:
        verified["clearance_proved_m"] = rounded_down(report.clearance_proved_m)
    if closest is not None:
        verified["separation_min_m"] = closest.distance_m
        verified["separation_proved_m"] = rounded_down(closest.proved_m)
        verified["separation_vehicles"] = [plan.sysids[row] for row in closest.pair]
    return verified | {"findings": [f.data() for f in report.findings]}


def _worst(worst: WorstReturn) -> dict[str, object]:
    return asdict(worst) | {"proved_m": None if worst.proved_m is None else rounded_down(worst.proved_m)}


def _returns(safety: Safety) -> dict[str, object]:
    returns = safety.returns
    return {
        "refused": returns.why_none or None,
        "step_m": returns.step_m,
        "ground_max_m": returns.ground_max_m,
        "top_m": returns.top_m,
        "speeds": asdict(returns.speeds),
        "worst": None if returns.worst is None else _worst(returns.worst),
        "routed_worst": None if returns.routed is None else asdict(returns.routed),
        "without_way": [asdict(gap) for gap in returns.no_way],
        # `keep_in` is there for the edge of a keep-in area only.
        "through_zones": [
            {key: value for key, value in asdict(crossing).items() if key != "keep_in" or value}
            for crossing in returns.crossings
        ],
    }
