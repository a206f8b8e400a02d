"""Reference trajectories in plan time and the common local NED frame: the plan, and the manoeuvres that are ordered.

A setpoint is ten numbers: position, velocity, acceleration (NED) and yaw. Every reference ends, and pauses, at rest:
autopilots fly on with the last velocity and acceleration they received. The acceleration of manoeuvres is bounded.
Braking keeps out of no-fly zones and inside the fence where that is possible.
"""

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from gcs.flight.contingency.energy_choice import EnergyChoice
from gcs.flight.contingency.policy import SPREAD_M, Order
from gcs.flight.monitoring.monitor import VehicleView
from gcs.flight.monitoring.progress import Action
from gcs.mission.model import SetpointStream
from gcs.mission.returns.return_routes import ReturnRoutes
from gcs.mission.returns.routed_motion import PiecewiseMotion, Stops, routed_motion, stops
from gcs.mission.returns.rtl_altitudes import ReturnPlan
from gcs.mission.returns.rtl_cases import ReturnSpeeds
from gcs.physics.states import ATTITUDE
from gcs.plan.replanning.parametric_nlp import with_zones
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import NoFlyZone
from gcs.types import Array

Values = Sequence[float]  # x, y, z, vx, vy, vz, ax, ay, az, yaw
_STILL = (0.0,) * 6


class ReferenceTrajectory(Protocol):
    """Anything with a setpoint for every deadline."""

    def at(self, k: int, t_s: float) -> Values | None:
        """Return the setpoint number `k` of the grid, at plan time `t_s`; None: nothing is sent."""


class PlanReference:
    """One vehicle's setpoints of the plan; before and after the plan, its ends at rest."""

    def __init__(self, stream: SetpointStream, row: int) -> None:
        self._row = row
        self._rows: list[list[float]] = []
        self.follow(stream)

    @property
    def last(self) -> int:
        """The number of the last setpoint."""
        return len(self._rows) - 1

    def follow(self, stream: SetpointStream) -> None:
        """Take the setpoints of another stream, which has the same grid."""
        row = self._row
        columns = (
            stream.position_ned_m[row],
            stream.velocity_ned_mps[row],
            stream.acceleration_ned_mps2[row],
            stream.yaw_ned_rad[row][:, None],
        )
        self._rows = np.hstack(columns).tolist()

    def at(self, k: int, t_s: float) -> Values:
        """The planned setpoint."""
        del t_s
        if 0 <= k <= self.last:
            return self._rows[k]
        end = self._rows[max(0, min(k, self.last))]
        return (*end[:3], *_STILL, end[9])


SPREAD_MPS, SPREAD_MPS2 = 1.0, 0.75  # while it brakes


class MotionReference:
    """A motion that begins at plan time `begin_s`."""

    def __init__(self, motion: PiecewiseMotion, begin_s: float, yaw_ned_rad: float) -> None:
        self.begin_s = begin_s
        self.end_s = begin_s + float(motion.times_s[0, -1])
        self._times_s: list[float] = motion.times_s[0].tolist()
        self._places, self._velocities = motion.places[0], motion.velocities[0]
        self._yaw_ned_rad = yaw_ned_rad

    def delay(self, by_s: float) -> None:
        """Let the motion begin `by_s` later in plan time."""
        self.begin_s += by_s
        self.end_s += by_s

    @property
    def end_ned_m(self) -> Array:
        """Where it ends, at rest (3,)."""
        return np.asarray(self._places[-1])

    def at(self, k: int, t_s: float) -> Values:
        """Return the setpoint of the motion at plan time `t_s`."""
        del k
        passed_s = t_s - self.begin_s
        piece = bisect_right(self._times_s, passed_s)
        if piece == 0 or piece == len(self._times_s):  # waits to begin, or rests
            knot = 0 if piece == 0 else -1
            return (*self._places[knot].tolist(), *self._velocities[knot].tolist(), 0.0, 0.0, 0.0, self._yaw_ned_rad)
        begin_s, end_s = self._times_s[piece - 1], self._times_s[piece]
        start = self._velocities[piece - 1]
        push = (self._velocities[piece] - start) / (end_s - begin_s)
        left_s = passed_s - begin_s
        position = self._places[piece - 1] + start * left_s + push * left_s**2 / 2
        return (*position.tolist(), *(start + push * left_s).tolist(), *push.tolist(), self._yaw_ned_rad)


@dataclass(frozen=True)
class MotionStart:
    """Where an order finds a vehicle at plan time `t_s`, and the heading that it keeps."""

    place_ned_m: Array  # (3,)
    velocity_ned_mps: Array  # (3,)
    yaw_ned_rad: float
    t_s: float


def predicted_start(plan: Plan, view: VehicleView, t0_unix_s: float, t_s: float) -> MotionStart:
    """Return the start of an order at plan time `t_s` from a vehicle's last report, with the plan's heading."""
    at = np.clip(np.array([t_s]), plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf))
    yaw_ned_rad = float(plan.leader_trajectory.state(at)[0, ATTITUDE][2])
    return MotionStart(*view.predicted(t0_unix_s + t_s), yaw_ned_rad, t_s)


def hold_reference(start: MotionStart, routes: ReturnRoutes) -> MotionReference:
    """Return a reference that brakes as a return does, out of no-fly zones and inside the fence, and holds."""
    return MotionReference(_braking(start, routes), start.t_s, start.yaw_ned_rad)


def spread_reference(start: MotionStart, routes: ReturnRoutes, up_m: float) -> MotionReference:
    """Return a reference that brakes in the same way, climbs by `up_m` meanwhile, and holds."""
    return MotionReference(_both(_braking(start, routes), _climbing(up_m)), start.t_s, start.yaw_ned_rad)


def return_reference(
    start: MotionStart,
    routes: ReturnRoutes,
    end_ned_m: Array,
    top_down_m: float,
    speeds: ReturnSpeeds,
    end_above_m: float,
) -> MotionReference | None:
    """Return a reference as returns are verified: brake, climb to `top_down_m`, follow the way to the end, descend.

    The way leads round no-fly zones and keeps inside the fence; None without a way. A higher vehicle keeps its
    altitude. It ends `end_above_m` above `end_ned_m`.
    """
    stop = _stops(start, routes)
    here = stop.end_ned_m[0]
    way = routes.way_ned_m(here, end_ned_m, start.t_s)
    if way is None:
        return None
    top = np.array([min(top_down_m, float(here[2]))])
    low = np.array([float(end_ned_m[2]) - end_above_m])
    return MotionReference(routed_motion(stop, way[None], top, low, speeds), start.t_s, start.yaw_ned_rad)


def _stops(start: MotionStart, routes: ReturnRoutes) -> Stops:
    return stops(start.place_ned_m[None], start.velocity_ned_mps[None], np.array([start.t_s]), routes)


def _braking(start: MotionStart, routes: ReturnRoutes) -> PiecewiseMotion:
    stop = _stops(start, routes)
    zero = np.zeros_like(stop.velocities)
    return PiecewiseMotion(
        np.stack([np.zeros(1), stop.duration_s / 2, stop.duration_s], axis=1),
        np.stack([stop.places, stop.half_ned_m, stop.end_ned_m], axis=1),
        np.stack([stop.velocities, stop.half_ned_mps, zero], axis=1),
    )


def _climbing(up_m: float) -> PiecewiseMotion:
    top_mps = min(SPREAD_MPS, math.sqrt(up_m * SPREAD_MPS2))
    rise_s, even_s = top_mps / SPREAD_MPS2, up_m / top_mps - top_mps / SPREAD_MPS2
    heights_m, speeds_mps = np.zeros((1, 4, 3)), np.zeros((1, 4, 3))
    speeds_mps[0, 1:3, 2] = -top_mps
    heights_m[0, :, 2] = -np.cumsum([0.0, top_mps * rise_s / 2, top_mps * even_s, top_mps * rise_s / 2])
    return PiecewiseMotion(np.cumsum([[0.0, rise_s, even_s, rise_s]], axis=1), heights_m, speeds_mps)


def _both(first: PiecewiseMotion, second: PiecewiseMotion) -> PiecewiseMotion:
    times_s = np.union1d(first.times_s, second.times_s)[None]
    places = first.places_at(times_s) + second.places_at(times_s)
    return PiecewiseMotion(times_s, places, _velocities_at(first, times_s) + _velocities_at(second, times_s))


def _velocities_at(motion: PiecewiseMotion, times_s: Array) -> Array:
    axes = [np.interp(times_s[0], motion.times_s[0], motion.velocities[0, :, axis]) for axis in range(3)]
    return np.stack(axes, axis=1)[None]


class RejoinReference:
    """Another reference plus the vehicle's deviation from it, which fades in `fade_s`, its velocity too."""

    def __init__(self, base: ReferenceTrajectory, off_m: Array, off_mps: Array, begin_s: float, fade_s: float) -> None:
        self.base = base
        self._begin_s = begin_s
        self._fade_s = fade_s
        # A quintic from (deviation, its rate, 0) to rest at zero, in s = t / fade.
        p, v = np.asarray(off_m), np.asarray(off_mps) * fade_s
        self._c = np.array([-6 * p - 3 * v, 15 * p + 8 * v, -10 * p - 6 * v, 0 * p, v, p])

    def fades(self, t_s: float) -> bool:
        """Whether some of the deviation is left at plan time `t_s`."""
        return t_s < self._begin_s + self._fade_s

    def at(self, k: int, t_s: float) -> Values | None:
        """Return the other reference's setpoint plus the deviation that is left."""
        values = self.base.at(k, t_s)
        s = (t_s - self._begin_s) / self._fade_s
        if values is None or s >= 1.0:
            return values
        s = max(s, 0.0)
        off = [
            np.polyval(np.polynomial.polynomial.polyder(self._c[::-1], n)[::-1], s) / self._fade_s**n for n in (0, 1, 2)
        ]
        moved = np.array(values[:9]) + np.concatenate(off)
        return (*moved.tolist(), values[9])


HOVER_M = 1.0  # over the pad, before the landing
NEAR_M, STILL_MPS = 0.5, 0.3  # a vehicle has arrived: horizontally, and in every direction
ARRIVES_S = 8.0  # at most after the end of a return's reference
# A vehicle that a failsafe or a gust stopped does not follow the reference of its return. It gets a new one then, from
# where it is. Ways keep 3 m from zones.
LEFT_M, RENEWS_S, RENEWALS_MAX = 2.0, 2.0, 3


class OrderedTracks:
    """Makes and judges the references of orders. `routes` are those of returns, `chosen` the last choices of energy."""

    def __init__(self, plan: Plan, returns: ReturnPlan, chosen: Mapping[int, EnergyChoice]) -> None:
        self._chosen = chosen
        self._came_up: tuple[NoFlyZone, ...] = ()
        self.follow(plan, returns)

    def follow(self, plan: Plan, returns: ReturnPlan) -> None:
        """Use the returns of another plan."""
        self._plan = plan
        self._returns = returns
        self.avoid(self._came_up)

    def avoid(self, zones: tuple[NoFlyZone, ...]) -> None:
        """Lead round these zones too: they came up, and the plan may not know them."""
        self._came_up, plan = zones, self._plan
        if zones:
            known = plan.scenario.no_fly
            every = (*known, *(zone for zone in zones if zone not in known))
            plan = replace(plan, scenario=with_zones(plan.scenario, every))
        self.routes = ReturnRoutes(plan)

    def reference(
        self, order: Order, view: VehicleView, row: int, t0_unix_s: float, begin_s: float
    ) -> MotionReference | None:
        """The reference of an order, from the vehicle's predicted position at plan time `begin_s`.

        None: a return without a way.
        """
        start = predicted_start(self._plan, view, t0_unix_s, begin_s)
        if order.action is Action.HOLD:
            return hold_reference(start, self.routes)
        if order.action is Action.SPREAD:
            return spread_reference(start, self.routes, SPREAD_M)
        home, end, speeds = self._plan.pads_ned_m[row], self.end_ned_m(order, row), self._returns.speeds
        top_down_m = float(home[2]) - self._returns.altitudes_m[row]
        return return_reference(start, self.routes, end, top_down_m, speeds, HOVER_M)

    def end_ned_m(self, order: Order, row: int) -> Array:
        """Where an order to return or to divert ends (3,)."""
        choice = self._chosen.get(order.sysid)
        target = None if choice is None or order.action is not Action.DIVERT else choice.chosen.target_ned_m
        return self._plan.pads_ned_m[row] if target is None else np.array(target)


@dataclass(frozen=True)
class WayBack:
    """A vehicle that returns. `renewals`: how often it got a new reference, because it did not follow the last."""

    order: Order
    track: MotionReference
    renewals: int = 0

    def has_arrived(self, view: VehicleView, t_s: float) -> bool:
        """Whether the return has ended: the vehicle rests above its end, or had time enough to come there."""
        if t_s <= self.track.end_s:
            return False
        off_m = float(np.linalg.norm((view.position_ned_m - self.track.end_ned_m)[:2]))
        still = float(np.linalg.norm(view.velocity_ned_mps)) < STILL_MPS
        return (off_m < NEAR_M and still) or t_s > self.track.end_s + ARRIVES_S

    def is_left(self, view: VehicleView, t0_unix_s: float, t_s: float) -> bool:
        """Whether a vehicle is so far from its reference that it would cut corners of the way."""
        if self.renewals >= RENEWALS_MAX or t_s < self.track.begin_s + RENEWS_S:
            return False
        position, _ = view.predicted(t0_unix_s + t_s)
        return float(np.linalg.norm(position - np.array(self.track.at(0, t_s)[:3]))) > LEFT_M
