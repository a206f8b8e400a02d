"""Arms all vehicles of a flight at once, or none: none takes off before all have confirmed that they are armed."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping

from gcs.errors import GcsError, PeerError, PeerRefusal, PeerTimeout
from gcs.flight.execution.fleet_landing import Custody, named
from gcs.flight.execution.takeoff_landing import FlightVehicle, set_mode
from gcs.link.protocols.command import CommandRefused
from gcs.mavlink import MavCommand
from gcs.util.aio import each, ended


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
    tasks = {sysid: asyncio.ensure_future(_arm(vehicle, 1.0)) for sysid, vehicle in vehicles.items()}
    try:
        await asyncio.wait(tasks.values(), return_when=asyncio.FIRST_EXCEPTION)
    finally:
        await ended(*tasks.values())
    failures = {i: failure for i, task in tasks.items() if not task.cancelled() and (failure := task.exception())}
    if not failures:
        return
    refused = {i for i, failure in failures.items() if isinstance(failure, CommandRefused)}
    unsure: list[int] = []

    async def disarm(sysid: int) -> None:
        try:
            if sysid not in refused:
                await _arm(vehicles[sysid], 0.0)
        except PeerError:
            unsure.append(sysid)
        else:
            custody.release(sysid)

    await each(vehicles, disarm)
    for failure in failures.values():
        if not isinstance(failure, GcsError):
            raise failure
    parts = [str(failure).rstrip(".") for failure in failures.values()]
    if others := [i for i in vehicles if i not in failures and i not in unsure]:
        parts.append(f"{named(others)} disarmed again")
    if unsure:
        parts.append(f"{named(unsure)} did not confirm being disarmed: keep away")
    raise (PeerRefusal if refused else PeerTimeout)(
        f"no vehicle took off: {'; '.join(parts)}.", hint="remove the reason that the vehicle gives, then fly again"
    )


async def _arm(vehicle: FlightVehicle, armed: float) -> None:
    await vehicle.session.command(MavCommand.COMPONENT_ARM_DISARM, armed)
