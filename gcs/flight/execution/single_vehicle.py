"""Flies a single vehicle by Skein's own MAVLink session: the `Flyable` of `gcs.link.session.vehicle_api`."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from gcs.autopilots.columns import FlightBehaviour
from gcs.autopilots.traits import flight_behaviour
from gcs.errors import PeerError, PeerTimeout
from gcs.flight.execution.setpoint_schedule import setpoint_message
from gcs.frames import LocalFrame
from gcs.link.session.vehicle_api import Flyable, Setpoint
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.message import Message
from gcs.mavlink import MavCommand, ModeFlag
from gcs.util.aio import ended
from gcs.util.steady_loop import host_s

if TYPE_CHECKING:
    from gcs.link.session.mavsdk_vehicle import MavsdkVehicle

_REPEAT_S = 0.04
_TIMEOUT_S = 10.0


async def until_mode(
    session: VehicleSession, behaviour: FlightBehaviour, mode: int, timeout_s: float, command: MavCommand | None = None
) -> None:
    """Request a mode, by DO_SET_MODE or `command`, and wait until the HEARTBEAT shows it.

    A HEARTBEAT with the mode is as good as the COMMAND_ACK: on a busy machine both come seconds late, in any order.
    Raises CommandRefused, PeerTimeout.
    """

    def shown(message: Message) -> bool:
        return message.name == "HEARTBEAT" and bool(message.fields["custom_mode"] == mode)

    parameters = behaviour.mode_parameters(mode) if command is None else ()
    # Listen first: an emulated vehicle may have landed and left the mode again before its acknowledgement is read.
    seen = asyncio.ensure_future(session.wait_for(shown, timeout_s, f"mode {behaviour.mode_name(mode)}"))
    asked = asyncio.ensure_future(session.command(MavCommand.DO_SET_MODE if command is None else command, *parameters))
    missed: PeerTimeout | None = None
    try:
        await asyncio.wait({seen, asked}, return_when=asyncio.FIRST_COMPLETED)
        if not seen.done():
            try:
                await asked
            except PeerTimeout as silence:
                missed = silence
            else:
                if shown(session.latest["HEARTBEAT"]):
                    return
        await seen
    except PeerTimeout as hidden:
        raise (missed or hidden) from None
    finally:
        await ended(seen, asked)


def control_of(vehicle: VehicleSession | MavsdkVehicle) -> Flyable:
    """Return the controls of a vehicle; close them after use. Raises `PeerError` as `SessionControl` does."""
    return SessionControl(vehicle) if isinstance(vehicle, VehicleSession) else vehicle.control()


class SessionControl:
    """`Flyable` by the state machines of `gcs.link`."""

    def __init__(self, session: VehicleSession) -> None:
        """Raises `PeerError` for an unknown autopilot, and for what is no rotorcraft."""
        self._session = session
        self._behaviour = flight_behaviour(session.sysid, session.autopilot, session.kind)
        self._setpoint: Setpoint | None = None
        self._repeating: asyncio.Task[None] | None = None

    async def arm(self) -> None:
        """See `Flyable`."""
        await self._mode(self._behaviour.armed_in)
        await self._session.command(MavCommand.COMPONENT_ARM_DISARM, 1.0)
        await self._session.wait_for(
            lambda m: m.name == "HEARTBEAT" and bool(m.fields["base_mode"] & ModeFlag.ARMED),
            _TIMEOUT_S,
            "an armed HEARTBEAT",
            or_latest=True,
        )

    async def take_off(self, height_m: float) -> None:
        """See `Flyable`."""
        home = await self._session.home()
        if home is None:
            raise PeerError(
                f"vehicle {self._session.sysid} has no home position, from which its height counts.",
                hint="wait for its GNSS fix",
            )
        parameters = self._behaviour.takeoff_parameters(height_m, home.alt_amsl_m)
        await self._session.command(MavCommand.NAV_TAKEOFF, *parameters)

    async def hold(self) -> None:
        """See `Flyable`."""
        await self._mode(self._behaviour.hold)

    async def land(self) -> None:
        """See `Flyable`."""
        await self._mode(self._behaviour.land)

    async def return_home(self) -> None:
        """See `Flyable`."""
        await self._mode(self._behaviour.returning)

    async def follow(self, setpoint: Setpoint) -> None:
        """See `Flyable`."""
        self._setpoint = setpoint
        if self._repeating is None:
            self._repeating = asyncio.ensure_future(self._repeat())
            await asyncio.sleep(self._behaviour.stream_first_s)
            await until_mode(self._session, self._behaviour, self._behaviour.guided, _TIMEOUT_S)

    async def close(self) -> None:
        """See `Flyable`."""
        if self._repeating is not None:
            await ended(self._repeating)
            self._repeating = None

    async def _mode(self, mode: int) -> None:
        await until_mode(self._session, self._behaviour, mode, _TIMEOUT_S)
        await self.close()

    async def _repeat(self) -> None:
        loop, session = asyncio.get_running_loop(), self._session
        while self._setpoint is not None:
            sp = self._setpoint
            unix_s = session.clock.now_unix_s(host_s(loop))
            stamp_ms = 0 if unix_s is None else session.clock.boot_ms(unix_s) or 0
            values = (*sp.position_ned_m, *sp.velocity_ned_mps, *sp.acceleration_ned_mps2, sp.yaw_ned_rad)
            session.send(setpoint_message(session.station, stamp_ms, LocalFrame(), values))
            await asyncio.sleep(_REPEAT_S)
