"""The data of one vehicle's telemetry: its row of the fleet, its clock, and its position on Earth."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gcs.frames import LocalFrame, Origin, ned_to_geodetic, to_degE7
from gcs.types import Array
from sim_bridge.autopilot.autopilot import EmulatedAutopilot
from sim_bridge.autopilot.failsafe import Failsafe, Readings
from sim_bridge.dynamics.airframes import Airframes
from sim_bridge.personality import Milestone, Personality


class GeodeticPositions:
    """The geodetic positions of all vehicles, computed for all of them when the first is requested."""

    def __init__(self, airframes: Airframes, origin: Origin) -> None:
        self._airframes = airframes
        self._origin = origin
        self._known: dict[str, tuple[float, list[Origin]]] = {}  # when, and where

    def of(self, row: int, t_s: float) -> Origin:
        """Return the position that a vehicle estimates at the present time `t_s`."""
        return self._all("estimated", t_s, lambda: self._airframes.estimate[:, :3])[row]

    def fixed(self, row: int, t_s: float) -> Origin:
        """Return the last GNSS position of a vehicle at the present time `t_s`; the origin without a fix."""
        return self._all("fixed", t_s, lambda: np.nan_to_num(self._airframes.sensors.gnss[:, :3]))[row]

    def _all(self, which: str, t_s: float, ned_m: Callable[[], Array]) -> list[Origin]:
        if which not in self._known or self._known[which][0] != t_s:
            columns = ned_to_geodetic(ned_m(), self._origin)
            self._known[which] = t_s, [Origin(*place) for place in np.stack(columns, axis=-1).tolist()]
        return self._known[which][1]


def on_earth(place: Origin, *names: str) -> dict[str, int]:
    """Return latitude, longitude and altitude in the units of the wire, under these names."""
    values = to_degE7(place.lat_deg), to_degE7(place.lon_deg), round(place.alt_amsl_m * 1000.0)
    return dict(zip(names, values, strict=True))


@dataclass
class Instruments:
    """One row of a fleet's airframes, its clock and its position on Earth."""

    airframes: Airframes
    geodetic: GeodeticPositions
    row: int
    frame: LocalFrame  # LOCAL_NED of the vehicle
    origin: Origin
    boot_offset_ms: int
    epoch_unix_us: int
    uid: bytes
    t_s: float = 0.0
    gnss_ahead_s: float = 0.0  # a fault
    sag_V: float = 0.0  # a fault

    def pass_to(self, t_s: float) -> None:
        """It is `t_s` now."""
        self.t_s = t_s

    def suffer(self, *, sag_V: float, gnss_ahead_s: float) -> None:
        """Have these faults from now on; 0 is none."""
        self.sag_V, self.gnss_ahead_s = sag_V, gnss_ahead_s

    @property
    def estimate(self) -> Array:
        """Estimated state (12,), common local NED."""
        return np.asarray(self.airframes.estimate[self.row])

    @property
    def healthy(self) -> bool:
        """Whether the estimate is good enough to fly on."""
        return bool(self.airframes.healthy[self.row])

    @property
    def boot_ms(self) -> int:
        """The boot clock: milliseconds since the vehicle's boot."""
        return round(self.t_s * 1000.0) + self.boot_offset_ms

    def simulated_s(self, boot_ms: int) -> float:
        """Return the simulated time of a time of the boot clock."""
        return (boot_ms - self.boot_offset_ms) / 1000.0

    @property
    def unix_us(self) -> int:
        """GNSS time: the same for all vehicles, unless it has jumped."""
        return self.epoch_unix_us + round((self.t_s + self.gnss_ahead_s) * 1e6)

    @property
    def unix_at_0_s(self) -> float:
        """GNSS time at simulated time 0, by the vehicle's present clock."""
        return self.epoch_unix_us / 1e6 + self.gnss_ahead_s

    @property
    def here(self) -> Origin:
        """The estimated position."""
        return self.geodetic.of(self.row, self.t_s)

    @property
    def fixed(self) -> Origin:
        """The last GNSS position."""
        return self.geodetic.fixed(self.row, self.t_s)

    def place(self, ned_m: Array) -> Origin:
        """Return the geodetic position of a point in common local NED."""
        lat, lon, alt = ned_to_geodetic(ned_m, self.origin)
        return Origin(float(lat), float(lon), float(alt))

    @property
    def gnss(self) -> Array:
        """The last GNSS measurement (6,): position and velocity, common local NED."""
        return np.asarray(self.airframes.sensors.gnss[self.row])

    @property
    def has_fix(self) -> bool:
        """Whether the receiver has a fix."""
        return bool(self.airframes.gnss_fix[self.row])

    @property
    def capacity_mAh(self) -> float:
        """Capacity of the battery."""
        return 1000.0 * self.airframes.battery.train.capacity_Ah

    @property
    def battery(self) -> tuple[float, float, float, float]:
        """Volt, ampere, remaining share of the charge, Ah drawn."""
        battery, row = self.airframes.battery, self.row
        volt, ampere, left = battery.voltage_V[row], battery.current_A[row], battery.remaining[row]
        return float(volt) - self.sag_V, float(ampere), float(left), float(battery.used_Ah[row])

    @property
    def used_J(self) -> float:
        """Energy drawn from the battery."""
        return float(self.airframes.battery.used_J[self.row])

    @property
    def readings(self) -> Readings:
        """The measurements that failsafes check."""
        volt, _, share, used_Ah = self.battery
        left_Ah = share * self.airframes.battery.train.capacity_Ah
        return Readings(self.estimate[:3], volt, used_Ah, left_Ah, share, self.healthy)


@dataclass(frozen=True)
class Sources:
    """The parts of one vehicle that telemetry reads."""

    instruments: Instruments
    autopilot: EmulatedAutopilot
    failsafe: Failsafe
    personality: Personality

    def reached(self, milestone: Milestone) -> bool:
        """Whether the vehicle has reached this milestone of its start-up."""
        return self.autopilot.readiness.reached(milestone)


Fields = dict[str, object]  # of one message
Builder = Callable[[Sources], Fields | None]  # None: no data yet
