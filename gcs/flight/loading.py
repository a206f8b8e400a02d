"""From a plan to what each vehicle of a link is to hold.

Knows: plan, exports' fence, rally points and parameters, which autopilot a vehicle runs. Does not know: transfers.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from gcs.errors import PeerError
from gcs.link.load import VehicleLoad
from gcs.mission.build import build_missions
from gcs.mission.firmware import Firmware
from gcs.mission.geofence import fence_items, rally_items
from gcs.mission.model import VehicleMission
from gcs.mission.safety import build_safety
from gcs.plan.trajectory import Plan


def build_loads(plan: Plan, autopilots: Mapping[int, int], *, safety: bool = True) -> tuple[VehicleLoad, ...]:
    """The load of every vehicle of the plan, each for its own autopilot (MAV_AUTOPILOT by system id).

    With `safety` they carry the fence, the rally point and the parameters of an export. Raises `PeerError` for an
    autopilot that missions are not written for, and `ScenarioError` for missions that it does not store.
    """
    loads: dict[int, VehicleLoad] = {}
    for autopilot in sorted(set(autopilots.values())):
        firmware = _firmware(autopilots, autopilot)
        missions = build_missions(plan, firmware=firmware)
        ours = {sysid for sysid, number in autopilots.items() if number == autopilot}
        loads |= {m.sysid: VehicleLoad(m) for m in missions if m.sysid in ours}
        if not safety:
            continue
        safe = build_safety(plan, firmware)
        fence = fence_items(safe.fence.geofence)
        for row, sysid in enumerate(plan.sysids):
            if sysid in ours:
                rally = rally_items([safe.rally[row]])
                loads[sysid] = VehicleLoad(loads[sysid].mission, fence, rally, safe.parameters[row])
    return tuple(loads[sysid] for sysid in plan.sysids)


def missions_only(missions: Iterable[VehicleMission]) -> tuple[VehicleLoad, ...]:
    """Loads that leave fences, rally points and parameters as they are."""
    return tuple(VehicleLoad(mission) for mission in missions)


def _firmware(autopilots: Mapping[int, int], autopilot: int) -> Firmware:
    try:
        return Firmware(autopilot)
    except ValueError:
        who = next(sysid for sysid, number in autopilots.items() if number == autopilot)
        raise PeerError(
            f"vehicle {who} runs autopilot number {autopilot}; missions are written for ArduPilot and PX4.",
            hint="export the missions with `gcs export` and load them with its own ground station",
        ) from None
