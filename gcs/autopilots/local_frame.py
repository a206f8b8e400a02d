"""The frame in which a vehicle reports its position and takes setpoints, by its autopilot."""

from gcs.autopilots.traits import traits_of
from gcs.frames import LocalFrame, Origin
from gcs.types import Array


def local_frame(autopilot: int | None, origin: Origin, begins_ned_m: Array) -> LocalFrame:
    """The frame in which a vehicle of this MAV_AUTOPILOT reports and takes setpoints, from `begins_ned_m` (3,) on.

    One that is not in the table counts true metres.
    """
    row = None if autopilot is None else traits_of(autopilot)
    if row is None:
        return LocalFrame(begins_ned_m)
    return LocalFrame.on_sphere(begins_ned_m, origin, row.earth_radius_m)
