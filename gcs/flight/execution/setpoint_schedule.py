"""Deadlines of setpoints, and their messages in the vehicle's local frame and boot clock. Time is an argument.

There is one grid of plan times for all vehicles, and a deadline is the k-th time of it, never "the last one plus a
period", so nothing drifts. After a delay only the newest setpoint is sent: a stale setpoint is worse than none, and a
burst is no better. While a vehicle's clock stands, nothing is due to it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from gcs.flight.contingency.manoeuvres import ReferenceTrajectory, Values
from gcs.flight.execution.leader_follower import SentSetpoints
from gcs.frames import LocalFrame
from gcs.link.protocols.clock import VehicleClock
from gcs.link.wire.message import Message, Station
from gcs.mavlink import SetpointMask, WireFrame
from gcs.types import Array


@dataclass(frozen=True)
class Grid:
    """Plan times by number: those of a stream (0 <= k < N), continued before and after with its period."""

    t_s: tuple[float, ...]
    period_s: float

    @classmethod
    def of(cls, t_s: Array, rate_hz: float) -> Grid:
        """Return the grid of a stream's plan times (N,)."""
        return cls(tuple(t_s.tolist()), 1.0 / rate_hz)

    def at(self, k: int) -> float:
        """Return plan time number `k`."""
        last = len(self.t_s) - 1
        if k < 0:
            return self.t_s[0] + k * self.period_s
        return self.t_s[k] if k <= last else self.t_s[last] + (k - last) * self.period_s

    def ahead_of(self, t_s: float) -> int:
        """Return the number of the first grid time after `t_s`."""
        k = math.floor((t_s - self.t_s[0]) / self.period_s)
        while self.at(k) > t_s:
            k -= 1
        while self.at(k) <= t_s:
            k += 1
        return k


@dataclass
class StreamProgress:
    """How far one vehicle's stream is. `late_s` are the last delays behind the deadline."""

    next: int
    end: int | None  # first number that is not sent; None: no end
    sent: int = 0
    skipped: int = 0
    late_s: deque[float] = field(default_factory=lambda: deque(maxlen=1000))

    @property
    def finished(self) -> bool:
        """Whether everything was sent, including the last setpoint at rest."""
        return self.end is not None and self.next >= self.end


class Scheduler:
    """Which setpoints of the grid are due to which vehicle. Times are of the vehicle's own clock.

    `lead_s`: how far ahead of its time a setpoint is sent; `lags_s`: how much earlier still, by system id.
    `keep_s`: how long after its time a setpoint is still sent beside newer ones: 0 for vehicles that act on arrival,
    more for those that act at the stamp.
    """

    def __init__(
        self,
        grid: Grid,
        t0_unix_s: float,
        *,
        lead_s: float = 0.0,
        keep_s: float = 0.0,
        lags_s: Mapping[int, float] | None = None,
    ) -> None:
        self.grid = grid
        self.t0_unix_s = t0_unix_s
        self.streams: dict[int, StreamProgress] = {}
        self._lead_s = lead_s
        self._lags_s = lags_s or {}
        self._keep_s = keep_s

    def start(self, sysid: int, first: int, end: int | None) -> None:
        """Stream to a vehicle from number `first` on; `end` as in `StreamProgress`."""
        self.streams[sysid] = StreamProgress(first, end)

    def move(self, t0_unix_s: float, unix_s: float) -> None:
        """Move T0. Streams that are not finished go on with the first setpoint after `unix_s`."""
        self.t0_unix_s = t0_unix_s
        for stream in self.streams.values():
            if not stream.finished:
                stream.next = self.grid.ahead_of(unix_s - t0_unix_s)

    def stream_on(self, sysid: int, unix_s: float) -> None:
        """Stream to a vehicle without end: from now on where it gets nothing."""
        if sysid not in self.streams or self.streams[sysid].finished:
            self.start(sysid, self.grid.ahead_of(unix_s - self.t0_unix_s), None)
        self.streams[sysid].end = None

    def follow(self, grid: Grid) -> None:
        """Take the grid of a longer or shorter plan: what ended with the old one ends with this one."""
        ended, self.grid = len(self.grid.t_s), grid
        for stream in self.streams.values():
            stream.end = len(grid.t_s) if stream.end == ended else stream.end

    def stop(self, sysid: int) -> None:
        """Stop the stream to a vehicle."""
        self.streams.pop(sysid, None)

    @property
    def finished(self) -> bool:
        """Whether all streams are finished."""
        return all(stream.finished for stream in self.streams.values())

    def next_unix_s(self, sysid: int) -> float:
        """Return the next deadline of a vehicle, by its own clock; inf for none."""
        stream = self.streams.get(sysid)
        if stream is None or stream.finished:
            return math.inf
        return self._deadline_s(sysid, stream.next)

    def missing_s(self, unix_s: float) -> float:
        """Return how much older than `unix_s` the newest setpoint of any unfinished stream is; 0 if none is older."""
        newest = [self.grid.at(one.next - 1) for one in self.streams.values() if not one.finished]
        return max(unix_s - self.t0_unix_s - min(newest), 0.0) if newest else 0.0

    def due(self, sysid: int, vehicle_unix_s: float) -> list[int]:
        """Return the numbers to send now, oldest first; each is due once."""
        stream = self.streams.get(sysid)
        if stream is None:
            return []
        numbers = []
        while not stream.finished and self._deadline_s(sysid, stream.next) <= vehicle_unix_s:
            numbers.append(stream.next)
            stream.next += 1
        if not numbers:
            return []
        fresh_s = vehicle_unix_s - self.t0_unix_s - self._keep_s
        kept = [k for k in numbers[:-1] if self._keep_s > 0.0 and self.grid.at(k) >= fresh_s]
        kept.append(numbers[-1])
        stream.sent += len(kept)
        stream.skipped += len(numbers) - len(kept)
        stream.late_s.append(vehicle_unix_s - self._deadline_s(sysid, numbers[-1]))
        return kept

    def advance(self, sysid: int) -> int | None:
        """Return the next number, due or not, for vehicles that keep it until its stamp; None after the last."""
        stream = self.streams.get(sysid)
        if stream is None or stream.finished:
            return None
        stream.next += 1
        stream.sent += 1
        return stream.next - 1

    def _deadline_s(self, sysid: int, k: int) -> float:
        """The only expression of a deadline, so that `next_unix_s` and `due` agree to the last bit."""
        return self.t0_unix_s + self.grid.at(k) - (self._lead_s + self._lags_s.get(sysid, 0.0))


@dataclass
class Streamed:
    """One vehicle that setpoints are streamed to.

    While nothing is heard of it, the stream goes on by `fleet_unix_s`, the time of others, for `unheard_s`.
    """

    station: Station
    clock: VehicleClock
    frame: LocalFrame
    reference: ReferenceTrajectory
    unheard_s: float = 0.0
    fleet_unix_s: Callable[[], float | None] = lambda: None
    sent: SentSetpoints = field(default_factory=SentSetpoints)

    @property
    def sysid(self) -> int:
        """Its MAVLink system id."""
        return self.station.sysid

    def follow(self, reference: ReferenceTrajectory) -> None:
        """Stream another reference to it from now on."""
        self.reference = reference

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
    return setpoint_message(vehicle.station, stamp_ms, vehicle.frame, values)


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


_FIELDS = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw")


def setpoint_message(station: Station, time_boot_ms: int, frame: LocalFrame, values: Values) -> Message:
    """SET_POSITION_TARGET_LOCAL_NED with position, velocity, acceleration and yaw, in the vehicle's own frame."""
    place = frame.own_m(np.array(values[:3]))
    rates = np.array(values[3:9]) * np.tile(frame.counts, 2)
    return Message(
        "SET_POSITION_TARGET_LOCAL_NED",
        {
            "time_boot_ms": time_boot_ms,
            "target_system": station.sysid,
            "target_component": station.compid,
            "coordinate_frame": int(WireFrame.LOCAL_NED),
            "type_mask": int(SetpointMask.POSITION_VELOCITY_ACCELERATION_YAW),
            **dict(zip(_FIELDS, (*place.tolist(), *rates.tolist(), values[9]), strict=True)),
            "yaw_rate": 0.0,
        },
    )
