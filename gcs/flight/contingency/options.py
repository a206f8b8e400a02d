"""The options of a flight and their defaults."""

from dataclasses import dataclass, field
from pathlib import Path

from gcs.flight.contingency.choices import FlightMode, OnLeaderLoss, OnLoss
from gcs.flight.contingency.detection import DetectionLimits
from gcs.flight.monitoring.preflight_check import CheckName
from gcs.flight.monitoring.volume_watch import VOLUMES, FlownVolumes

POSITION_HZ, STATE_HZ = 10.0, 2.0  # full telemetry rates; those of attitudes are half those of positions
_LEAST_STATE_HZ = 0.5


@dataclass(frozen=True)
class FlightOptions:
    """Timeouts are local time: links are real even if the vehicles are emulated."""

    mode: FlightMode = FlightMode.STREAM
    # How far ahead of the vehicles' clock setpoints are sent. Autopilots act on arrival, so 0 for them; emulated
    # vehicles hold a setpoint until its time, which makes a flight the same at any speed-up.
    lead_s: float = 0.0
    find_timeout_s: float = 15.0
    ready_timeout_s: float = 90.0
    phase_timeout_s: float = 60.0
    lost_after_s: float = 4.0
    # In mission mode: vehicle time from the upload to the provisional start, beside twice the take-off's duration.
    start_after_takeoff_s: float = 45.0
    telemetry_share: float = 1.0  # of the full telemetry rates: what the link carries
    watched_elsewhere: bool = False  # another ground station gets the frames: also those are requested that it shows
    follow: bool = False  # followers fly relative to the reported position of their leader
    on_loss: OnLoss = OnLoss.LAND
    on_leader_loss: OnLeaderLoss = OnLeaderLoss.PROMOTE
    waived: frozenset[CheckName] = frozenset()  # pre-flight checks that do not stop this flight
    volumes: FlownVolumes | None = None  # that a service supplier has for this flight
    texts_after_upload_s: float = 2.5  # vehicle time: so long a critical text about the upload may take
    limits: DetectionLimits = field(default_factory=DetectionLimits)

    def keep(self, folder: Path) -> None:
        """Write to a flight's folder what `gcs attach` must know of them, beside its `flight.json`."""
        if self.volumes is not None:
            self.volumes.save(folder / VOLUMES)

    @property
    def position_rate_hz(self) -> float:
        """How often a vehicle is asked to report its position."""
        return POSITION_HZ * self.telemetry_share

    @property
    def state_rate_hz(self) -> float:
        """How often a vehicle is asked to report its state: battery, sensors, fix, time."""
        return max(STATE_HZ * self.telemetry_share, _LEAST_STATE_HZ)
