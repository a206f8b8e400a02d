"""Setpoints that are due, as MAVLink messages in each vehicle's own local frame and boot clock."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from gcs.flight.offboard.deadlines import Scheduler
from gcs.flight.offboard.deviation import SentSetpoints
from gcs.flight.offboard.reference_trajectory import ReferenceTrajectory, Values
from gcs.link.microservices.clock import VehicleClock
from gcs.link.wire.message import Message, Station
from gcs.mavlink import SetpointMask, WireFrame
from gcs.physics.quadrotor import Array


@dataclass
class Streamed:
    """One vehicle that setpoints are streamed to. Its `reference` may be exchanged at any time.

    While nothing is heard of it, the stream goes on by `fleet_unix_s`, the time of others, for `unheard_s`.
    """

    station: Station
    clock: VehicleClock
    pad_ned_m: Array  # (3,) origin of its own local frame
    reference: ReferenceTrajectory
    unheard_s: float = 0.0
    fleet_unix_s: Callable[[], float | None] = lambda: None
    sent: SentSetpoints = field(default_factory=SentSetpoints)

    @property
    def sysid(self) -> int:
        """Its MAVLink system id."""
        return self.station.sysid

    def now_unix_s(self, now_s: float) -> float | None:
        """The vehicle's time, by which its setpoints are due, at local time `now_s`."""
        reading = self.clock.reading(now_s)
        if reading is None:
            return None
        unix_s, stands = reading
        fleet_s = self.fleet_unix_s() if stands and self.unheard_s > 0.0 else None
        return unix_s if fleet_s is None else max(unix_s, min(fleet_s, self.clock.heard_unix_s + self.unheard_s))


def due_messages(scheduler: Scheduler, vehicle: Streamed, now_s: float) -> list[Message]:
    """Return the messages due to this vehicle at local time `now_s`."""
    vehicle_unix_s = vehicle.now_unix_s(now_s)
    if vehicle_unix_s is None:
        return []
    messages = (numbered_message(scheduler, vehicle, k) for k in scheduler.due(vehicle.sysid, vehicle_unix_s))
    return [message for message in messages if message is not None]


def numbered_message(scheduler: Scheduler, vehicle: Streamed, k: int) -> Message | None:
    """Return setpoint number `k` of the grid; None where the vehicle's reference has none."""
    t_s = scheduler.grid.at(k)
    values = vehicle.reference.at(k, t_s)
    if values is None:
        return None
    vehicle.sent.add(scheduler.t0_unix_s + t_s, values)
    stamp_ms = vehicle.clock.boot_ms(scheduler.t0_unix_s + t_s) or 0
    return setpoint_message(vehicle.station, stamp_ms, vehicle.pad_ned_m, values)


def send_due(
    scheduler: Scheduler, vehicles: Iterable[Streamed], send: Callable[[int, Message], None], now_s: float
) -> None:
    """Pass the messages due to all vehicles at `now_s` to `send`, each with its system id."""
    for vehicle in vehicles:
        for message in due_messages(scheduler, vehicle, now_s):
            send(vehicle.sysid, message)


def wait_s(scheduler: Scheduler, vehicles: Iterable[Streamed], now_s: float, longest_s: float) -> float:
    """Return the local seconds until the next deadline of any vehicle, `longest_s` at most."""
    least_s = longest_s
    for vehicle in vehicles:
        unix_s = vehicle.now_unix_s(now_s)
        if unix_s is not None:
            due_s = (scheduler.next_unix_s(vehicle.sysid) - unix_s) / max(vehicle.clock.rate, 1e-3)
            least_s = min(least_s, due_s)
    return max(least_s, 0.0)


def setpoint_message(station: Station, time_boot_ms: int, pad_ned_m: Array, values: Values) -> Message:
    """SET_POSITION_TARGET_LOCAL_NED with position, velocity, acceleration and yaw."""
    x, y, z, vx, vy, vz, ax, ay, az, yaw = values
    north_m, east_m, down_m = pad_ned_m
    return Message(
        "SET_POSITION_TARGET_LOCAL_NED",
        {
            "time_boot_ms": time_boot_ms,
            "target_system": station.sysid,
            "target_component": station.compid,
            "coordinate_frame": int(WireFrame.LOCAL_NED),
            "type_mask": int(SetpointMask.POSITION_VELOCITY_ACCELERATION_YAW),
            "x": x - float(north_m),
            "y": y - float(east_m),
            "z": z - float(down_m),
            "vx": vx,
            "vy": vy,
            "vz": vz,
            "afx": ax,
            "afy": ay,
            "afz": az,
            "yaw": yaw,
            "yaw_rate": 0.0,
        },
    )
