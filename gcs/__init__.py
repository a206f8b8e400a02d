"""Skein, the ground station for formations of quadrotors: the public Python API.

    import gcs
    plan = gcs.make_plan(gcs.load_scenario("simulation1"))
    gcs.export(plan, "out")
    flown = gcs.fly(plan)

The commands call nothing else: scenario (`load_scenario`), plan (`make_plan`, `save_plan`, `load_plan`), `verify`,
`export`, fleet (`Connection(links).open()` gives vehicles on links), `fly`. Errors are `GcsError`s that say what to do.
Everything is loaded when it is first used: `import gcs` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gcs.autopilots.traits import Autopilot as Autopilot
    from gcs.errors import GcsError as GcsError
    from gcs.errors import OutOfTime as OutOfTime
    from gcs.flight.assessment.judge import Truth as Truth
    from gcs.flight.assessment.judge import Verdict as Verdict
    from gcs.flight.assessment.judge import load_truth as load_truth
    from gcs.flight.monitoring.progress import Watcher as Watcher
    from gcs.flight.recording.record_table import FlightReports as FlightReports
    from gcs.flight.recording.record_table import load_record as load_record
    from gcs.flight.run import Flown as Flown
    from gcs.flight.run import fly as fly
    from gcs.flight.setup.simulator_process import Emulated as Emulated
    from gcs.link.session.connection import Connection as Connection
    from gcs.mission.export.bspline_smoothing import SmoothPath as SmoothPath
    from gcs.mission.export.export import export as export
    from gcs.mission.export.flight_volumes import VolumeOrder as VolumeOrder
    from gcs.mission.export.index import ExportIndex as ExportIndex
    from gcs.mission.export.setpoint_stream import build_stream as build_stream
    from gcs.mission.formats.registry import Content as Content
    from gcs.mission.formats.registry import Format as Format
    from gcs.mission.model import Altitude as Altitude
    from gcs.mission.model import SetpointStream as SetpointStream
    from gcs.mission.model import VehicleMission as VehicleMission
    from gcs.mission.proving.break_off import BreakOff as BreakOff
    from gcs.mission.proving.plan_tracks import plan_tracks as plan_tracks
    from gcs.mission.proving.prove import TrackLimits as TrackLimits
    from gcs.mission.proving.prove import prove as prove
    from gcs.mission.proving.track import PolynomialTrack as PolynomialTrack
    from gcs.mission.proving.track_formats import ReadTracks as ReadTracks
    from gcs.mission.proving.track_formats import read_tracks as read_tracks
    from gcs.mission.proving.track_report import TrackCheck as TrackCheck
    from gcs.mission.proving.track_report import TrackReport as TrackReport
    from gcs.mission.proving.track_report import UnsafeSpan as UnsafeSpan
    from gcs.mission.waypoints.mission_items import build_missions as build_missions
    from gcs.mission.waypoints.timed_legs import TimedLegs as TimedLegs
    from gcs.physics.states import NamedStates as NamedStates
    from gcs.plan.cost_terms import CostTerm as CostTerm
    from gcs.plan.cost_terms import cost_terms as cost_terms
    from gcs.plan.formation_orders import Avoid as Avoid
    from gcs.plan.formation_orders import FlyHome as FlyHome
    from gcs.plan.formation_orders import GoOn as GoOn
    from gcs.plan.formation_orders import GoTo as GoTo
    from gcs.plan.formation_orders import Hold as Hold
    from gcs.plan.formation_orders import Reshape as Reshape
    from gcs.plan.formation_orders import Scale as Scale
    from gcs.plan.formation_orders import Slower as Slower
    from gcs.plan.formation_return import plan_return as plan_return
    from gcs.plan.ocp.problem import ObjectiveTerm as ObjectiveTerm
    from gcs.plan.plan_file import load_plan as load_plan
    from gcs.plan.plan_file import load_returns as load_returns
    from gcs.plan.plan_file import save_plan as save_plan
    from gcs.plan.planner import make_plan as make_plan
    from gcs.plan.prepared_returns import PreparedReturn as PreparedReturn
    from gcs.plan.prepared_returns import PreparedReturns as PreparedReturns
    from gcs.plan.prepared_returns import prepare_returns as prepare_returns
    from gcs.plan.replanning.replanner import Replanner as Replanner
    from gcs.plan.trajectory.plan import MeshRound as MeshRound
    from gcs.plan.trajectory.plan import Plan as Plan
    from gcs.plan.verification.proof.verdict import Check as Check
    from gcs.plan.verification.verify import Report as Report
    from gcs.plan.verification.verify import verify as verify
    from gcs.plan.verification.wind_envelope import WindBorder as WindBorder
    from gcs.plan.verification.wind_envelope import WindEnvelope as WindEnvelope
    from gcs.plan.verification.wind_envelope import wind_envelope as wind_envelope
    from gcs.scenario.schema.places import NoFlyZone as NoFlyZone
    from gcs.scenario.schema.scenario import Scenario as Scenario
    from gcs.scenario.sources.load import load_scenario as load_scenario
    from gcs.scenario.sources.load import with_keys as with_keys

_HOME = {
    "Altitude": "gcs.mission.model",
    "Autopilot": "gcs.autopilots.traits",
    "Avoid": "gcs.plan.formation_orders",
    "BreakOff": "gcs.mission.proving.break_off",
    "Check": "gcs.plan.verification.proof.verdict",
    "Connection": "gcs.link.session.connection",
    "Content": "gcs.mission.formats.registry",
    "CostTerm": "gcs.plan.cost_terms",
    "Emulated": "gcs.flight.setup.simulator_process",
    "ExportIndex": "gcs.mission.export.index",
    "FlightReports": "gcs.flight.recording.record_table",
    "Flown": "gcs.flight.run",
    "FlyHome": "gcs.plan.formation_orders",
    "Format": "gcs.mission.formats.registry",
    "GcsError": "gcs.errors",
    "GoOn": "gcs.plan.formation_orders",
    "GoTo": "gcs.plan.formation_orders",
    "Hold": "gcs.plan.formation_orders",
    "MeshRound": "gcs.plan.trajectory.plan",
    "NamedStates": "gcs.physics.states",
    "NoFlyZone": "gcs.scenario.schema.places",
    "ObjectiveTerm": "gcs.plan.ocp.problem",
    "OutOfTime": "gcs.errors",
    "Plan": "gcs.plan.trajectory.plan",
    "PolynomialTrack": "gcs.mission.proving.track",
    "PreparedReturn": "gcs.plan.prepared_returns",
    "PreparedReturns": "gcs.plan.prepared_returns",
    "ReadTracks": "gcs.mission.proving.track_formats",
    "Replanner": "gcs.plan.replanning.replanner",
    "Report": "gcs.plan.verification.verify",
    "Reshape": "gcs.plan.formation_orders",
    "Scale": "gcs.plan.formation_orders",
    "Scenario": "gcs.scenario.schema.scenario",
    "SetpointStream": "gcs.mission.model",
    "Slower": "gcs.plan.formation_orders",
    "SmoothPath": "gcs.mission.export.bspline_smoothing",
    "TimedLegs": "gcs.mission.waypoints.timed_legs",
    "TrackCheck": "gcs.mission.proving.track_report",
    "TrackLimits": "gcs.mission.proving.prove",
    "TrackReport": "gcs.mission.proving.track_report",
    "Truth": "gcs.flight.assessment.judge",
    "UnsafeSpan": "gcs.mission.proving.track_report",
    "VehicleMission": "gcs.mission.model",
    "Verdict": "gcs.flight.assessment.judge",
    "VolumeOrder": "gcs.mission.export.flight_volumes",
    "Watcher": "gcs.flight.monitoring.progress",
    "WindBorder": "gcs.plan.verification.wind_envelope",
    "WindEnvelope": "gcs.plan.verification.wind_envelope",
    "build_missions": "gcs.mission.waypoints.mission_items",
    "build_stream": "gcs.mission.export.setpoint_stream",
    "cost_terms": "gcs.plan.cost_terms",
    "export": "gcs.mission.export.export",
    "fly": "gcs.flight.run",
    "load_plan": "gcs.plan.plan_file",
    "load_record": "gcs.flight.recording.record_table",
    "load_returns": "gcs.plan.plan_file",
    "load_scenario": "gcs.scenario.sources.load",
    "load_truth": "gcs.flight.assessment.judge",
    "make_plan": "gcs.plan.planner",
    "plan_return": "gcs.plan.formation_return",
    "plan_tracks": "gcs.mission.proving.plan_tracks",
    "prepare_returns": "gcs.plan.prepared_returns",
    "prove": "gcs.mission.proving.prove",
    "read_tracks": "gcs.mission.proving.track_formats",
    "save_plan": "gcs.plan.plan_file",
    "verify": "gcs.plan.verification.verify",
    "wind_envelope": "gcs.plan.verification.wind_envelope",
    "with_keys": "gcs.scenario.sources.load",
}
__all__ = sorted(_HOME)  # noqa: PLE0605 (one table names them all)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'gcs' has no attribute {name!r}; it has {', '.join(__all__)}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
