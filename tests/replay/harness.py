"""One emulated vehicle without sockets: bytes in, messages out, on a clock that the caller turns."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gcs.frames import Origin, ned_to_geodetic
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message, Station
from gcs.mavlink import MavCommand, MessageId
from gcs.scenario.schema.scenario import Scenario, Terrain
from gcs.scenario.values import si
from sim_bridge.autopilot.guidance.piece import PieceBatch
from sim_bridge.dynamics.airframes import CONTROL_PERIOD_S
from sim_bridge.personality import Personality
from sim_bridge.sim.vehicle_factory import VehicleFactory

_LONGEST_BOOT_S = 60.0
_SIGNED = 0x01


@dataclass(frozen=True)
class Told:
    """What the vehicle said, and when on the harness's clock."""

    t_s: float
    message: Message
    signed: bool


class Harness:
    """One vehicle at `home`. `told` grows with everything it says; `t_s` is 0 when the scene begins.

    A vehicle that `boots` is switched on at that time of the scene; otherwise it has been ready for a while, and has
    said how things stand (the messages named in `standing`).
    """

    def __init__(
        self,
        personality: Personality,
        scenario: Scenario,
        vehicle: Station,
        home: Origin,
        *,
        boots_s: float | None,
        epoch_unix_s: float,
        standing: frozenset[str],
    ) -> None:
        self._standing = standing
        self.told: list[Told] = []
        self._boots = boots_s is not None
        self._start_s = 0.0 if boots_s is None else boots_s  # of the scene, when the vehicle's time is 0
        factory = VehicleFactory(_alone(scenario, vehicle, home), personality, 1, epoch_unix_s)
        self.airframes = factory.airframes
        self.vehicle = factory.vehicle(0, 0.0)
        self._codec = Codec(*self.vehicle.station)
        self._ground = Codec(255, 190)
        self._batch = PieceBatch([self.vehicle.autopilot.path.piece])
        self._steps = 0
        self._start_steps = 0
        if not self._boots:
            self._wait_until_ready()

    @property
    def t_s(self) -> float:
        """Time of the scene."""
        return self._start_s + (self._steps - self._start_steps) * CONTROL_PERIOD_S

    def prepare(self, custom_mode: int, intervals_s: Mapping[int, float], *, keep: frozenset[str]) -> None:
        """Let a ground station have set this mode before the scene, and asked for messages in these intervals.

        Messages that are not named are switched off, those in `keep` apart.
        """
        target = {"target_system": self.vehicle.station.sysid, "target_component": 1, "confirmation": 0}
        mode = {"target_system": self.vehicle.station.sysid, "base_mode": 1, "custom_mode": custom_mode}
        wanted = {int(number): -1 for number in MessageId if number.name not in keep}
        wanted |= {number: round(interval_s * 1e6) for number, interval_s in intervals_s.items()}
        self._ask(Message("SET_MODE", mode, 255, 190))
        for number, interval_us in wanted.items():
            fields = {f"param{n}": 0.0 for n in range(3, 8)}
            fields |= {"command": int(MavCommand.SET_MESSAGE_INTERVAL), "param1": number, "param2": interval_us}
            self._ask(Message("COMMAND_LONG", target | fields, 255, 190))
        self._settle()

    def receive(self, frame: bytes, t_s: float) -> None:
        """Hand the vehicle a frame at `t_s` of the scene."""
        if self._boots and t_s < self._start_s:
            return
        for message in self._codec.decode(frame):
            self._tell(t_s, self.vehicle.receive(message, self._now_s(t_s)))

    def run_until(self, t_s: float) -> None:
        """Let time pass."""
        while self.t_s <= t_s:
            self._step(self.t_s)

    def _step(self, now_s: float) -> None:
        vehicle, airframes = self.vehicle, self.airframes
        t_s = self._steps * CONTROL_PERIOD_S
        self._tell(now_s, list(vehicle.step(t_s, self._now_s(now_s), bool(airframes.landed[0]))))
        pilot = vehicle.autopilot
        if pilot.armed or not pilot.readiness.ready or not airframes.landed[0]:  # a body at rest stays where it is
            self._batch.put(0, pilot.path.piece)
            airframes.step(self._batch.reference(t_s), np.array([pilot.flying]))
        self._steps += 1

    def _tell(self, t_s: float, messages: list[Message]) -> None:
        for message in messages:
            frame = self._codec.encode(message, self.vehicle.signature(self._now_s(t_s)))
            signed = bool(frame[2] & _SIGNED)
            self.told += [Told(t_s, heard, signed) for heard in self._ground.decode(frame)]

    def _now_s(self, t_s: float) -> float:
        """The wall's clock: that of the scene, and of a time before it while the vehicle is made ready."""
        return max(t_s, -_LONGEST_BOOT_S)

    def _ask(self, message: Message) -> None:
        self.vehicle.receive(message, -_LONGEST_BOOT_S)

    def _wait_until_ready(self) -> None:
        while not self.vehicle.autopilot.readiness.ready:
            self._step(-math.inf)
            if self._steps * CONTROL_PERIOD_S > _LONGEST_BOOT_S:
                raise RuntimeError("the vehicle does not become ready")
        self._settle()

    def _settle(self) -> None:
        """Let it say what it has to say, before the scene begins; how things stand then is known."""
        for _ in range(round(1.0 / CONTROL_PERIOD_S)):
            self._step(-math.inf)
        self._start_steps = self._steps
        last = {one.message.name: one for one in self.told if one.message.name in self._standing}
        self.told[:] = [Told(0.0, one.message, one.signed) for one in last.values()]


def _alone(scenario: Scenario, vehicle: Station, home: Origin) -> Scenario:
    """The scenario with its first vehicle alone, on level ground that is `home` under it, and sensors that see that."""
    first = scenario.formation.vehicle[0].model_copy(update={"sysid": vehicle.sysid})
    exact = scenario.sensors.model_copy(update={"grade": "rtk"})
    formation = scenario.formation.model_copy(update={"vehicle": (first,), "leader": vehicle.sysid})
    alone = scenario.model_copy(update={"formation": formation, "terrain": Terrain(), "sensors": exact})
    pad_ned_m = si.pads_ned_m(alone)[0]
    lat, lon, alt = ned_to_geodetic(-pad_ned_m, home)
    place = {"lat_deg": float(lat), "lon_deg": float(lon), "alt_amsl_m": float(alt)}
    return alone.model_copy(update={"origin": scenario.origin.model_copy(update=place)})
