"""MAVSDK's control of a vehicle in flight, and its status report.

MAVSDK repeats setpoints by itself, 20 times a second, with its own time stamps.
"""

import asyncio
import math
import time
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Protocol, TypeVar

import mavsdk
from mavsdk.plugins import action, info, offboard, telemetry

from gcs.autopilots.traits import TRAITS, autopilot_name
from gcs.errors import PeerError, PeerTimeout
from gcs.link.session.status_report import VehicleReport
from gcs.link.session.vehicle_api import Setpoint
from gcs.mission.model import Home

T = TypeVar("T")
_TIMEOUT_S = 10.0
_REPORT_S, _RATE_HZ = 3.0, 5.0
_STREAM_FIRST_S = max(row.flight.stream_first_s for row in TRAITS.values())
_LOOK_S = 0.05
_VERSION_TYPES = ("?", "-dev", "-alpha", "-beta", "-rc", "")


class Call(Protocol):
    """Runs a blocking call of MAVSDK; `what` is its purpose."""

    def __call__(self, what: str, blocking: Callable[[], T], /) -> Awaitable[T]:
        """Return the result of the call."""


class MavsdkControl:
    """`Flyable` by MAVSDK."""

    def __init__(self, sysid: int, system: mavsdk.System, call: Call) -> None:
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
        await self._call("set the take-off height", lambda: self._action.set_takeoff_altitude(height_m))
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
        position = offboard.PositionNedYaw(*setpoint.position_ned_m, yaw_deg)
        velocity = offboard.VelocityNedYaw(*setpoint.velocity_ned_mps, yaw_deg)
        acceleration = offboard.AccelerationNed(*setpoint.acceleration_ned_mps2)
        send = self._offboard.set_position_velocity_acceleration_ned
        await self._call("take a setpoint", lambda: send(position, velocity, acceleration))
        if not self._following:
            await asyncio.sleep(_STREAM_FIRST_S)
            await self._call("start offboard control", self._offboard.start)
            self._following = True
            await self._until(
                lambda: self._telemetry.flight_mode() == telemetry.FlightMode.OFFBOARD, "in offboard mode"
            )

    async def close(self) -> None:
        """See `Flyable`. Destroys the plugins."""
        for plugin in (self._action, self._offboard, self._telemetry):
            plugin.destroy()

    async def _mode(self, mode: telemetry.FlightMode) -> None:
        self._following = False
        await self._until(lambda: self._telemetry.flight_mode() == mode, f"in {mode.name}")

    async def _until(self, condition: Callable[[], bool], what: str) -> None:
        end_s = time.monotonic() + _TIMEOUT_S
        while not condition():
            if time.monotonic() > end_s:
                raise PeerTimeout(f"vehicle {self._sysid} was not {what} within {_TIMEOUT_S:g} s.")
            await asyncio.sleep(_LOOK_S)


async def report(sysid: int, system: mavsdk.System, autopilot: int, call: Call) -> VehicleReport:
    """Return the report of a vehicle by MAVSDK, which does not report lost frames, round trips and most sensors.

    ArduPilot sends no telemetry unless requested. The requested rates stay set on this link.
    """
    state, versions = telemetry.Telemetry(system), info.Info(system)
    try:
        for name in ("health", "battery", "gps_info", "position", "landed_state"):
            await _or_none(call, f"report its {name}", partial(getattr(state, f"set_rate_{name}"), _RATE_HZ))
        end_s = time.monotonic() + _REPORT_S
        while not _is_complete(state) and time.monotonic() < end_s:
            await asyncio.sleep(_LOOK_S)
        version = await _or_none(call, "report its version", versions.get_version)
        identity = await _or_none(call, "report its id", versions.get_identification)
        origin = await _or_none(call, "report its origin", state.get_gps_global_origin)
        health, battery, position, fix = state.health(), state.battery(), state.position(), state.gps_info()
        home = state.home()
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
            mode=state.flight_mode().name,
            armed=bool(state.armed()),
            state=state.landed_state().name.lower(),
            prearm_ok=bool(health.is_armable),
            estimate_ok=bool(health.is_local_position_ok and health.is_global_position_ok),
            ailing=tuple(name for name, good in calibrated.items() if not good),
            home=_position(home.latitude_deg, home.longitude_deg, home.absolute_altitude_m),
            position=_position(position.latitude_deg, position.longitude_deg, position.absolute_altitude_m),
            origin=None if origin is None else _position(origin.latitude_deg, origin.longitude_deg, origin.altitude_m),
            satellites=int(fix.num_satellites),
            fix_type=int(fix.fix_type),
            battery_share=share if 0.0 <= share <= 1.0 else None,
            battery_V=battery.voltage_v if math.isfinite(battery.voltage_v) else None,
            loss=None,
            timesync=None,
            heartbeat_age_s=0.0 if system.is_connected() else math.inf,
        )
    finally:
        state.destroy()
        versions.destroy()


def _is_complete(state: telemetry.Telemetry) -> bool:
    position, home, battery = state.position(), state.home(), state.battery()
    known = (position.latitude_deg, home.latitude_deg, battery.remaining_percent)
    return bool(state.health().is_armable and all(math.isfinite(number) for number in known))


async def _or_none(call: Call, what: str, blocking: Callable[[], T]) -> T | None:
    try:
        return await call(what, blocking)
    except PeerError:
        return None


def _version(found: info.Version) -> str:
    numbers = f"{found.flight_sw_major}.{found.flight_sw_minor}.{found.flight_sw_patch}"
    return numbers + _VERSION_TYPES[int(found.flight_sw_version_type)]


def _position(lat_deg: float, lon_deg: float, alt_amsl_m: float) -> Home | None:
    if not all(math.isfinite(number) for number in (lat_deg, lon_deg, alt_amsl_m)):
        return None
    return Home(lat_deg, lon_deg, alt_amsl_m)
