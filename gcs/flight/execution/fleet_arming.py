"""Arms all vehicles of a flight at once, or none: none takes off before all have confirmed that they are armed."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping

from gcs.errors import PeerError, PeerRefusal, PeerTimeout
from gcs.flight.execution.fleet_landing import Custody, named
from gcs.flight.execution.takeoff_landing import FlightVehicle, set_mode
from gcs.link.protocols.command import CommandRefused
from gcs.link.session.vehicle_session import VehicleSession
from gcs.mavlink import MavCommand
from gcs.util.aio import each, ended

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
