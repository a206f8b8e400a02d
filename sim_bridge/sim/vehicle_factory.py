"""Builds the vehicles of a scenario: bodies on their pads, and an autopilot for each."""

import math
from dataclasses import replace
from functools import partial

import numpy as np

from gcs.autopilots.local_frame import local_frame
from gcs.errors import UsageError
from gcs.frames import Origin
from gcs.physics.wind import STILL
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values import si
from sim_bridge.autopilot.autopilot import EmulatedAutopilot
from sim_bridge.autopilot.guidance.motion_primitives import MotionLimits
from sim_bridge.autopilot.guidance.path_generator import PathGenerator
from sim_bridge.dynamics.airframes import Airframes, Craft
from sim_bridge.dynamics.lqr_gains import ControlLimits
from sim_bridge.dynamics.presets import power_train_of
from sim_bridge.dynamics.sensors import GRADES
from sim_bridge.dynamics.wind_field import CALM, Wind
from sim_bridge.personality import Personality, by_name
from sim_bridge.protocol.conversation import Conversation
from sim_bridge.protocol.telemetry import GeodeticPositions, Instruments

LARGEST_SYSID = 254  # 255 is the ground station
_BOOT_SPREAD_MS = (5_000, 60_000)


class VehicleFactory:
    """Builds vehicles by row; `airframes` are all bodies, `boot_ms` the boot clocks at time 0."""

    def __init__(
        self,
        scenario: Scenario,
        personality: Personality | None,
        seed: int,
        epoch_unix_s: float,
        *,
        ideal: bool = False,
        wind: Wind = CALM,
    ) -> None:
        """Put the bodies on their pads. Raises `UsageError` for a system id above 254.

        `personality` is that of all vehicles; None: each has that of its autopilot in the scenario. `ideal` vehicles
        fly waypoints on time; others as the original autopilot does, where that may go both ways by the seed.
        """
        self.sysids = si.sysids(scenario)
        if max(self.sysids) > LARGEST_SYSID:
            raise UsageError(
                f"system id {max(self.sysids)} of {len(self.sysids)} vehicles is above {LARGEST_SYSID}, "
                "the highest a vehicle may have on one MAVLink network.",
                hint=f"fly at most {LARGEST_SYSID} vehicles, or run several sim-bridges on separate links",
            )
        self._personalities = [personality or by_name(known.key) for known in si.autopilots(scenario)]
        self._seed = seed
        self._epoch_s = epoch_unix_s
        quadrotor = replace(si.quadrotor(scenario), wind=STILL)  # the wind field provides the wind here
        self._pads_ned_m = si.pads_ned_m(scenario)
        self._yaw_rad = math.radians(scenario.start.roll_pitch_yaw_deg[2])
        self.airframes = Airframes(
            Craft(
                quadrotor,
                ControlLimits(scenario.limits.thrust_N[1], si.torque_limits(scenario.limits, quadrotor.arm_m)),
                power_train_of(quadrotor).described(scenario.vehicle.power),
            ),
            partial(ground_height_m, scenario.terrain),
            self._pads_ned_m,
            np.full(len(self.sysids), self._yaw_rad),
            GRADES[scenario.sensors.grade],
            seed=seed,
            wind=wind.over(si.steady_wind(scenario)),
        )
        self._motion = MotionLimits.of(quadrotor, scenario.limits)
        self._ideal = ideal
        self._origin = Origin(scenario.origin.lat_deg, scenario.origin.lon_deg, scenario.origin.alt_amsl_m)
        self._geodetic = GeodeticPositions(self.airframes, self._origin)
        random = np.random.default_rng([seed, 1])
        self._reactions: list[int] = np.random.default_rng([seed, 2]).integers(2, size=len(self.sysids)).tolist()
        self.boot_ms: list[int] = random.integers(*_BOOT_SPREAD_MS, len(self.sysids)).tolist()

    def vehicle(self, row: int, boot_s: float | None = None) -> Conversation:
        """Return the vehicle of a row in its initial state; its boot clock starts at simulated time `boot_s`."""
        pad_ned_m, sysid, personality = self._pads_ned_m[row], self.sysids[row], self._personalities[row]
        own = personality.autopilot.navigator.within(self._motion.ability)
        if own.reactions:  # each vehicle is at one end of what its autopilot may do
            own = own.reactions[self._reactions[row]]
        path_generator = PathGenerator(
            self._motion, self._origin, pad_ned_m, epoch_unix_s=self._epoch_s, navigator=None if self._ideal else own
        )
        instruments = Instruments(
            airframes=self.airframes,
            geodetic=self._geodetic,
            row=row,
            frame=local_frame(personality.autopilot, self._origin, pad_ned_m),
            origin=self._origin,
            boot_offset_ms=self.boot_ms[row] if boot_s is None else -round(boot_s * 1000.0),
            epoch_unix_us=round(self._epoch_s * 1e6),
            uid=f"skein-{self._seed & 0xFFFF:04x}-{sysid:03d}".encode(),
        )
        autopilot = EmulatedAutopilot(personality, path_generator, self._yaw_rad)
        return Conversation(sysid, autopilot, instruments, personality)
