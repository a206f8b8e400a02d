"""Arms all vehicles of a flight at once, or none, and brings each to the hover over its pad, watched.

None takes off before all have confirmed that they are armed. One that fails to climb stops its motors on the ground.
"""

import asyncio
from collections.abc import Callable, Mapping

import numpy as np

from gcs.errors import FlightError, PeerError, PeerRefusal, PeerTimeout
from gcs.flight.contingency.climb_watch import ClimbWatch
from gcs.flight.execution.fleet_landing import Custody, FleetLanding, named
from gcs.flight.execution.takeoff_landing import FlightVehicle, set_mode, take_off
from gcs.link.protocols.command import CommandRefused
from gcs.link.session.vehicle_session import VehicleSession
from gcs.mavlink import MavCommand
from gcs.util.aio import each, ended, until

_SHOWN_S = 5.0  # a HEARTBEAT comes once a second


async def arm_all(
    vehicles: Mapping[int, FlightVehicle], custody: Custody, before_arming: Callable[[], None] = lambda: None
) -> None:
    """Arm all vehicles (by system id), or leave none armed. `before_arming` may raise to stop it.

    When one refuses or does not answer, the others are disarmed at once. Raises `PeerRefusal`, `PeerTimeout` with the
    vehicle's own reasons. Vehicles that confirmed that they are disarmed leave the custody.
    """
    await each(vehicles.values(), lambda vehicle: set_mode(vehicle, vehicle.behaviour.armed_in))
    before_arming()
    for sysid, vehicle in vehicles.items():
        custody.take_to_arm(sysid)
        vehicle.view.stands_on(vehicle.plan.pads_ned_m[vehicle.row])
    tasks = {sysid: asyncio.ensure_future(_arm(vehicle)) for sysid, vehicle in vehicles.items()}
    failures: dict[int, PeerError] = {}
    unsure: list[int] = []

    async def disarm(sysid: int) -> None:
        try:
            await tasks[sysid]
        except PeerError as failure:
            failures[sysid] = failure
        try:
            if not isinstance(failures.get(sysid), CommandRefused):
                await _disarm(vehicles[sysid].session)
        except PeerError:
            unsure.append(sysid)
        else:
            custody.release(sysid)

    try:
        await asyncio.wait(tasks.values(), return_when=asyncio.FIRST_EXCEPTION)
        if all(task.done() and task.exception() is None for task in tasks.values()):
            return
        await each(vehicles, disarm)
    finally:
        await ended(*tasks.values())
    parts = [failure.message.rstrip(".") for failure in failures.values()]
    if others := [i for i in vehicles if i not in failures and i not in unsure]:
        parts.append(f"{named(others)} disarmed again")
    if unsure:
        parts.append(f"{named(unsure)} did not confirm being disarmed: keep away")
    refused = any(isinstance(failure, CommandRefused) for failure in failures.values())
    raise (PeerRefusal if refused else PeerTimeout)(
        f"no vehicle took off: {'; '.join(parts)}.", hint="remove the reason that the vehicle gives, then fly again"
    )


async def _arm(vehicle: FlightVehicle) -> None:
    await vehicle.session.command(MavCommand.COMPONENT_ARM_DISARM, 1.0)


async def _disarm(session: VehicleSession) -> None:
    """An acknowledgement may belong to a repeated order to arm: a HEARTBEAT after it counts."""
    await session.command(MavCommand.COMPONENT_ARM_DISARM, 0.0)
    await session.wait_for(lambda m: m.name == "HEARTBEAT" and not session.armed, _SHOWN_S, "a disarmed HEARTBEAT")


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
