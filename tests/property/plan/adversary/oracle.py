"""What each constraint leaves of its limit, written anew from the paper's equations, for use on a grid of 0.1 ms.

Nothing of the verifier or the planner's margins is used: positions are the leader's polynomials plus the shape (Eq.
22), and forces are Eq. 1 written out. A value below zero is a violation, in the unit of the check of that name.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, pairwise

import numpy as np

from gcs.plan.formation.coordinates import target_ned_m
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import NoFlyZone, Scenario
from gcs.types import Array
from tests.property.plan.adversary.ground import distance_m, height_up_m

GRID_S = 1e-4
AIRBORNE = ("hover", "run-up", "mission", "arrival-hover")
GROUND = CLEARANCE, HEIGHT, PAD = (
    "clearance above ground",
    "height above ground",
    "distance to the ground beside the pad",
)
PAD_SHARE = 0.25  # of the height above the own pad: so near may the ground beside it be
PAD_FREE_M = 0.25  # up to this height above the pad the ground beside it may be as near as it is
HEADING = "heading along the course"
_G = "turning load factor"


def turning_limits(scenario: Scenario) -> tuple[float, float, float]:
    """Eq. 51's limits of U2, U3 in N, on the arm, and of U4 in N m; a scenario may give moments for the first two."""
    limits = scenario.limits
    if limits.torque is not None:
        return limits.torque
    roll_pitch, yaw = limits.roll_pitch_force_N, limits.yaw_moment_Nm
    if roll_pitch is None:
        assert limits.roll_pitch_moment_Nm is not None
        roll_pitch = tuple(moment / scenario.vehicle.arm_m for moment in limits.roll_pitch_moment_Nm)  # type: ignore[assignment]
    assert yaw is not None and roll_pitch is not None
    return (*roll_pitch, yaw)


def window(start_s: float, end_s: float) -> Array:
    """Instants 0.1 ms apart, both ends among them."""
    return np.linspace(start_s, end_s, max(int(np.ceil((end_s - start_s) / GRID_S - 1e-6)), 1) + 1)


@dataclass(frozen=True)
class Oracle:
    """Margins of a plan's constraints at any instants."""

    plan: Plan

    @property
    def scenario(self) -> Scenario:
        """What the plan is held against."""
        return self.plan.scenario

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Every constraint that the oracle knows for this plan."""
        return tuple(self._of)

    def margin(self, name: str, t_s: Array, row: int | None = None) -> Array:
        """Margins (R, N) at instants (N,): a row for each vehicle, or each pair of vehicles; or (1, N) of one row."""
        if row is None:
            return self._of[name](t_s)
        if name in GROUND:
            return self._to_ground(t_s, name, [row])
        return self._of[name](t_s)[row : row + 1]

    def rows(self, name: str) -> list[tuple[int, ...]]:
        """The system ids that each row is about."""
        return list(combinations(self.plan.sysids, 2)) if name == "separation" else [(i,) for i in self.plan.sysids]

    def places_ned_m(self, t_s: Array) -> Array:
        """Positions (V, N, 3), Eq. 22."""
        return self.plan.leader_trajectory.state(t_s)[:, :3] + self._offsets(t_s)

    def _offsets(self, t_s: Array, order: int = 0) -> Array:
        shape = self.plan.shape
        return np.einsum("nk,kvi->vni", shape.functions(t_s, nu=order), shape.basis_ned_m)

    @cached_property
    def _of(self) -> dict[str, Callable[[Array], Array]]:
        limits, found = self.scenario.limits, dict[str, Callable[[Array], Array]]()
        for name in GROUND:
            found[name] = lambda t, n=name: self._to_ground(t, n, list(range(len(self.plan.sysids))))  # type: ignore[misc]
        for name, axis, sign, bounds in (
            ("north position", 0, 1.0, limits.north_m),
            ("east position", 1, 1.0, limits.east_m),
            ("height", 2, -1.0, limits.height_m),
        ):
            found[name] = lambda t, a=axis, s=sign, b=bounds: _within(s * self.places_ned_m(t)[..., a], *b)  # type: ignore[misc]
        for number, zone in enumerate(self.scenario.no_fly, start=1):
            found[f"no-fly zone {number}"] = lambda t, z=zone: outside_m(z, t, self.places_ned_m(t))  # type: ignore[misc]
        if len(self.plan.sysids) > 1:
            found["separation"] = self._separation
        for first, unit, names, bounds in (
            (3, 1.0, ("north speed", "east speed", "vertical speed"), limits.speed_ned_mps),
            (6, 180.0 / np.pi, ("roll", "pitch", "yaw"), limits.roll_pitch_yaw_deg),
            (9, 180.0 / np.pi, ("roll rate", "pitch rate", "yaw rate"), limits.rates_degps),
        ):
            for i, (name, bound) in enumerate(zip(names, bounds, strict=True)):
                found[name] = lambda t, r=first + i, u=unit, b=bound: b - np.abs(u * self.plan.states(t)[..., r])  # type: ignore[misc]
        found["thrust U1"] = lambda t: _within(self.plan.controls(t)[..., 0], *limits.thrust_N)
        for i, bound in enumerate(turning_limits(self.scenario), start=1):
            found[f"control U{i + 1}"] = lambda t, r=i, b=bound: b - np.abs(self.plan.controls(t)[..., r])  # type: ignore[misc]
        found["rotor speed"] = self._rotors
        found[_G] = self._turning
        if limits.accel_max_mps2 is not None:
            a_max = limits.accel_max_mps2
            found["acceleration"] = lambda t: a_max - np.linalg.norm(self._acceleration(t), axis=-1)
        formation = self.scenario.formation
        for order, name, most in (
            (1, "speed in the shape", formation.change_speed_mps),
            (2, "acceleration in the shape", formation.change_accel_mps2),
        ):
            found[name] = lambda t, o=order, m=most: m - np.linalg.norm(self._offsets(t, o), axis=-1)  # type: ignore[misc]
        autos = [change for change in formation.change if change.auto]
        if not any(change.kind == "reshape" for change in formation.change if not change.auto) and not autos:
            found["place in formation"] = self._place
        elif len(autos) == len(formation.change) == 1 and formation.frame == "inertial":
            found["place in formation"] = self._place_of_automatic
        if formation.frame == "course":
            found[HEADING] = self._heading
        return found

    def _to_ground(self, t_s: Array, name: str, rows: list[int]) -> Array:
        """Distance to the ground minus h_min, or minus a share of that or of the height above the pad; or height."""
        terrain, least = self.scenario.terrain, self.scenario.limits.clearance_min_m
        places = self.places_ned_m(t_s)[rows]
        if name == HEIGHT:
            return np.asarray(-places[..., 2] - height_up_m(terrain, places[..., 0], places[..., 1]))
        away = distance_m(terrain, places.reshape(-1, 3), 2.0 * least + 1.0).reshape(places.shape[:2])
        if name == CLEARANCE:
            return np.asarray(away - least)
        above = [end[rows, None, 2] - places[..., 2] for end in (self.plan.pads_ned_m, self.plan.landing_points_ned_m)]
        own = np.where(t_s < 0.5 * (self.plan.t_start_s + self.plan.t_end_s), *above)
        return np.asarray(away - PAD_SHARE * np.minimum(least, own - PAD_FREE_M))

    def _separation(self, t_s: Array) -> Array:
        offsets = self._offsets(t_s)
        apart = [np.linalg.norm(offsets[i] - offsets[j], axis=-1) for i, j in combinations(range(len(offsets)), 2)]
        return np.stack(apart) - self.scenario.limits.separation_min_m

    def _rotors(self, t_s: Array) -> Array:
        """Eq. 2 solved for the squared rotor speeds: how far the worst is from 0 and from the largest, as its share."""
        v = self.scenario.vehicle
        u = self.plan.controls(t_s)
        base = u[..., :1] / (4.0 * v.thrust_coeff_Ns2)
        roll, pitch = (u[..., i : i + 1] / (2.0 * np.sqrt(2.0) * v.thrust_coeff_Ns2) for i in (1, 2))
        yaw = u[..., 3:] / (4.0 * v.moment_coeff_Nms2)
        signs = np.array([[1.0, 1.0, 1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0], [1.0, -1.0, -1.0]])
        share = (base + roll * signs[:, 0] + pitch * signs[:, 1] + yaw * signs[:, 2]) / v.rotor_max_radps**2
        return np.asarray(np.minimum(share, 1.0 - share).min(axis=-1))

    def _acceleration(self, t_s: Array) -> Array:
        """The first three rows of Eq. 1, with air that moves."""
        v, x, u = self.scenario.vehicle, self.plan.states(t_s), self.plan.controls(t_s)
        air = np.stack(np.broadcast_arrays(*self.plan.quadrotor.wind.at(-x[..., 2])), axis=-1)
        (roll, pitch, yaw), thrust = np.moveaxis(x[..., 6:9], -1, 0), u[..., 0] / v.mass_kg
        ahead = np.cos(roll) * np.sin(pitch)
        push = np.stack(
            [
                np.cos(yaw) * ahead + np.sin(yaw) * np.sin(roll),
                np.sin(yaw) * ahead - np.cos(yaw) * np.sin(roll),
                np.cos(pitch) * np.cos(roll),
            ],
            axis=-1,
        )
        drag = np.array(v.drag_Nspm) / v.mass_kg * (x[..., 3:6] - air)
        return np.asarray(np.array([0.0, 0.0, v.gravity_mps2]) - push * thrust[..., None] - drag)

    def _turning(self, t_s: Array) -> Array:
        """Eqs. 17 and 25: v^2 / (R g); 1 / R is the curvature of the track seen from above. Below 0.1 m/s it is lax."""
        a, x = self._acceleration(t_s), self.plan.states(t_s)
        across = np.abs(x[..., 3] * a[..., 1] - x[..., 4] * a[..., 0])
        speed = np.sqrt(x[..., 3] ** 2 + x[..., 4] ** 2)
        factor = across / np.maximum(speed, 0.1) / self.scenario.vehicle.gravity_mps2
        return np.asarray(self.scenario.limits.load_factor_max - factor)

    def _place(self, t_s: Array) -> Array:
        """Distance of each vehicle from its place, outside of changes: where it was in the last rigid shape."""
        offsets, joints = self._offsets(t_s), self.plan.shape.joints_s
        edges = [self.plan.airborne_s, *(t for m in self.plan.moves for t in (m.start_s, m.end_s)), np.inf]
        off = np.zeros(offsets.shape[:2])
        for (low, high), place in zip(list(pairwise(edges))[::2], self.stops_ned_m, strict=True):
            inside = (t_s >= low) & (t_s <= min(high, joints[-1]))
            wanted = np.repeat(place[:, None], int(inside.sum()), axis=1)
            if self.scenario.formation.frame == "course":
                turned = (wanted[..., 0] + 1j * wanted[..., 1]) * np.exp(1j * self._turn_rad(offsets[:, inside], place))
                wanted[..., 0], wanted[..., 1] = turned.real, turned.imag
            off[:, inside] = np.linalg.norm(offsets[:, inside] - wanted, axis=-1)
        return -off

    def _place_of_automatic(self, t_s: Array) -> Array:
        """Distance of each vehicle from the nearest shape of the only automatic change: an angle, a share, a factor."""
        (change,) = self.scenario.formation.change
        seen, start = self._offsets(t_s), self.start_ned_m[:, None]
        if change.kind == "rotate":
            assert change.angle_deg is not None
            most = 1.001 * abs(np.radians(change.angle_deg))
            turn = np.exp(1j * np.clip(self._turn_rad(seen, self.start_ned_m), -most, most))
            turned = (start[..., 0] + 1j * start[..., 1]) * turn
            near = np.stack([turned.real, turned.imag, np.broadcast_to(start[..., 2], turned.shape)], axis=-1)
            return -np.linalg.norm(seen - near, axis=-1)
        zero, way, low, high = np.zeros_like(start), start, 0.0, 0.0
        if change.kind == "shrink":
            assert change.scale is not None
            low, high = change.scale - 1e-3, 1.0 + 0.05 * (1.0 - change.scale) + 1e-3
        else:
            zero, way, low, high = start, target_ned_m(self.scenario)[:, None] - start, -0.051, 1.001
        share = np.clip(np.einsum("vni,vni->n", seen - zero, way + 0.0 * seen) / np.sum(way**2), low, high)
        return -np.linalg.norm(seen - zero - share[:, None] * way, axis=-1)

    def _turn_rad(self, offsets: Array, place: Array) -> Array:
        """The rotation (N,) about the vertical that brings a shape (V, 3) nearest to offsets (V, N, 3)."""
        here, there = (part[..., 0] + 1j * part[..., 1] for part in (place, offsets))
        return np.asarray(np.angle(np.einsum("v,vn->n", np.conj(here), there)))

    def _heading(self, t_s: Array) -> Array:
        """The formation's heading (1, N) against the leader's course, where it flies faster than 1 m/s."""
        start = self.scenario.start
        north, east = start.velocity_mps[:2]
        facing = np.arctan2(east, north) if north or east else np.radians(start.roll_pitch_yaw_deg[2])
        velocity = self.plan.leader_trajectory.state(t_s)[:, 3:5]
        heading = facing + self._turn_rad(self._offsets(t_s), self.start_ned_m)
        off = np.arctan2(velocity[:, 1], velocity[:, 0]) - heading
        off_deg = np.degrees(np.abs((off + np.pi) % (2.0 * np.pi) - np.pi))
        fast = np.linalg.norm(velocity, axis=1) > 1.0
        return np.asarray(self.scenario.formation.course_tolerance_deg - np.where(fast, off_deg, 0.0))[None]

    @cached_property
    def stops_ned_m(self) -> list[Array]:
        """The rigid shapes of the schedule (V, 3), one after the other: turned and scaled about the leader."""
        scenario, moves = self.scenario, self.plan.moves
        found = [self.start_ned_m]
        for change, _ in zip(scenario.formation.change, moves, strict=True):
            if change.kind == "shrink":
                found.append(found[-1] * change.scale)
                continue
            assert change.axis is None and change.angle_deg is not None
            c, s = np.cos(np.radians(change.angle_deg)), np.sin(np.radians(change.angle_deg))
            found.append(found[-1] @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))
        return found

    @cached_property
    def start_ned_m(self) -> Array:
        """Offsets (V, 3) at T0, as the plan has them."""
        return np.asarray(self._offsets(np.array([0.0]))[:, 0])


def _within(value: Array, low: float, high: float) -> Array:
    return np.minimum(value - low, high - value)


def outside_m(zone: NoFlyZone, t_s: Array, places_ned_m: Array) -> Array:
    """Eqs. 21 and 24: distance (V, N) of places (V, N, 3) from the edge of a zone, negative inside."""
    moved = np.zeros((len(t_s), 2))
    if zone.moves:
        times, north, east = np.array(zone.moves).T
        moved = np.column_stack([np.interp(t_s, times, north), np.interp(t_s, times, east)])
    seen = places_ned_m[..., :2] - moved
    if zone.radius_m is not None:
        return np.asarray(np.linalg.norm(seen - [zone.north_m, zone.east_m], axis=-1) - zone.radius_m)
    assert zone.polygon_m is not None
    corners = np.array(zone.polygon_m)
    away, inside = np.full(seen.shape[:2], np.inf), np.zeros(seen.shape[:2], dtype=bool)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        share = np.clip((seen - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        away = np.minimum(away, np.linalg.norm(seen - a - share[..., None] * (b - a), axis=-1))
        if a[1] != b[1]:
            between = (seen[..., 1] < a[1]) != (seen[..., 1] < b[1])
            inside ^= between & (seen[..., 0] < a[0] + (seen[..., 1] - a[1]) * (b[0] - a[0]) / (b[1] - a[1]))
    return np.where(inside, -away, away)
