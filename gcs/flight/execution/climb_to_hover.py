"""The climb of one armed vehicle to the hover over its pad, watched: one that fails stops its motors on the ground."""

from __future__ import annotations

import numpy as np

from gcs.errors import FlightError
from gcs.flight.contingency.climb_watch import ClimbWatch
from gcs.flight.execution.fleet_landing import FleetLanding
from gcs.flight.execution.takeoff_landing import FlightVehicle, take_off
from gcs.util.aio import until

_SETTLED_M, _SETTLED_MPS = 0.4, 0.25


async def climb_to_hover(vehicle: FlightVehicle, landing: FleetLanding) -> None:
    """Order an armed vehicle to take off; wait until it is near its hover position, and slow.

    Raises FlightError if it does not climb, falls or tips over: it is being disarmed then. Raises CommandRefused,
    PeerTimeout.
    """
    await take_off(vehicle)
    session = vehicle.session
    watch = ClimbWatch(vehicle.hover_height_m, session.latest.get("LOCAL_POSITION_NED"))
    stop = session.subscribe(watch.receive)
    try:
        await until(
            lambda: bool(watch.failure) or is_hovering(vehicle),
            vehicle.options.phase_timeout_s,
            f"vehicle {vehicle.sysid}: hover over its pad",
        )
    finally:
        if not watch.failure:  # else it tells when the vehicle is on the ground
            stop()
    if watch.failure:
        if session.armed:
            landing.disarm(vehicle, lambda: watch.on_ground, watch.failure)
        ordered = "It is ordered to disarm, the others to land" if session.armed else "The others are ordered to land"
        raise FlightError(
            f"the start was aborted: vehicle {vehicle.sysid} {watch.failure}. {ordered}.",
            hint="check its motors, propellers and weight",
        )


def is_hovering(vehicle: FlightVehicle) -> bool:
    """Whether a vehicle is near its hover position, and slow."""
    # A vehicle climbs to a height above its start, which it knows no better than its position on arrival.
    near_m = max(_SETTLED_M, vehicle.plan.scenario.judge.arrival_position_m)
    near = np.linalg.norm(vehicle.view.position_ned_m - vehicle.hover_ned_m) < near_m
    return bool(near and np.linalg.norm(vehicle.view.velocity_ned_mps) < _SETTLED_MPS)
