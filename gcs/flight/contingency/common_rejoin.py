"""Common rejoin: a formation without setpoints returns to its plan as a whole, or not at all.

Near the plan the vehicles fade to it and keep T0. Else the plan waits for them: T0 moves, so that the plan continues
where they are and no vehicle has to catch up. While a vehicle fades, its setpoint is the plan's plus its deviation, a
quintic that ends at rest at zero. Vehicles that stand are taken along smoothly: the plan begins half a fade before
their place in it, so that the deviation is what the plan moves meanwhile. Every candidate is checked as flown:
separation, no-fly zones, fence, ground, height, speed and acceleration. Time is an argument.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs.mission.returns.return_routes import ReturnRoutes
from gcs.mission.returns.routed_motion import ACCEL_MPS2
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.ocp.margins import clearance, height, no_fly
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.navigation_error import judged_separation_m
from gcs.types import Array

NEAR_M = 3.0  # off the plan's present instant: T0 stays
THERE_M = 0.5  # ... where the landing begins before a fade would end
FAR_M = 15.0  # off every instant: no rejoining
FADE_S = 8.0  # of a rejoin that keeps T0
APART_SHARE = 0.8  # of the limit of separation in the plan
_NOISE_M = 0.3
_FADES_S = (4.0, 6.0, 8.0, 12.0, 16.0)
_SHARES = (0.0, 0.125, 0.25, 0.375, 0.5)  # of a fade: how far before the vehicles' place the plan begins
_PEAK_MPS2 = 2.0 * ACCEL_MPS2  # of the deviation alone
_FASTER_MPS = 0.5  # than the limit of the plan, or than it is now
_DEEPER_M = 0.5  # a rejoin may begin nearer to the ground than planned; it gets no nearer than by this
_INTO_M = 1.0  # a plan may touch the edge of a zone; fading cuts its corners by less than this
_STEP_S, _LOOK_S, _BACK_S = 0.25, 0.1, 2.0


@dataclass(frozen=True)
class Rejoin:
    """Where in the plan the vehicles continue, within how long they are on it, and what that keeps of separation."""

    t_s: float
    fade_s: float
    separation_m: float

    def __str__(self) -> str:
        return (
            f"they continue at t = {self.t_s:.1f} s, are on the plan {self.fade_s:.0f} s later, "
            f"and keep {self.separation_m:.1f} m apart"
        )


@dataclass(frozen=True)
class Stranded:
    """Where the vehicles are when they begin: positions and velocities (V, 3) of these rows of the plan."""

    rows: tuple[int, ...]
    position_ned_m: Array
    velocity_ned_mps: Array


def quintic(off_m: Array, off_mps: Array, s: Array, fade_s: float) -> tuple[Array, Array, Array]:
    """A deviation (V, 3), its rate and acceleration at shares s (N,) of its fade: (V, N, 3) each."""
    p, v = off_m[:, None], off_mps[:, None] * fade_s
    s1 = s[None, :, None]
    place = p * (1 - 10 * s1**3 + 15 * s1**4 - 6 * s1**5) + v * (s1 - 6 * s1**3 + 8 * s1**4 - 3 * s1**5)
    rate = p * (-30 * s1**2 + 60 * s1**3 - 30 * s1**4) + v * (1 - 18 * s1**2 + 32 * s1**3 - 15 * s1**4)
    bend = p * (-60 * s1 + 180 * s1**2 - 120 * s1**3) + v * (-36 * s1 + 96 * s1**2 - 60 * s1**3)
    return place, rate / fade_s, bend / fade_s**2


def common_rejoin(plan: Plan, routes: ReturnRoutes, here: Stranded, now_s: float, since_s: float) -> Rejoin | str:
    """Return the rejoin of vehicles that had no setpoints from plan time `since_s` to `now_s`; or why there is none.

    They come no nearer to each other than `APART_SHARE` of the planned limit, or than they are. Moving no-fly zones
    keep the plan's time: with them T0 does not move.
    """
    rows = list(here.rows)
    now_m = _least_separation_m(here.position_ned_m[:, None])
    least_m = min(APART_SHARE * plan.scenario.limits.separation_min_m, now_m) - _NOISE_M
    apart_m = max(judged_separation_m(plan.scenario), least_m)
    off_now_m = _off_m(plan, rows, here, np.array([_within(plan, now_s)]))[0]
    reasons: list[str] = []
    in_time = now_s + FADE_S <= plan.landing_s
    if off_now_m <= (NEAR_M if in_time else THERE_M):
        found = _checked(plan, routes, here, _within(plan, now_s), FADE_S, apart_m)
        if not isinstance(found, str):
            return Rejoin(now_s, FADE_S, found[0])
        reasons.append(found)
    if any(zone.moves for zone in plan.scenario.no_fly):
        return "; ".join([*reasons, "no-fly zones move, so the plan cannot wait"])
    instants = np.arange(max(since_s - _BACK_S, plan.airborne_s), max(now_s, since_s) + _LOOK_S, _LOOK_S)
    instants = instants[instants < plan.landing_s]
    if not len(instants):
        return "; ".join([*reasons, "the plan is over"])
    off_m = _off_m(plan, rows, here, instants)
    best = int(np.argmin(off_m))
    if off_m[best] > FAR_M:
        return f"a vehicle is {off_m[best]:.1f} m from the plan at its nearest instant (limit {FAR_M:g} m)"
    for fade_s in _FADES_S:
        flown: list[tuple[float, float, float]] = []  # peak, begin, separation
        for share in _SHARES:
            t_s = min(float(instants[best]) - share * fade_s, plan.landing_s - fade_s)
            if t_s < plan.airborne_s:
                continue
            found = _checked(plan, routes, here, t_s, fade_s, apart_m)
            if isinstance(found, str):
                reasons.append(found)
            else:
                flown.append((found[1], t_s, found[0]))
        if flown:
            _, t_s, separation_m = min(flown, key=lambda one: one[0])
            return Rejoin(t_s, fade_s, separation_m)
    return reasons[-1] if reasons else "the plan has not begun"


def _checked(
    plan: Plan, routes: ReturnRoutes, here: Stranded, t_s: float, fade_s: float, apart_m: float
) -> tuple[float, float] | str:
    """The least separation, m, and the peak acceleration, m/s^2, of a rejoin at plan time `t_s`; or what forbids it."""
    scenario, rows = plan.scenario, list(here.rows)
    s = np.linspace(0.0, 1.0, round(fade_s / _STEP_S) + 1)
    at_s = np.minimum(t_s + s * fade_s, plan.t_end_s)
    states = plan.states(at_s)[rows]
    off_m = here.position_ned_m - states[:, 0, POSITION]
    off_mps = here.velocity_ned_mps - states[:, 0, VELOCITY]
    place, rate, bend = quintic(off_m, off_mps, s, fade_s)
    places, speeds = states[..., POSITION] + place, np.abs(states[..., VELOCITY] + rate)
    separation_m = _least_separation_m(places)
    if separation_m < apart_m:
        return f"separation would fall to {separation_m:.1f} m on the way back (limit {apart_m:.1f} m)"
    peak_mps2 = float(np.linalg.norm(bend, axis=-1).max())
    if peak_mps2 > _PEAK_MPS2:
        return f"the way back needs {peak_mps2:.1f} m/s^2 more than the plan (limit {_PEAK_MPS2:g} m/s^2)"
    top = np.maximum(np.array(scenario.limits.speed_ned_mps), speeds[:, :1]) + _FASTER_MPS
    if (speeds > top).any():
        return f"the way back needs {speeds.max():.1f} m/s, beyond the limits of speed"
    for margin in (clearance(scenario, places), height(scenario, places, to_the_ground=True)):
        least = np.minimum(margin.value[:, :1], 0.0) - _DEEPER_M
        if (margin.value < least).any():
            return f"the way back violates the limit of {margin.name} by {-margin.value.min():.1f} m"
    for zone in no_fly(scenario, places, at_s):
        if (zone.value < np.minimum(zone.value[:, :1], 0.0) - _INTO_M).any():
            return f"the way back leads {-zone.value.min():.1f} m into {zone.name}"
    outside_m = routes.outside_fence_m(places[..., :2])
    if (outside_m > outside_m[:, :1]).any():
        return f"the way back leads {outside_m.max():.1f} m outside the fence"
    return separation_m, peak_mps2


def _least_separation_m(places: Array) -> float:
    """The least distance of any two vehicles at one instant; positions (V, N, 3)."""
    if len(places) < 2:
        return float("inf")
    first, second = np.triu_indices(len(places), 1)
    return float(np.linalg.norm(places[first] - places[second], axis=-1).min())


def _off_m(plan: Plan, rows: Sequence[int], here: Stranded, at_s: Array) -> Array:
    """The largest deviation of a vehicle from the plan at each instant (N,)."""
    places = plan.leader_trajectory.state(at_s)[:, POSITION] + plan.offsets(at_s)[list(rows)]
    return np.asarray(np.linalg.norm(places - here.position_ned_m[:, None], axis=-1).max(axis=0))


def _within(plan: Plan, t_s: float) -> float:
    return float(np.clip(t_s, plan.airborne_s, plan.t_end_s))
