"""A flight that lost its ground station: the instant of the plan it is nearest to, and its landing, return or rest."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from gcs.errors import FlightError, PeerError
from gcs.flight.contingency.choices import FlightMode
from gcs.flight.execution.fleet_landing import named
from gcs.flight.execution.flight import FlightSequence
from gcs.flight.execution.takeoff_landing import (
    FlightVehicle,
    expected_landings,
    request_telemetry,
    until_placed,
    until_ready,
)
from gcs.flight.monitoring.progress import Step
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array
from gcs.util.aio import alongside, each

NEAR_M = 3.0
FADE_S = 10.0
_STEP_S = 0.1


class Resume(StrEnum):
    """What is done with a flight that lost its ground station."""

    SHOW = "show"
    LAND = "land"
    RETURN = "return"
    RESUME = "resume"


@dataclass(frozen=True)
class Where:
    """The plan time whose positions are nearest, and the largest deviation of a vehicle from them."""

    t_s: float
    off_m: float


def where_in_plan(plan: Plan, positions_ned_m: Array) -> Where:
    """Return it for positions (V, 3), between the end of the take-off and the start of the landing.

    NaN is the position of a vehicle that is not heard: the others decide.
    """
    t_s = np.arange(plan.airborne_s, plan.landing_s, _STEP_S)
    places = plan.leader_trajectory.state(t_s)[:, POSITION] + plan.offsets(t_s)  # (V, N, 3)
    heard = np.isfinite(positions_ned_m).all(axis=1)
    off = np.linalg.norm(places[heard] - positions_ned_m[heard, None], axis=-1).max(axis=0, initial=0.0)
    best = int(np.argmin(off))
    return Where(float(t_s[best]), float(off[best]))


async def resume_flight(flight: FlightSequence, what: Resume, t0_unix_s: float | None) -> float | None:
    """Continue a flight that another process began and left; return T0. Raises as `FlightSequence.run` does.

    `t0_unix_s` is the T0 of that process, None if it had none yet.
    """
    return await flight.guarded(_resume(flight, what, t0_unix_s))


async def _resume(flight: FlightSequence, what: Resume, t0_unix_s: float | None) -> float | None:
    if what is Resume.LAND or (what is Resume.RESUME and not any(s.armed for s in flight.sessions.values())):
        await _land(flight)
        return t0_unix_s
    silent = [sysid for sysid, session in flight.sessions.items() if not session.heard]
    if what is Resume.RESUME and silent:
        raise FlightError(
            f"{named(silent)} not heard: the plan is resumed by all vehicles or by none.",
            hint="attach with --land or --return",
        )
    flight.resume_in_air()
    able = await _ready(flight, need_all=what is Resume.RESUME)
    await flight.prepare_contingency()
    for sysid in flight.vehicles.keys() - able:
        flight.contingency.never_heard(sysid)
    flight.monitor.expect_landings(await expected_landings(flight.vehicles[sysid] for sysid in able))
    await flight.time.settle()
    flight.time.hold()
    streams = flight.options.mode is FlightMode.STREAM
    if what is Resume.RESUME and not streams and t0_unix_s is not None:
        flight.streamer.stand_by(t0_unix_s)
        t0_new_s = t0_unix_s
    else:
        where = where_in_plan(flight.plan, np.array([v.view.position_ned_m for v in flight.vehicles.values()]))
        if what is Resume.RESUME and where.off_m > NEAR_M:
            raise FlightError(
                f"the vehicles are too far from the plan: at t = {where.t_s:.0f} s, the nearest instant, one is "
                f"{where.off_m:.1f} m off (limit {NEAR_M:g} m).",
                hint="attach with --land or --return",
            )
        t0_new_s = flight.streamer.continue_plan(where.t_s, FADE_S if what is Resume.RESUME else None)
    flight.landing.custody.take_up()
    async with alongside(flight.streamer.run()):
        if what is Resume.RESUME and streams:
            await each(flight.vehicles.values(), flight.streamer.enter_setpoint_mode)
        flight.enter(Step.FLY)
        async with alongside(flight.contingency.run()):
            await flight.watch_over(t0_new_s, return_all=what is Resume.RETURN)
    if what is Resume.RETURN and flight.vehicles.keys() - able:
        await flight.landing.land_all()  # those that could not return
    flight.enter_done()
    flight.landing.raise_failed_orders()
    if what is Resume.RESUME:
        flight.raise_troubles()
    return t0_new_s


async def _land(flight: FlightSequence) -> None:
    """Land all vehicles that are heard. Nothing is asked of them before: no answer may delay the order."""
    flight.landing.custody.take_up()
    flight.enter(Step.LAND)
    await flight.landing.land_all()
    flight.enter_done()
    flight.landing.raise_failed_orders()


async def _ready(flight: FlightSequence, *, need_all: bool) -> set[int]:
    """Return the vehicles that can return or resume: they answered, and report time and position.

    Raises PeerError if one does not and all are needed, or if none does.
    """
    failures: dict[int, PeerError] = {}

    async def prepare(vehicle: FlightVehicle) -> None:
        try:
            await request_telemetry(vehicle)
            await until_ready(vehicle)
            await until_placed(vehicle)
        except PeerError as failure:
            failures[vehicle.sysid] = failure

    heard = [vehicle for vehicle in flight.vehicles.values() if vehicle.session.heard]
    await each(heard, prepare)
    able = {vehicle.sysid for vehicle in heard} - failures.keys()
    if failures and (need_all or not able):
        raise next(iter(failures.values()))
    return able
