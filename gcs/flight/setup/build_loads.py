"""From a plan to the load of each vehicle: mission, fence, rally point, parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from gcs.autopilots.traits import Autopilot, titles
from gcs.errors import PeerError
from gcs.link.fleet_upload.vehicle_load import VehicleLoad
from gcs.mission.export.index import ExportIndex
from gcs.mission.export.mission_files import MissionOrder, make_missions
from gcs.mission.failsafe.fence_rally import Safety, build_safety
from gcs.mission.failsafe.rtl_altitudes import return_warnings
from gcs.mission.formats.registry import select_formats
from gcs.mission.geofence import fence_items, rally_items
from gcs.mission.model import VehicleMission
from gcs.own_process import in_own_process
from gcs.plan.trajectory.plan import Plan


def build_loads(
    plan: Plan,
    autopilots: Mapping[int, int],
    *,
    timed: bool,
    safety: bool = True,
    warn: Callable[[str], None] = lambda _: None,
    exported: ExportIndex | None = None,
) -> tuple[VehicleLoad, ...]:
    """Return the load of every vehicle of the plan, each for its own autopilot (MAV_AUTOPILOT by system id).

    Missions are those of an export, with its checks. `timed` ones have speeds corrected for the autopilot; the others
    have the plan's own speeds, which autopilots do not keep. What `exported` has for an autopilot is not built again.
    With `safety` a load has the fence, the rally point and the parameters too, and `warn` gets the warnings about
    returns. Raises `PeerError` for an autopilot that missions are not written for, `ScenarioError` for missions that it
    does not store, and `VerificationError` for missions that failed verification.
    """
    loads: dict[int, VehicleLoad] = {}
    for autopilot in sorted(set(autopilots.values())):
        firmware = _firmware(autopilots, autopilot)
        if exported is not None and exported.firmware is firmware and not exported.refused:
            safe, missions = exported.safety, exported.missions
        else:
            safe = build_safety(plan, firmware)
            missions = _missions(plan, MissionOrder(firmware, timed=timed), safe)
        ours = {sysid for sysid, number in autopilots.items() if number == autopilot}
        loads |= {m.sysid: VehicleLoad(m) for m in missions if m.sysid in ours}
        if not safety:
            continue
        for text in return_warnings(plan, safe.returns):
            warn(text)
        fence = fence_items(safe.fence.geofence)
        for row, sysid in enumerate(plan.sysids):
            if sysid in ours:
                rally = rally_items([safe.rally[row]])
                loads[sysid] = VehicleLoad(loads[sysid].mission, fence, rally, safe.parameters[row])
    return tuple(loads[sysid] for sysid in plan.sysids)


async def loads_built_aside(
    plan: Plan,
    autopilots: Mapping[int, int],
    *,
    timed: bool,
    safety: bool = True,
    warn: Callable[[str], None] = lambda _: None,
    exported: ExportIndex | None = None,
) -> tuple[VehicleLoad, ...]:
    """Return what `build_loads` does, computed beside the event loop. Raises what it raises."""
    loads, warnings = await in_own_process(
        _with_warnings, plan, autopilots, timed=timed, safety=safety, exported=exported
    )
    for text in warnings:
        warn(text)
    return loads


def _with_warnings(
    plan: Plan, autopilots: Mapping[int, int], *, timed: bool, safety: bool, exported: ExportIndex | None
) -> tuple[tuple[VehicleLoad, ...], list[str]]:
    warnings: list[str] = []
    loads = build_loads(plan, autopilots, timed=timed, safety=safety, warn=warnings.append, exported=exported)
    return loads, warnings


def missions_only(missions: Iterable[VehicleMission]) -> tuple[VehicleLoad, ...]:
    """Return loads with missions alone: fences, rally points and parameters on board stay."""
    return tuple(VehicleLoad(mission) for mission in missions)


def _missions(plan: Plan, order: MissionOrder, safe: Safety) -> tuple[VehicleMission, ...]:
    made = make_missions(plan, order, safe, select_formats(["plan"]))
    if made.refusal is not None:
        raise made.refusal
    return made.missions


def _firmware(autopilots: Mapping[int, int], autopilot: int) -> Autopilot:
    try:
        return Autopilot(autopilot)
    except ValueError:
        sysid = next(i for i, number in autopilots.items() if number == autopilot)
        raise PeerError(
            f"vehicle {sysid} runs autopilot number {autopilot}; missions are written for {titles()}.",
            hint="export the missions with `gcs export` and load them with its own ground station",
        ) from None
