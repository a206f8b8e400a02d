"""All vehicles of a scenario in one loop: physics, decisions, conversation, and the pace of time.

Knows: the order of things within a step, and when to wait. Does not know: what vehicles decide or say.

Time. A step is 10 ms of simulated time. `speedup` says how fast steps follow one another; three things hold it
back:
- orders: while a vehicle stands armed or hovers with nothing to do, or nobody is armed at all, time runs at most
  `WAITING_RATE` times real time, because ground stations answer in real time (10 s to disarming would be 0.2 s);
- the stream: above real time a vehicle that flies stamped setpoints waits for the one that says how to go on, up
  to `STREAM_PATIENCE_S`, so that a flight is the same at any speed-up;
- the machine: what it cannot do in time is made up for later, within reason (`Pace`).
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Self

import numpy as np

from gcs.frames import Origin
from gcs.link.codec import Codec
from gcs.link.message import Message
from gcs.scenario import physical
from gcs.scenario.model import Scenario
from gcs.scenario.terrain import ground_height_m
from sim_bridge.airframes import CONTROL_PERIOD_S, Airframes
from sim_bridge.autopilot import Autopilot
from sim_bridge.course import Guide
from sim_bridge.faults import NO_FAULTS, Faults
from sim_bridge.gains import ControlLimits
from sim_bridge.guidance.limits import MotionLimits
from sim_bridge.guidance.piece import PieceBatch
from sim_bridge.pace import Pace
from sim_bridge.personality import Personality, by_name
from sim_bridge.sensors import GRADES
from sim_bridge.sockets import Address, Sockets
from sim_bridge.telemetry import Instruments, Whereabouts
from sim_bridge.truth import PERIOD_STEPS, TruthRecord
from sim_bridge.vehicle import Vehicle

WAITING_RATE = 10.0
STREAM_PATIENCE_S = 0.25
DEFAULT_GROUND: Address = ("127.0.0.1", 14550)
_STEPS_PER_S = round(1.0 / CONTROL_PERIOD_S)
_BOOT_SPREAD_MS = (5_000, 60_000)


@dataclass(frozen=True)
class FleetOptions:
    """How to run a fleet. `epoch_unix_s` is the GNSS time at simulated time 0."""

    ground: Address = DEFAULT_GROUND
    speedup: float = 1.0  # simulated seconds per second; inf for as fast as the machine can
    seed: int = 0
    faults: Mapping[int, Faults] = field(default_factory=dict)
    epoch_unix_s: float | None = None  # default: now
    record_truth: bool = False
    personality: Personality | None = None  # default: that of the scenario


class Fleet:
    """The emulated vehicles of a scenario, each at a port of its own.

    `ports` by system id; `t_s` simulated time; `airframes` with the true states; `step` to go on by hand, `run`
    to go on until `stop` is called (from a signal handler or another thread).
    """

    def __init__(self, scenario: Scenario, options: FleetOptions | None = None) -> None:
        """Put the vehicles on their pads and open their sockets. Raises `LinkError`."""
        self.options = options = options or FleetOptions()
        self.sysids = physical.sysids(scenario)
        personality = options.personality or by_name(scenario.mission.autopilot)
        quadrotor = physical.quadrotor(scenario)
        pads_ned_m = physical.pads_ned_m(scenario)
        yaw_rad = math.radians(scenario.start.roll_pitch_yaw_deg[2])
        limits = ControlLimits(scenario.limits.thrust_N[1], scenario.limits.torque)
        self.airframes = Airframes(
            quadrotor,
            partial(ground_height_m, scenario.terrain),
            pads_ned_m,
            np.full(len(pads_ned_m), yaw_rad),
            GRADES[scenario.sensors.grade],
            seed=options.seed,
            limits=limits,
        )
        self._steps = 0
        self._stopped = False
        self._watched = -1
        self._starved: set[int] = set()
        self._pace = Pace(options.speedup)
        self._wait_until_s = -math.inf
        epoch_s = time.time() if options.epoch_unix_s is None else options.epoch_unix_s
        random = np.random.default_rng([options.seed, 1])
        boot_ms = random.integers(*_BOOT_SPREAD_MS, len(self.sysids)).tolist()
        motion = MotionLimits.of(quadrotor, scenario.limits)
        origin = Origin(scenario.origin.lat_deg, scenario.origin.lon_deg, scenario.origin.alt_amsl_m)
        whereabouts = Whereabouts(self.airframes, origin)
        self.vehicles: list[Vehicle] = []
        for row, sysid in enumerate(self.sysids):
            pad_ned_m = pads_ned_m[row]
            guide = Guide(motion, origin, pad_ned_m, 1.0, 1.0, 1.0, 1.0, epoch_s)  # speeds come from the parameters
            instruments = Instruments(
                airframes=self.airframes,
                whereabouts=whereabouts,
                row=row,
                pad_ned_m=pad_ned_m,
                origin=origin,
                boot_offset_ms=boot_ms[row],
                epoch_unix_us=round(epoch_s * 1e6),
                uid=f"skein-{options.seed & 0xFFFF:04x}-{sysid:03d}".encode(),
            )
            pilot = Autopilot(personality, guide, yaw_rad)
            faults = options.faults.get(sysid, NO_FAULTS)
            self.vehicles.append(Vehicle(sysid, pilot, instruments, personality, faults))
        self._codecs = [Codec(*vehicle.station) for vehicle in self.vehicles]
        self._batch = PieceBatch([vehicle.autopilot.piece for vehicle in self.vehicles])
        self.truth = (
            TruthRecord(self.sysids, [ms / 1000.0 for ms in boot_ms], epoch_s) if options.record_truth else None
        )
        self._sockets = Sockets(len(self.sysids), options.ground)
        self.ports = dict(zip(self.sysids, self._sockets.ports, strict=True))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let the ports go."""
        self._sockets.close()

    @property
    def t_s(self) -> float:
        """Simulated time since the vehicles were put on their pads."""
        return self._steps / _STEPS_PER_S  # the same double as a stamp in milliseconds / 1000

    def stop(self) -> None:
        """Let `run` return after the present step."""
        self._stopped = True

    def stop_at_end_of(self, file: int) -> None:
        """Let `run` return when this file descriptor (standard input) ends, as it does when a parent dies."""
        self._watched = file
        self._sockets.watch(file)

    def run(self, until_s: float = math.inf) -> None:
        """Go on, in the pace asked for, until simulated time `until_s` or `stop`."""
        while not self._stopped and self._steps < until_s * _STEPS_PER_S:
            now_s = time.monotonic()
            wait_s = self._pace.wait_s(self.t_s, now_s, self._rate())
            if not wait_s and self._stream_is_due(now_s):
                wait_s = self._wait_until_s - now_s
            if wait_s > 0.0:
                self._listen(wait_s)
            else:
                self.step()

    def step(self) -> None:
        """Listen, decide, move, tell: one control period, whatever the wall's clock says."""
        self._listen(0.0)
        now_s, t_s = time.monotonic(), self.t_s
        vehicles, landed = self.vehicles, self.airframes.landed.tolist()
        for row, vehicle in enumerate(vehicles):
            messages = vehicle.step(t_s, now_s, landed[row])
            if messages:
                self._send(row, messages)
            self._batch.put(row, vehicle.autopilot.piece)
        if self.truth is not None and self._steps % PERIOD_STEPS == 0:
            pilots = [vehicle.autopilot for vehicle in vehicles]
            self.truth.add(t_s, self.airframes, [(p.armed, p.flying, p.mode.number) for p in pilots])
        motors_on = np.array([vehicle.autopilot.flying for vehicle in vehicles])
        self.airframes.step(self._batch.reference(t_s), motors_on)
        self._steps += 1

    def save_truth(self, path: Path) -> None:
        """Write the record asked for by `record_truth`. Raises `GcsError`."""
        if self.truth is not None:
            self.truth.save(path)

    def _rate(self) -> float:
        pilots = [vehicle.autopilot for vehicle in self.vehicles]
        under_way = any(pilot.flying for pilot in pilots) and not any(pilot.awaits_orders for pilot in pilots)
        return self.options.speedup if under_way else min(self.options.speedup, WAITING_RATE)

    def _stream_is_due(self, now_s: float) -> bool:
        """Whether to wait for a setpoint; each vehicle's stream is waited for once, until it goes on."""
        if self.options.speedup <= 1.0:
            return False
        t_s = self.t_s
        waiting = {row for row, v in enumerate(self.vehicles) if v.autopilot.awaits_setpoint(t_s)}
        self._starved &= waiting
        if not waiting - self._starved:
            self._wait_until_s = math.inf
            return False
        if math.isinf(self._wait_until_s):
            self._wait_until_s = now_s + STREAM_PATIENCE_S
        if now_s < self._wait_until_s:
            return True
        self._starved = waiting
        self._wait_until_s = math.inf
        return False

    def _listen(self, timeout_s: float) -> None:
        for row, data, sender in self._sockets.receive(timeout_s):
            if row < 0:
                self._stopped = self._stopped or not os.read(self._watched, 4096)
                continue
            messages = self._codecs[row].decode(data, sender)
            if messages:
                self._sockets.answer_at(row, sender)
                now_s = time.monotonic()
                for message in messages:
                    answers = self.vehicles[row].receive(message, now_s)
                    if answers:
                        self._send(row, answers)

    def _send(self, row: int, messages: Sequence[Message]) -> None:
        codec = self._codecs[row]
        self._sockets.send(row, [codec.encode(message) for message in messages])
