"""The vehicles that fly one plan together, with what they report and what is sent to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gcs.flight.contingency.options import FlightOptions
from gcs.flight.execution.order_carrier import hurried
from gcs.flight.execution.streamer import Streamer
from gcs.flight.execution.takeoff_landing import FlightVehicle, set_mode
from gcs.flight.monitoring.fleet_time import FleetTime
from gcs.flight.monitoring.monitor import Monitor
from gcs.flight.monitoring.predicted_tracks import PredictedTracks
from gcs.plan.trajectory.plan import Plan


@dataclass(frozen=True)
class FlyingFleet:
    """One plan, its vehicles by system id, their positions, their setpoints, their common time, and the options."""

    plan: Plan
    vehicles: Mapping[int, FlightVehicle]
    monitor: Monitor
    streamer: Streamer
    time: FleetTime
    options: FlightOptions
    tracks: PredictedTracks | None = None  # of vehicles that fly missions of their own

    async def land(self, sysid: int) -> None:
        """Order a vehicle to land, once, and end its stream. Raises as switching modes does."""
        vehicle = hurried(self.vehicles[sysid])
        await set_mode(vehicle, vehicle.behaviour.land)
        self.streamer.leave(sysid)
