"""A flight that lost its ground station: the instant of the plan it is nearest to, and its landing, return or rest."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from gcs.aio import alongside, until
from gcs.errors import FlightError
from gcs.flight.options import FlightMode
from gcs.flight.progress import Step
from gcs.flight.sequence.flight import FlightSequence
from gcs.flight.sequence.takeoff_landing import request_telemetry, until_ready
from gcs.physics.quadrotor import POSITION, Array
from gcs.plan.trajectory.plan import Plan

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
    """Return it for positions (V, 3), between the end of the take-off and the start of the landing."""
    t_s = np.arange(plan.airborne_s, plan.phase("landing").start_s, _STEP_S)
    places = plan.leader_trajectory.state(t_s)[:, POSITION] + plan.offsets(t_s)  # (V, N, 3)
    off = np.linalg.norm(places - positions_ned_m[:, None], axis=-1).max(axis=0)
    best = int(np.argmin(off))
    return Where(float(t_s[best]), float(off[best]))


async def resume_flight(flight: FlightSequence, what: Resume, t0_unix_s: float | None) -> float | None:
    """Continue a flight that another process began and left; return T0. Raises as `FlightSequence.run` does.

    `t0_unix_s` is the T0 of that process, None if it had none yet.
    """
    return await flight.guarded(_resume(flight, what, t0_unix_s))


async def _resume(flight: FlightSequence, what: Resume, t0_unix_s: float | None) -> float | None:
    await flight.each(request_telemetry)
    await flight.each(until_ready)
    views = [vehicle.view for vehicle in flight.vehicles.values()]
    known_s = flight.options.find_timeout_s
    await until(
        lambda: all(np.isfinite(view.position_ned_m).all() for view in views), known_s, "a position of every vehicle"
    )
    await flight.prepare_contingency()
    if what is Resume.LAND or (what is Resume.RESUME and not any(s.armed for s in flight.sessions.values())):
        flight.landing.custody.take_up()
        flight.enter(Step.LAND)
        await flight.landing.land_all()
        flight.enter_done()
        flight.landing.raise_failed_orders()
        return t0_unix_s
    streams = flight.options.mode is FlightMode.STREAM
    if what is Resume.RESUME and not streams and t0_unix_s is not None:
        flight.streamer.stand_by(t0_unix_s)
        t0_new_s = t0_unix_s
    else:
        where = where_in_plan(flight.plan, np.array([view.position_ned_m for view in views]))
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
            await flight.each(flight.streamer.obey)
        flight.enter(Step.FLY)
        async with alongside(flight.contingency.run()):
            await flight.watch_over(t0_new_s, return_all=what is Resume.RETURN)
    flight.enter_done()
    flight.landing.raise_failed_orders()
    if what is Resume.RESUME:
        flight.raise_troubles()
    return t0_new_s
