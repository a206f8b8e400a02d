"""The parameters on board against those that the times of a mission rest on."""

from gcs.autopilots.parameter_names import in_units_of
from gcs.autopilots.traits import Autopilot
from gcs.errors import PeerError
from gcs.flight.monitoring.preflight_check import CheckName, PreflightCheck
from gcs.link.session.vehicle_api import Loadable
from gcs.link.session.vehicle_load import VehicleLoad

_ALIKE = 0.02  # a smaller difference moves arrivals by less than the model's error
_REQUIRED = "as the times of its mission assume; set it, or fly with --mode stream"


async def timing_check(session: Loadable, load: VehicleLoad) -> PreflightCheck:
    """Return the check of one vehicle. Parameters that its load sets are not compared."""
    rests_on = Autopilot(session.autopilot).navigator.parameters
    given = dict(load.parameters)
    names = [name for name in rests_on if name not in given]
    try:
        found = await session.read_parameters(names)
    except PeerError as error:
        return PreflightCheck(session.sysid, CheckName.TIMING, error.message.rstrip("."), _REQUIRED, ok=False)
    off = []
    for name in names:
        own = found[name]
        assumed = in_units_of(session.autopilot, own.name, name, rests_on[name])
        if abs(own.value - assumed) > _ALIKE * abs(assumed):
            off.append(f"{own.name} is {own.value:g}, assumed {assumed:g}")
    return PreflightCheck(session.sysid, CheckName.TIMING, "; ".join(off) or "as assumed", _REQUIRED, ok=not off)
