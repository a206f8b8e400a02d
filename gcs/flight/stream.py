"""All vehicles' setpoints from one clock: what is due to whom at this moment.

Knows: plan time, each vehicle's frame (its own pad) and its boot clock. Does not know: sockets, event loops.
Whoever stalls catches up with the newest point only: a stale setpoint is worse than none, a burst of them no better.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gcs.link.clock import VehicleClock
from gcs.link.dialect import SetpointMask, WireFrame
from gcs.link.message import Message, Station
from gcs.mission.model import SetpointStream
from gcs.quadrotor import Array

_STALE_S = 0.5


@dataclass
class VehicleStream:
    """One vehicle's share of the stream. `due` is called as often as one likes."""

    stream: SetpointStream
    row: int
    pad_ned_m: Array  # (3,) origin of the vehicle's own local frame
    t0_unix_s: float
    station: Station
    sent: int = 0
    skipped: int = 0

    def __post_init__(self) -> None:
        position = self.stream.position_ned_m[self.row] - self.pad_ned_m
        velocity, acceleration = self.stream.velocity_ned_mps[self.row], self.stream.acceleration_ned_mps2[self.row]
        yaw = self.stream.yaw_ned_rad[self.row][:, None]
        self._rows = np.hstack([position, velocity, acceleration, yaw]).tolist()
        self._times_s = self.stream.t_s.tolist()
        self._next = 0

    @property
    def finished(self) -> bool:
        """Everything was sent, the point at rest included."""
        return self._next >= len(self._times_s)

    @property
    def last_t_s(self) -> float:
        """Plan time of the last setpoint sent; -inf before the first."""
        return self._times_s[self._next - 1] if self._next else -math.inf

    def due(self, vehicle_unix_s: float, clock: VehicleClock, lead_s: float) -> list[Message]:
        """Messages for every point not later than `lead_s` ahead of the vehicle's time."""
        horizon_s = vehicle_unix_s - self.t0_unix_s + lead_s
        messages: list[Message] = []
        while not self.finished and self._times_s[self._next] <= horizon_s:
            stale = self._times_s[self._next] < horizon_s - lead_s - _STALE_S
            if stale and self._next + 1 < len(self._times_s):
                self.skipped += 1
            else:
                messages.append(self._message(self._next, clock))
            self._next += 1
        self.sent += len(messages)
        return messages

    def _message(self, index: int, clock: VehicleClock) -> Message:
        x, y, z, vx, vy, vz, ax, ay, az, yaw = self._rows[index]
        stamp_ms = clock.boot_ms(self.t0_unix_s + self._times_s[index])
        return Message(
            "SET_POSITION_TARGET_LOCAL_NED",
            {
                "time_boot_ms": stamp_ms or 0,
                "target_system": self.station.sysid,
                "target_component": self.station.compid,
                "coordinate_frame": int(WireFrame.LOCAL_NED),
                "type_mask": int(SetpointMask.POSITION_VELOCITY_ACCELERATION_YAW),
                "x": x,
                "y": y,
                "z": z,
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
