"""Names of autopilots and of their modes, and how a vehicle on a link is flown, by the number in its HEARTBEAT."""

from __future__ import annotations

from gcs.autopilots.columns import FlightBehaviour
from gcs.autopilots.traits import titles, traits_of
from gcs.errors import PeerError
from gcs.mavlink import GENERIC_AUTOPILOT


def flight_behaviour(sysid: int, autopilot: int) -> FlightBehaviour:
    """Return how MAV_AUTOPILOT `autopilot` is flown. Raises PeerError for one that is not in the table."""
    row = traits_of(autopilot)
    if row is None:
        raise PeerError(
            f"vehicle {sysid} runs autopilot number {autopilot}; only {titles()} can be flown.",
            hint="export the missions with `gcs export` and fly them with its own ground station",
        )
    return row.flight


def autopilot_name(autopilot: int) -> str:
    """Return the name of MAV_AUTOPILOT `autopilot`."""
    row = traits_of(autopilot)
    if row is not None:
        return row.title
    return "generic" if autopilot == GENERIC_AUTOPILOT else f"autopilot {autopilot}"


def mode_name(autopilot: int, custom_mode: int) -> str:
    """Return the name of HEARTBEAT.custom_mode; a mode that is not known keeps its number."""
    row = traits_of(autopilot)
    return f"mode {custom_mode}" if row is None else row.flight.mode_name(custom_mode)
