"""One picture of a flight under way, from what its vehicles report."""

import math

import numpy as np

from gcs.flight.monitoring.progress import InFlight, Snapshot, Step
from gcs.flight.scene.scene_curves import course_rad, neighbours
from gcs.flight.scene.scene_model import FlightPicture, VehiclePicture


def picture_of(flight: InFlight) -> FlightPicture:
    """Return how a flight stands now; nothing of it waits or computes for long."""
    snapshot, vehicles = flight.snapshot(), flight.vehicles_now()
    places = np.array([vehicle.place_ned_m for vehicle in vehicles]).reshape(-1, 1, 3)
    away_m, rows = neighbours(places)
    nearest = snapshot.nearest
    return FlightPicture(
        math.nan if snapshot.plan_time_s is None else snapshot.plan_time_s,
        _step_of(snapshot),
        tuple(
            VehiclePicture(
                now.sysid,
                now.place_ned_m,
                float(course_rad(np.array(now.velocity_ned_mps))),
                now.speed_mps,
                now.mode,
                now.armed,
                now.battery_pct,
                now.link_age_s,
                now.loss,
                now.error_m,
                now.above_ground_m,
                vehicles[int(rows[row, 0])].sysid if rows[row, 0] >= 0 else 0,
                float(away_m[row, 0]),
                now.in_band,
            )
            for row, now in enumerate(vehicles)
        ),
        snapshot.separation_m,
        (0, 0) if nearest is None else nearest.pair,
        snapshot.formation_error_m,
    )


def _step_of(snapshot: Snapshot) -> str:
    """The step of the flight, with the phase of the plan while it is flown."""
    is_over = snapshot.phase in (Step.LAND, Step.DONE) or not snapshot.plan_phase
    return snapshot.phase if is_over else f"{snapshot.phase}: {snapshot.plan_phase}"
