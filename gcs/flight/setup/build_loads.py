"""From a plan to the load of each vehicle: mission, fence, rally point, parameters, and what keeps its times."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from gcs.autopilots.traits import Autopilot, autopilot_name, titles
from gcs.errors import GcsError, NotWritten, PeerError, UsageError
from gcs.flight.contingency.choices import FlightMode, NavigatorChoice, TimeKeeping
from gcs.flight.monitoring.predicted_tracks import PredictedTracks
from gcs.flight.setup.own_process import in_own_process
from gcs.link.session.vehicle_load import VehicleLoad
from gcs.mission.export.export import export
from gcs.mission.export.index import ExportIndex
from gcs.mission.export.mission_files import STREAM_INSTEAD, MissionOrder, make_missions
from gcs.mission.formats.registry import select_formats
from gcs.mission.geofence import fence_items, rally_items
from gcs.mission.model import SetpointStream, VehicleMission
from gcs.mission.predicted.arrival_spread import spread_in_words
from gcs.mission.predicted.timing import Timing
from gcs.mission.returns.fence_rally import build_safety, with_room
from gcs.mission.returns.rtl_altitudes import ReturnPlan, return_warnings
from gcs.mission.waypoints.mission_items import empty_missions
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import Report
from gcs.scenario.values.si import names_autopilots

WITHOUT_MISSIONS = "the setpoint stream is flown without waypoint missions on board"
_SHARE = 0.5  # of a limit that the autopilot may use; sensors and wind take the rest


@dataclass(frozen=True)
class PreparedFlight:
    """What is made from a plan before it is flown."""

    loads: tuple[VehicleLoad, ...]
    stream: SetpointStream
    returns: ReturnPlan | None = None  # of the export, for the vehicles' autopilots; None: planned before take-off
    tracks: PredictedTracks | None = None  # of missions on board; None: nothing is predicted
    folder: Path | None = None  # for plans that replace this one


def build_loads(
    plan: Plan,
    autopilots: Mapping[int, int],
    *,
    timed: bool,
    safety: bool = True,
    warn: Callable[[str], None] = lambda _: None,
    exported: ExportIndex | None = None,
    stream: bool = False,
) -> tuple[VehicleLoad, ...]:
    """Return the load of every vehicle of the plan, each for its own autopilot (MAV_AUTOPILOT by system id).

    Missions are those of an export, with its checks. `timed` ones have speeds corrected for the autopilot; the others
    have the plan's own speeds, which autopilots do not keep. What `exported` has for these autopilots is not built
    again. With `safety` a load has the fence, the rally point and the parameters too, and `warn` gets the warnings
    about returns; it is told too by how much arrival times may spread. Vehicles that follow a setpoint `stream` need no
    mission: where none can be on board they get an empty one, and `warn` is told why. Their plan may change in flight,
    so their fence leaves room for it. Raises `PeerError` as
    `fleet_autopilots`, and `NotWritten` for missions that failed verification, or that an autopilot does not store.
    """
    each = fleet_autopilots(plan, autopilots)
    if exported is not None and exported.autopilots == each and (not exported.refused or stream):
        safe, missions = exported.safety, exported.missions
    else:
        safe = build_safety(plan, each)
        made = make_missions(plan, MissionOrder(each, timed=timed), safe, select_formats(["plan"]))
        if made.refusal is not None and not stream:
            raise made.refusal
        _say_spread(made.timing, made.legs, warn)
        missions = made.missions
        if made.refusal is not None:
            warn(f"{WITHOUT_MISSIONS}: {made.refusal.message}")
            missions = empty_missions(plan)
    if not safety:
        return missions_only(missions)
    for text in return_warnings(plan, safe.returns, each):
        warn(text)
    safe = with_room(plan, safe, each) if stream else safe
    fence = fence_items(safe.fence.geofence)
    return tuple(
        VehicleLoad(mission, fence, rally_items(rally), parameters)
        for mission, rally, parameters in zip(missions, safe.rally, safe.parameters, strict=True)
    )


def fleet_autopilots(plan: Plan, autopilots: Mapping[int, int]) -> tuple[Autopilot, ...]:
    """Return the autopilot of each vehicle of the plan, from MAV_AUTOPILOT by system id.

    Raises `PeerError` for an autopilot that missions are not written for, and for another one than the scenario names
    for this vehicle.
    """
    every = tuple(_firmware(sysid, autopilots[sysid]) for sysid in plan.sysids)
    if names_autopilots(plan.scenario):
        refuse_other_autopilots(plan, every)
    return every


def refuse_other_autopilots(plan: Plan, autopilots: Iterable[int]) -> None:
    """Raises `PeerError` for vehicles that run another autopilot than the scenario says."""
    rows = zip(plan.sysids, autopilots, plan.autopilots, strict=True)
    other = [
        f"vehicle {sysid} runs {autopilot_name(found)}, the scenario says {wanted.title}"
        for sysid, found, wanted in rows
        if found != wanted
    ]
    if other:
        raise PeerError(
            f"{'; '.join(other)}.",
            hint="set mission.autopilot, or autopilot in [[formation.vehicle]], to what each vehicle runs. If the "
            "scenario is right, check the vehicles' system ids (--map)",
        )


def refuse_without_timed_start(vehicles: Iterable[tuple[int, int]], error: type[GcsError] = UsageError) -> None:
    """Raises an error where a mission cannot wait until a time of day, by system id and MAV_AUTOPILOT."""
    known = {int(one): one for one in Autopilot}
    late = [
        f"vehicle {sysid} ({known[number].title})"
        for sysid, number in vehicles
        if number in known and not known[number].traits.flight.waits_for_time_of_day
    ]
    if late:
        raise error(
            f"missions cannot start together: a mission cannot wait until a time of day on {', '.join(late)}.",
            hint="fly with --mode stream, which keeps all vehicles on time",
        )


async def loads_built_aside(
    plan: Plan,
    autopilots: Mapping[int, int],
    *,
    timed: bool,
    safety: bool = True,
    warn: Callable[[str], None] = lambda _: None,
    exported: ExportIndex | None = None,
    stream: bool = False,
) -> tuple[VehicleLoad, ...]:
    """Return what `build_loads` does, computed beside the event loop. Raises what it raises."""
    fleet_autopilots(plan, autopilots)
    loads, warnings = await in_own_process(
        _with_warnings, plan, autopilots, timed=timed, safety=safety, exported=exported, stream=stream
    )
    for text in warnings:
        warn(text)
    return loads


def _with_warnings(
    plan: Plan, autopilots: Mapping[int, int], *, timed: bool, safety: bool, exported: ExportIndex | None, stream: bool
) -> tuple[tuple[VehicleLoad, ...], list[str]]:
    warnings: list[str] = []
    warn = warnings.append
    loads = build_loads(plan, autopilots, timed=timed, safety=safety, warn=warn, exported=exported, stream=stream)
    return loads, warnings


def missions_only(missions: Iterable[VehicleMission]) -> tuple[VehicleLoad, ...]:
    """Return loads with missions alone: fences, rally points and parameters on board stay."""
    return tuple(VehicleLoad(mission) for mission in missions)


def _firmware(sysid: int, autopilot: int) -> Autopilot:
    try:
        return Autopilot(autopilot)
    except ValueError:
        raise PeerError(
            f"vehicle {sysid} runs autopilot number {autopilot}; missions are written for {titles()}.",
            hint="export the missions with `gcs export` and load them with its own ground station",
        ) from None


def export_for_flight(
    plan: Plan, report: Report, folder: Path, keeping: TimeKeeping, say: Callable[[str], None]
) -> tuple[ExportIndex, NavigatorChoice]:
    """Export what is uploaded; return the index and the navigator of emulated vehicles.

    `report` is that of the plan's verification. A setpoint stream needs no corrected speeds, and the ideal navigator
    keeps the plan's own. Without missions that can be on board a stream is flown all the same, and said. Raises
    `NotWritten` if vehicles that fly their missions may come too close to each other.
    """
    if keeping.mode is FlightMode.STREAM:
        index = export(plan, folder, timed=False, report=report)
        if index.refused and plan.begin_state is None:
            say(f"{WITHOUT_MISSIONS}: {index.refused}")
            index = replace(index, missions=empty_missions(plan))
        return index, NavigatorChoice.IDEAL
    if keeping.emulated and keeping.navigator is NavigatorChoice.IDEAL:
        return _fit(export(plan, folder, timed=False, report=report), plan), NavigatorChoice.IDEAL
    say("timing the missions by the model of their autopilot, for all answers that it may give")
    start_s = 0 if keeping.gates else None  # the common start is known when all are ready
    if not keeping.emulated or keeping.navigator is NavigatorChoice.OWN:
        index = _fit(export(plan, folder, gates=keeping.gates, start_s=start_s, report=report), plan)
        _say_spread(index.timing, index.autopilots, say)
        return index, NavigatorChoice.OWN
    index = export(plan, folder, gates=keeping.gates, start_s=start_s, report=report)
    reason = index.refused or (_predicted_failure(plan, index.timing) if index.timing else "")
    if not reason or keeping.gates:
        _say_spread(index.timing, index.autopilots, say)
        return index, NavigatorChoice.OWN
    say(f"emulated vehicles keep the plan's own speeds (--nav ideal): {reason}")
    return _fit(export(plan, folder, timed=False, report=report), plan), NavigatorChoice.IDEAL


def _fit(index: ExportIndex, plan: Plan) -> ExportIndex:
    """The index of an export with missions; a plan that begins in the air has none. Raises `NotWritten` without."""
    if index.refused and plan.begin_state is None:
        raise NotWritten(index.refused, hint=STREAM_INSTEAD)
    return index


def _say_spread(timing: Timing | None, autopilots: Iterable[Autopilot], say: Callable[[str], None]) -> None:
    if timing is not None and timing.may_differ_s > 0.0:
        say(spread_in_words(timing.may_differ_s, autopilots))


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
