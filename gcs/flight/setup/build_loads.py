"""From a plan to what each vehicle of a link is to hold.

Knows: plan, exports' fence, rally points and parameters, which autopilot a vehicle runs. Does not know: transfers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from gcs.autopilots.traits import Autopilot, titles
from gcs.errors import PeerError
from gcs.link.fleet_upload.vehicle_load import VehicleLoad
from gcs.mission.export.mission_files import MissionOrder, make_missions
from gcs.mission.failsafe.fence_rally import build_safety
from gcs.mission.failsafe.rtl_altitudes import return_warnings
from gcs.mission.formats.registry import select_formats
from gcs.mission.geofence import fence_items, rally_items
from gcs.mission.model import VehicleMission
from gcs.plan.trajectory.plan import Plan


def build_loads(
    plan: Plan,
    autopilots: Mapping[int, int],
    *,
    timed: bool,
    safety: bool = True,
    warn: Callable[[str], None] = lambda _: None,
) -> tuple[VehicleLoad, ...]:
    """The load of every vehicle of the plan, each for its own autopilot (MAV_AUTOPILOT by system id).

    Missions are those that an export writes, checked as such: `timed` ones may be flown by themselves, others ask for
    the plan's own speeds, which autopilots do not keep. With `safety` loads carry the fence, the rally point and the
    parameters too, and `warn` hears what is wrong with the returns that these let happen. Raises `PeerError` for an
    autopilot that missions are not written for, `ScenarioError` for missions that it does not store, and
    `VerificationError` for missions that must not fly.
    """
    loads: dict[int, VehicleLoad] = {}
    for autopilot in sorted(set(autopilots.values())):
        firmware = _firmware(autopilots, autopilot)
        safe = build_safety(plan, firmware)
        made = make_missions(plan, MissionOrder(firmware, timed=timed), safe, select_formats(["plan"]))
        if made.refusal is not None:
            raise made.refusal
        ours = {sysid for sysid, number in autopilots.items() if number == autopilot}
        loads |= {m.sysid: VehicleLoad(m) for m in made.missions if m.sysid in ours}
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


def missions_only(missions: Iterable[VehicleMission]) -> tuple[VehicleLoad, ...]:
    """Loads that leave fences, rally points and parameters as they are."""
    return tuple(VehicleLoad(mission) for mission in missions)


def _firmware(autopilots: Mapping[int, int], autopilot: int) -> Autopilot:
    try:
        return Autopilot(autopilot)
    except ValueError:
        who = next(sysid for sysid, number in autopilots.items() if number == autopilot)
        raise PeerError(
            f"vehicle {who} runs autopilot number {autopilot}; missions are written for {titles()}.",
            hint="export the missions with `gcs export` and load them with its own ground station",
        ) from None
