"""One vehicle before its flight: telemetry, readiness, the order to take off, and its modes."""

import asyncio
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from gcs.autopilots.columns import FlightBehaviour, LandingProfile
from gcs.autopilots.traits import traits_of
from gcs.errors import PeerError, PeerTimeout
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.execution.single_vehicle import until_mode
from gcs.flight.monitoring.expected_motion import landing_profiles
from gcs.flight.monitoring.monitor import VehicleView
from gcs.link.session.vehicle_session import VehicleSession
from gcs.mavlink import MavCommand, MessageId
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array
from gcs.util.aio import LOOK_S, each, until

# What another ground station shows of a vehicle, besides its heartbeat and what every flight requests.
WATCHED_IDS = (MessageId.GLOBAL_POSITION_INT, MessageId.VFR_HUD)
WATCHED_HZ = 2.0


@dataclass(frozen=True)
class FlightVehicle:
    """One vehicle of a flight: session, behaviour, row of the plan, last report."""

    session: VehicleSession
    behaviour: FlightBehaviour
    plan: Plan
    row: int
    view: VehicleView
    options: FlightOptions

    @property
    def sysid(self) -> int:
        """Its MAVLink system id."""
        return self.session.sysid

    @property
    def hover_ned_m(self) -> Array:
        """The position over its pad where it waits for the others (3,)."""
        end = self.plan.airborne_s
        return np.asarray(self.plan.states(np.array([end]))[self.row, 0, POSITION])

    @property
    def hover_height_m(self) -> float:
        """The height of that position above the pad."""
        return float(self.plan.pads_ned_m[self.row, 2] - self.hover_ned_m[2])


async def request_telemetry(vehicle: FlightVehicle) -> None:
    """Request positions, attitudes at half their rate, and the messages that show incidents, as the link carries them.

    A station that watches cannot request what it shows; a vehicle that refuses that flies all the same.
    """
    session, options = vehicle.session, vehicle.options
    await session.set_message_interval(MessageId.LOCAL_POSITION_NED, options.position_rate_hz)
    await session.set_message_interval(MessageId.ATTITUDE, options.position_rate_hz / 2.0)
    state = (session.estimator.message, MessageId.SYSTEM_TIME)
    for number in (*state, *vehicle.behaviour.health_ids):
        await session.set_message_interval(number, options.state_rate_hz)
    if options.watched_elsewhere:
        for number in WATCHED_IDS:
            with suppress(PeerError):
                await session.set_message_interval(number, WATCHED_HZ)


async def until_ready(vehicle: FlightVehicle) -> None:
    """Wait until a vehicle has a position estimate and reports GNSS time. Raises PeerTimeout."""
    session, options = vehicle.session, vehicle.options
    await session.wait_for(
        lambda message: session.estimator.is_ready(message.name, message.fields),
        options.ready_timeout_s,
        "a position estimate",
        or_latest=True,
    )
    loop = asyncio.get_running_loop()
    end_s = loop.time() + options.find_timeout_s
    while not session.clock.ready:
        if loop.time() > end_s:
            raise PeerTimeout(
                f"vehicle {session.sysid} did not report GNSS time (SYSTEM_TIME) within {options.find_timeout_s:g} s.",
                hint="wait for its GNSS fix: a formation needs a common time to start",
            )
        await asyncio.sleep(LOOK_S)


async def until_placed(vehicle: FlightVehicle) -> None:
    """Wait until a vehicle has reported its position. Raises PeerTimeout."""
    view, sysid = vehicle.view, vehicle.sysid
    timeout_s = vehicle.options.find_timeout_s
    await until(lambda: bool(np.isfinite(view.position_ned_m).all()), timeout_s, f"a position of vehicle {sysid}")


def lacks(session: VehicleSession) -> str:
    """What `until_ready` still waits for on this vehicle, in words; empty if it is ready."""
    if not any(session.estimator.is_ready(message.name, message.fields) for message in session.latest.values()):
        return "no position estimate"
    return "" if session.clock.ready else "no GNSS time"


async def expected_landings(vehicles: Iterable[FlightVehicle]) -> dict[int, LandingProfile]:
    """Return how each vehicle will land, from the parameters it reports, or else from its autopilot's defaults."""
    known: dict[int, dict[str, float]] = {}

    async def ask(vehicle: FlightVehicle) -> None:
        row = traits_of(vehicle.session.autopilot)
        with suppress(PeerError):
            found = await vehicle.session.read_parameters(tuple(row.landing.parameters if row is not None else ()))
            known[vehicle.sysid] = {name: float(one.value) for name, one in found.items()}

    fleet = tuple(vehicles)
    await each(fleet, ask)
    return landing_profiles({vehicle.sysid: vehicle.session.autopilot for vehicle in fleet}, known)


async def take_off(vehicle: FlightVehicle) -> None:
    """Order an armed vehicle to climb to the hover over its pad. Raises CommandRefused, PeerTimeout."""
    pad_up_m = -float(vehicle.plan.pads_ned_m[vehicle.row, 2])
    home_amsl_m = vehicle.plan.scenario.origin.alt_amsl_m + pad_up_m
    parameters = vehicle.behaviour.takeoff_parameters(vehicle.hover_height_m, home_amsl_m)
    await vehicle.session.command(MavCommand.NAV_TAKEOFF, *parameters)


async def set_mode(vehicle: FlightVehicle, mode: int) -> None:
    """Request a mode and wait until the HEARTBEAT shows it. Raises CommandRefused, PeerTimeout."""
    await until_mode(vehicle.session, vehicle.behaviour, mode, vehicle.options.phase_timeout_s)


async def start_mission(vehicle: FlightVehicle) -> None:
    """Start the mission of an airborne vehicle and wait until the HEARTBEAT shows it. Raises as `set_mode` does."""
    m = vehicle.behaviour
    await until_mode(vehicle.session, m, m.mission, vehicle.options.phase_timeout_s, MavCommand.MISSION_START)
