"""The simulation loop over all vehicles of a scenario: physics, autopilots, MAVLink, and the pace of time.

A step is 20 ms of simulated time. `speedup` sets how fast steps follow one another. Three things slow them down:
- commands: while an armed vehicle is idle, or no vehicle is armed, time runs at most at `WAITING_RATE` times real
  time. Ground stations answer in real time, and 10 s until disarming would be 0.2 s;
- the ground station: above real time a vehicle that follows stamped setpoints waits for the next one, and all wait
  until the station has read what they sent (`Lockstep`, `GroundEcho`), so that a flight is the same at any speed-up;
- the machine: a step it cannot do in time is made up for later, up to a limit (`Pace`).

A station on a `lockstep` link has a turn at every instant instead, and no clock but the vehicles': wall time then only
sets the pace, and the flight is the same to the last bit.
"""

import math
import tempfile
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np

from gcs.errors import GcsError
from gcs.link.wire.signing_keys import signing_ticks
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array
from sim_bridge.autopilot.guidance.piece import PieceBatch
from sim_bridge.dynamics.airframes import CONTROL_PERIOD_S, Airframes
from sim_bridge.dynamics.wind_field import CALM, Wind
from sim_bridge.faults.fault_spec import Fault
from sim_bridge.faults.injector import FaultInjector
from sim_bridge.personality import Personality
from sim_bridge.protocol.endpoint_address import CALL_GROUND, EndpointSpec, PeerAddress
from sim_bridge.protocol.switchboard import Switchboard
from sim_bridge.sim.traffic import Traffic
from sim_bridge.sim.vehicle_factory import VehicleFactory

TIMEOUT_S = 3.0
ON_GROUND_TIMEOUT_S = 0.3  # nothing happens there; and the station may have ended, and another one begun
REMIND_S = 0.03
CATCH_UP_S = 0.1  # of wall time
WAITING_RATE = 10.0
OFF_S = 1.0  # duration of a restart
_TURN_S = 0.1  # of wall time: so often `stop` is looked for in a turn of the station
_READING = -1  # beside the rows that wait for setpoints: all wait until the ground station has read
_STEPS_PER_S = round(1.0 / CONTROL_PERIOD_S)


@dataclass(frozen=True)
class WorldOptions:
    """The options of a run. `epoch_unix_s` is the GNSS time at simulated time 0."""

    links: Sequence[EndpointSpec] = (CALL_GROUND,)
    speedup: float = 1.0  # simulated seconds per second; inf for as fast as the machine can
    seed: int = 0
    faults: Mapping[int, Sequence[Fault]] = field(default_factory=dict)  # by system id
    epoch_unix_s: float | None = None  # default: now
    record_truth: bool = False
    personality: Personality | None = None  # of all vehicles; None: those of the scenario
    ideal: bool = False  # fly missions on time, as no real autopilot does
    wind: Wind = CALM
    signing_key: bytes | None = field(default=None, repr=False)  # of all vehicles
    clock: Callable[[], float] = time.monotonic  # wall time


class World:
    """The vehicles of a scenario, their time and their addresses.

    `places` are the addresses by system id, `t_s` is simulated time, `airframes` have the true states. `step` advances
    by one step; `run` goes on until `stop` is called (from a signal handler or another thread).
    """

    def __init__(self, scenario: Scenario, options: WorldOptions | None = None) -> None:
        """Put the vehicles on their pads and open their endpoints. Raises `LinkError` or `UsageError`."""
        self.options = options = options or WorldOptions()
        epoch_s = time.time() if options.epoch_unix_s is None else options.epoch_unix_s
        o = options
        self._factory = factory = VehicleFactory(scenario, o.personality, o.seed, epoch_s, ideal=o.ideal, wind=o.wind)
        self._steps = 0
        self._board = Switchboard(options.links, factory.sysids)
        self._lockstep_line = self._board.lockstep
        self.sysids = factory.sysids
        self.airframes = factory.airframes
        self.vehicles = [factory.vehicle(row) for row in range(len(self.sysids))]
        if options.signing_key is not None:
            for vehicle in self.vehicles:
                vehicle.sign(options.signing_key, signing_ticks(), self._clock())
        self._stopped = False
        self._calls: deque[Callable[[], None]] = deque()
        self._pace = Pace(options.speedup)
        self._lockstep = Lockstep()
        self._batch = PieceBatch([vehicle.autopilot.path.piece for vehicle in self.vehicles])
        boot_s = [ms / 1000.0 for ms in factory.boot_ms]
        self.truth = TruthRecord(self.sysids, boot_s, epoch_s) if options.record_truth else None
        self.injector = FaultInjector(self.vehicles, self.airframes, options.faults, options.seed, self._reboot)
        self.traffic = Traffic(self._board, self.vehicles, self.injector, self._clock)
        self.places: dict[int, list[PeerAddress]] = {s: self._board.places(row) for row, s in enumerate(self.sysids)}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the endpoints."""
        self._board.close()

    @property
    def ports(self) -> dict[int, int]:
        """The port of each vehicle on the first link that has ports."""
        numbered = {s: [place for place in places if place.port] for s, places in self.places.items()}
        return {sysid: places[0].port for sysid, places in numbered.items() if places}

    @property
    def t_s(self) -> float:
        """Simulated time since the vehicles were put on their pads."""
        return self._steps / _STEPS_PER_S  # exactly the double of a stamp in milliseconds / 1000

    def _clock(self) -> float:
        """The station's time, which protocol timers run on."""
        return self.options.clock() if self._lockstep_line is None else self.t_s

    def stop(self) -> None:
        """Make `run` return after the present step."""
        self._stopped = True

    def call(self, work: Callable[[], None]) -> None:
        """Call `work` between two steps; for other threads."""
        self._calls.append(work)

    def run(self, until_s: float = math.inf) -> None:
        """Run at the given speed-up until simulated time `until_s` or `stop`."""
        while not self._stopped and self._steps < until_s * _STEPS_PER_S:
            while self._calls:
                self._calls.popleft()()
            now_s = self.options.clock()
            wait_s = self._pace.wait_s(self.t_s, now_s, self._rate())
            if self._lockstep_line is not None and not wait_s and self._lockstep_line.waits(self.t_s):
                if self._lockstep_line.ended:
                    return
                wait_s = _TURN_S
            elif self._lockstep_line is None and not wait_s and self.options.speedup > 1.0:
                wait_s = self._ground_wait_s(now_s)
            if wait_s > 0.0:
                self._listen(wait_s)
            else:
                self.step()

    def step(self) -> None:
        """Run one control period without waiting: receive, decide, move, send."""
        self._listen(0.0)
        now_s, t_s = self._clock(), self.t_s
        vehicles, landed = self.vehicles, self.airframes.landed.tolist()
        self.injector.step(t_s)
        self.traffic.carry(t_s, now_s)
        for row, vehicle in enumerate(vehicles):
            messages = vehicle.step(t_s, now_s, landed[row])
            if messages:
                self.traffic.send(row, messages, t_s)
            self._batch.put(row, vehicle.autopilot.path.piece)
        self._board.flush(now_s)
        if self._lockstep_line is not None:  # the station thinks while the bodies move, and for the next step
            self._lockstep_line.end_turn(t_s, *((self._steps + later) / _STEPS_PER_S for later in (1, 2)))
        if self.truth is not None:
            autopilots = [vehicle.autopilot for vehicle in vehicles]
            self.truth.add(t_s, self.airframes, [(p.armed, p.flying, p.mode.number) for p in autopilots])
        motors_on = np.array([vehicle.autopilot.flying for vehicle in vehicles])
        self.airframes.step(self._batch.reference(t_s), motors_on)
        self._steps += 1

    def _reboot(self, row: int) -> None:
        """Restart an autopilot. Its motors stop, wherever the vehicle is."""
        on_s = self.t_s + OFF_S
        vehicle = self._factory.vehicle(row, on_s)
        vehicle.restart(self.vehicles[row], on_s)
        self.vehicles[row] = vehicle
        self.traffic.restarted(row)

    def _rate(self) -> float:
        if self._lockstep_line is not None:
            return self.options.speedup
        autopilots = [vehicle.autopilot for vehicle in self.vehicles]
        under_way = any(autopilot.flying for autopilot in autopilots) and not any(
            autopilot.awaits_orders for autopilot in autopilots
        )
        return self.options.speedup if under_way else min(self.options.speedup, WAITING_RATE)

    def _ground_wait_s(self, now_s: float) -> float:
        t_s = self.t_s
        newest_s = {row: self._awaits_after_s(row, t_s) for row in range(len(self.vehicles))}
        newest_s[_READING] = self.traffic.unread_after_s(t_s)
        timeout_s = None if any(vehicle.autopilot.armed for vehicle in self.vehicles) else ON_GROUND_TIMEOUT_S
        wait_s = self._lockstep.wait_s({row: s for row, s in newest_s.items() if s is not None}, now_s, timeout_s)
        if self._lockstep.reminds(now_s):
            self.traffic.remind(t_s)
        return wait_s

    def _awaits_after_s(self, row: int, t_s: float) -> float | None:
        """The newest stamp of a vehicle that must extrapolate its setpoint stream; None for the others.

        On an impaired link the departure of the setpoint counts, because it may never arrive.
        """
        autopilot = self.vehicles[row].autopilot
        departure = self.traffic.departure(row, t_s) if autopilot.flying else None
        if departure is not None:
            return departure.stamp_s if departure.awaited_s <= t_s else None
        return autopilot.path.awaits_setpoint_after_s(t_s)

    def _listen(self, timeout_s: float) -> None:
        goes_on = self.traffic.listen(timeout_s, self.t_s)
        # A station that shares the time ends it with its link, at an instant that is the same in every flight.
        self._stopped |= not goes_on and self._lockstep_line is None


class TruthRecord:
    """Collects the true states of every step, for the assessment of a flight. Vehicles never see them.

    The file (.npz): `t_s` (N,) simulated; `t_unix_s` (N,) the same instants in the vehicles' GNSS time; `state`
    (V, N, 12) in common local NED; `control` (V, N, 4); `armed`, `flying` (V, N); `mode` (V, N); `sysid` (V,);
    `boot_offset_s` (V,), added to `t_s` for each vehicle's own clock.
    """

    def __init__(self, sysids: tuple[int, ...], boot_offset_s: list[float], epoch_unix_s: float) -> None:
        self._sysids = sysids
        self._boot_offset_s = boot_offset_s
        self._epoch_unix_s = epoch_unix_s
        self._t_s: list[float] = []
        self._states: list[Array] = []
        self._controls: list[Array] = []
        self._flags: list[list[tuple[bool, bool, int]]] = []

    def add(self, t_s: float, airframes: Airframes, flags: list[tuple[bool, bool, int]]) -> None:
        """Record one time; `flags` are (armed, flying, mode) of every vehicle."""
        self._t_s.append(t_s)
        self._states.append(airframes.truth.copy())
        self._controls.append(airframes.control.copy())
        self._flags.append(flags)

    @property
    def t_s(self) -> Array:
        """Simulated times (N,)."""
        return np.array(self._t_s)

    @property
    def state(self) -> Array:
        """True states (V, N, 12)."""
        return self._by_vehicle(self._states, 12)

    def save(self, path: Path) -> None:
        """Write the file atomically, replacing an earlier one. Raises `GcsError`."""
        t_s = self.t_s
        flags = np.array(self._flags, dtype=np.int64).reshape(len(t_s), len(self._sysids), 3)
        arrays: dict[str, Any] = {
            "t_s": t_s,
            "t_unix_s": t_s + self._epoch_unix_s,
            "state": self.state,
            "control": self._by_vehicle(self._controls, 4),
            "armed": flags[:, :, 0].astype(bool).T,
            "flying": flags[:, :, 1].astype(bool).T,
            "mode": flags[:, :, 2].T,
            "sysid": np.array(self._sysids),
            "boot_offset_s": np.array(self._boot_offset_s),
        }
        try:
            with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".npz", delete=False) as file:
                np.savez(file, **arrays)
            Path(file.name).replace(path)
        except OSError as error:
            raise GcsError(f"the true states cannot be written to {path}: {error.strerror}.") from error

    def _by_vehicle(self, rows: list[Array], width: int) -> Array:
        return np.array(rows).reshape(len(rows), len(self._sysids), width).swapaxes(0, 1)


class Lockstep:
    """How long simulated time waits for what the ground station has not sent yet. All times but stamps are wall time.

    After the timeout vehicles fly on without it. They wait again as soon as anything newer arrives. So a ground station
    that paused catches up, and is not late for the rest of the flight.
    """

    def __init__(self) -> None:
        self._given_up: dict[int, float] = {}  # newest stamp at the timeout
        self._until_s = math.inf
        self._remind_s = math.inf

    def wait_s(self, awaiting: Mapping[int, float], now_s: float, timeout_s: float | None = None) -> float:
        """Return how long to wait, by default `TIMEOUT_S` in all; 0 to go on.

        `awaiting`: the newest stamp of each peer that waits for a newer one.
        """
        self._given_up = {row: stamp for row, stamp in self._given_up.items() if awaiting.get(row) == stamp}
        if awaiting.keys() <= self._given_up.keys():
            self._until_s = self._remind_s = math.inf
            return 0.0
        if math.isinf(self._until_s):
            self._until_s = now_s + (TIMEOUT_S if timeout_s is None else timeout_s)
            self._remind_s = now_s + REMIND_S
        if now_s < self._until_s:
            return min(self._until_s, max(self._remind_s, now_s + 1e-3)) - now_s
        self._given_up = dict(awaiting)
        self._until_s = self._remind_s = math.inf
        return 0.0

    def reminds(self, now_s: float) -> bool:
        """Whether to send the time again: the message with it may have been lost."""
        if now_s < self._remind_s:
            return False
        self._remind_s = now_s + REMIND_S
        return True


class Pace:
    """Maps simulated time to the wall time when it is due. Both are arguments.

    Pacing is absolute: a late step is made up for, so nothing drifts. After a long stall only `CATCH_UP_S` is made up
    for, because a long burst would be worse than the lost time.
    """

    def __init__(self, rate: float) -> None:
        """`rate` is simulated seconds per second; inf never waits."""
        self._rate = rate
        self._t_s = 0.0
        self._now_s = -math.inf

    def wait_s(self, t_s: float, now_s: float, rate: float) -> float:
        """Return how long to wait until `t_s` is due at `rate`; 0 if it is due."""
        if rate != self._rate:
            self._rate, self._t_s, self._now_s = rate, t_s, now_s
        if math.isinf(rate):
            return 0.0
        due_s = self._now_s + (t_s - self._t_s) / rate
        if now_s - due_s > CATCH_UP_S:
            self._t_s, self._now_s = t_s, now_s
            return 0.0
        return max(due_s - now_s, 0.0)
