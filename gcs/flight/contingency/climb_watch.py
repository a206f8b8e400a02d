"""Watches that a vehicle climbs after its order to take off; a dead motor or a loose propeller shows here first.

In 57 recorded take-offs of ArduCopter 4.5.6 and PX4 1.17 the motors spin up for 3.2 to 4.5 s after the order was
accepted, and the vehicle is 1 m up after 4.5 to 5.8 s. `CLIMB_S` leaves the slowest of them 2 s more. No estimate sinks
faster than 0.21 m/s on the way to the hover; on the pad those of PX4 wander by 0.4 m. An ArduCopter with a dead motor
tumbled about its pad from 4.2 s on: it sank at 1.2 m/s 0.4 s later, and was tilted by 79 degrees after 5.2 s.
"""

import math

from gcs.link.wire.message import Message, local_motion
from gcs.mavlink import ModeFlag

CLIMB_M, CLIMB_S = 1.0, 8.0  # so high, or half the ordered height, within so much vehicle time
SINK_MPS = 0.8  # in two reports in a row
TILT_DEG = 60.0
GROUND_M, REST_MPS = 0.5, 0.5  # lower and slower it stands


class ClimbWatch:
    """Watches the climb of one vehicle from its accepted take-off; `failure` is empty, or the first fault in words.

    Faults are less than 1 m (or half the ordered height) within 8 s, sinking faster than 0.8 m/s in two reports, a tilt
    above 60 degrees, and motors that stopped.
    """

    def __init__(self, height_m: float, before: Message | None = None) -> None:
        """`before`: its last LOCAL_POSITION_NED on the pad; without it, the next one."""
        self.failure = ""
        self._wanted_m = min(CLIMB_M, height_m / 2.0)
        self._began_ms: int | None = None
        self._start_down_m = 0.0
        self._up_m = self._top_m = 0.0
        self._speed_mps = self._sinks_mps = 0.0
        self._was_armed = False
        if before is not None:
            self.receive(before)

    @property
    def on_ground(self) -> bool:
        """Whether it stands where it was armed, or lies there."""
        return self._up_m < GROUND_M and self._speed_mps < REST_MPS

    def receive(self, message: Message) -> None:
        """Take in a message of the vehicle."""
        fields = message.fields
        match message.name:
            case "LOCAL_POSITION_NED" if local_motion(message) is not None:
                self._moved(fields["time_boot_ms"], fields["z"], math.hypot(fields["vx"], fields["vy"], fields["vz"]))
                if min(self._sinks_mps, fields["vz"]) > SINK_MPS:
                    self._fails(f"sinks at {fields['vz']:.1f} m/s (limit {SINK_MPS:g} m/s) {self._up_m:.1f} m up")
                self._sinks_mps = fields["vz"]
            case "ATTITUDE" if all(abs(fields[name]) <= math.pi for name in ("roll", "pitch")):  # no damaged report
                tilt_deg = math.degrees(math.acos(math.cos(fields["roll"]) * math.cos(fields["pitch"])))
                if tilt_deg > TILT_DEG:
                    self._fails(f"is tilted by {tilt_deg:.0f} deg (limit {TILT_DEG:g} deg) {self._up_m:.1f} m up")
            case "HEARTBEAT":
                armed = bool(fields["base_mode"] & ModeFlag.ARMED)
                if self._was_armed and not armed:
                    self._fails(f"stopped its motors by itself {self._up_m:.1f} m up")
                self._was_armed = armed

    def _moved(self, boot_ms: int, down_m: float, speed_mps: float) -> None:
        if self._began_ms is None:
            self._began_ms, self._start_down_m = boot_ms, down_m
        self._up_m, self._speed_mps = self._start_down_m - down_m, speed_mps
        passed_s = (boot_ms - self._began_ms) / 1e3
        self._top_m = max(self._top_m, self._up_m)
        if passed_s > CLIMB_S and self._top_m < self._wanted_m:
            self._fails(f"does not climb: {self._up_m:.1f} m in {passed_s:.0f} s (required {self._wanted_m:.1f} m)")

    def _fails(self, words: str) -> None:
        self.failure = self.failure or words
