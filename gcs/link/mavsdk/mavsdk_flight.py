"""MAVSDK's way to ask a vehicle for what `gcs.link.session.vehicle_api` names, and what it tells of a vehicle.

Knows: its plugins for actions, offboard control, telemetry and versions. Does not know: links, missions.
It repeats setpoints by itself, 20 times a second, with stamps of its own.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any, TypeVar

from mavsdk.plugins import action, info, offboard, telemetry

from gcs.autopilots.flight_modes import autopilot_name
from gcs.autopilots.traits import TRAITS
from gcs.errors import PeerError, PeerTimeout
from gcs.link.session.status_report import VehicleReport
from gcs.link.session.vehicle_api import Setpoint
from gcs.mission.model import Home

T = TypeVar("T")
Call = Callable[[str, Callable[[], T]], Awaitable[T]]  # what for, and the call that blocks
_PATIENCE_S = 10.0
_TOLD_S, _RATE_HZ = 3.0, 5.0
_STREAM_FIRST_S = max(row.flight.stream_first_s for row in TRAITS.values())
_LOOK_S = 0.05
_VERSION_TYPES = ("?", "-dev", "-alpha", "-beta", "-rc", "")


class MavsdkControl:
    """`Flyable` by MAVSDK."""

    def __init__(self, sysid: int, system: Any, call: Call[Any]) -> None:
        self._sysid, self._call = sysid, call
        self._action = action.Action(system)
        self._offboard = offboard.Offboard(system)
        self._telemetry = telemetry.Telemetry(system)
        self._following = False

    async def arm(self) -> None:
        """See `Flyable`."""
        await self._call("arm", self._action.arm)
        await self._until(self._telemetry.armed, "armed")

    async def take_off(self, height_m: float) -> None:
        """See `Flyable`."""
        await self._call("set the height of its take-off", lambda: self._action.set_takeoff_altitude(height_m))
        await self._call("take off", self._action.takeoff)

    async def hold(self) -> None:
        """See `Flyable`."""
        await self._call("hold", self._action.hold)
        await self._mode(telemetry.FlightMode.HOLD)

    async def land(self) -> None:
        """See `Flyable`."""
        await self._call("land", self._action.land)
        await self._mode(telemetry.FlightMode.LAND)

    async def return_home(self) -> None:
        """See `Flyable`."""
        await self._call("return", self._action.return_to_launch)
        await self._mode(telemetry.FlightMode.RETURN_TO_LAUNCH)

    async def follow(self, setpoint: Setpoint) -> None:
        """See `Flyable`."""
        yaw_deg = math.degrees(setpoint.yaw_ned_rad)
        place = offboard.PositionNedYaw(*setpoint.position_ned_m, yaw_deg)
        rate = offboard.VelocityNedYaw(*setpoint.velocity_ned_mps, yaw_deg)
        push = offboard.AccelerationNed(*setpoint.acceleration_ned_mps2)
        put = self._offboard.set_position_velocity_acceleration_ned
        await self._call("take a setpoint", lambda: put(place, rate, push))
        if not self._following:
            await asyncio.sleep(_STREAM_FIRST_S)
            await self._call("start offboard control", self._offboard.start)
            self._following = True
            await self._until(
                lambda: self._telemetry.flight_mode() == telemetry.FlightMode.OFFBOARD, "in offboard mode"
            )

    async def close(self) -> None:
        """See `Flyable`. The plugins go with it."""
        for plugin in (self._action, self._offboard, self._telemetry):
            plugin.destroy()

    async def _mode(self, mode: Any) -> None:
        self._following = False
        await self._until(lambda: self._telemetry.flight_mode() == mode, f"in {mode.name}")

    async def _until(self, condition: Callable[[], bool], what: str) -> None:
        end_s = time.monotonic() + _PATIENCE_S
        while not condition():
            if time.monotonic() > end_s:
                raise PeerTimeout(f"vehicle {self._sysid}: it was not {what} within {_PATIENCE_S:g} s.")
            await asyncio.sleep(_LOOK_S)


async def report(sysid: int, system: Any, autopilot: int, call: Call[Any]) -> VehicleReport:
    """What MAVSDK knows of a vehicle; it has no word on lost frames, round trips and most sensors.

    ArduPilot tells nothing unasked, so it is asked to tell, and goes on telling on this link.
    """
    told, versions = telemetry.Telemetry(system), info.Info(system)
    try:
        for name in ("health", "battery", "gps_info", "position", "landed_state"):
            await _or_none(call, f"tell its {name}", partial(getattr(told, f"set_rate_{name}"), _RATE_HZ))
        end_s = time.monotonic() + _TOLD_S
        while not _is_complete(told) and time.monotonic() < end_s:
            await asyncio.sleep(_LOOK_S)
        version = await _or_none(call, "tell its version", versions.get_version)
        identity = await _or_none(call, "tell its number", versions.get_identification)
        origin = await _or_none(call, "tell its origin", told.get_gps_global_origin)
        health, battery, place, fix = told.health(), told.battery(), told.position(), told.gps_info()
        home = told.home()
        share = battery.remaining_percent / 100.0
        calibrated = {
            "gyro": health.is_gyrometer_calibration_ok,
            "accelerometer": health.is_accelerometer_calibration_ok,
            "compass": health.is_magnetometer_calibration_ok,
        }
        return VehicleReport(
            sysid=sysid,
            system=int(system.get_system_id()),
            where="MAVSDK",
            autopilot=autopilot_name(autopilot),
            version=None if version is None else _version(version),
            uid=None if identity is None else str(identity.hardware_uid).rstrip("0") or None,
            mode=told.flight_mode().name,
            armed=bool(told.armed()),
            state=told.landed_state().name.lower(),
            prearm_ok=bool(health.is_armable),
            estimate_ok=bool(health.is_local_position_ok and health.is_global_position_ok),
            ailing=tuple(name for name, good in calibrated.items() if not good),
            home=_place(home.latitude_deg, home.longitude_deg, home.absolute_altitude_m),
            position=_place(place.latitude_deg, place.longitude_deg, place.absolute_altitude_m),
            origin=None if origin is None else _place(origin.latitude_deg, origin.longitude_deg, origin.altitude_m),
            satellites=int(fix.num_satellites),
            fix_type=int(fix.fix_type),
            battery_share=share if 0.0 <= share <= 1.0 else None,
            battery_V=battery.voltage_v if math.isfinite(battery.voltage_v) else None,
            loss=None,
            timesync=None,
            heartbeat_age_s=0.0 if system.is_connected() else math.inf,
        )
    finally:
        told.destroy()
        versions.destroy()


def _is_complete(told: Any) -> bool:
    place, home, battery = told.position(), told.home(), told.battery()
    known = (place.latitude_deg, home.latitude_deg, battery.remaining_percent)
    return bool(told.health().is_armable and all(math.isfinite(number) for number in known))


async def _or_none(call: Call[T], what: str, asked: Callable[[], T]) -> T | None:
    try:
        return await call(what, asked)
    except PeerError:
        return None


def _version(found: Any) -> str:
    numbers = f"{found.flight_sw_major}.{found.flight_sw_minor}.{found.flight_sw_patch}"
    return numbers + _VERSION_TYPES[int(found.flight_sw_version_type)]


def _place(lat_deg: float, lon_deg: float, alt_amsl_m: float) -> Home | None:
    if not all(math.isfinite(number) for number in (lat_deg, lon_deg, alt_amsl_m)):
        return None
    return Home(lat_deg, lon_deg, alt_amsl_m)
