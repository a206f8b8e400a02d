"""The adversary moves the surroundings: thin walls, corners, zones that come for milliseconds, needles of ground."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.heightmap import packed
from gcs.types import Array
from tests.property.plan.adversary.bends import DEPTH_M, LASTS_S, Bent, measured, samples_s
from tests.property.plan.adversary.oracle import CLEARANCE, Oracle
from tests.unit.plan.problems import changed

_WALL_M = 0.1
_SLOW_MPS = 0.3


@dataclass(frozen=True)
class Surprise:
    """Where something is put in the way, and how large it is, as shares of what is possible."""

    when: float
    place_in_gap: float
    size: float
    vehicle: int
    angle: float


@dataclass(frozen=True)
class _Spot:
    """A place on a vehicle's way, between two samples."""

    plan: Plan
    vehicle: int
    at_s: float
    gap_s: tuple[float, float]
    place_ned_m: Array
    ahead: Array  # (2,), of length one
    speed_mps: float

    @property
    def room_s(self) -> float:
        """Time to the nearer sample."""
        return min(self.at_s - self.gap_s[0], self.gap_s[1] - self.at_s)


def _spot(plan: Plan, surprise: Surprise) -> _Spot | None:
    mission = plan.phase("mission")
    samples = samples_s(plan)
    samples = samples[(samples >= mission.start_s) & (samples <= mission.end_s)]
    gaps = np.flatnonzero(np.diff(samples) > 0.02)
    gap = gaps[int(surprise.when * 0.999 * len(gaps))]
    low_s, high_s = float(samples[gap]), float(samples[gap + 1])
    at_s = low_s + (0.3 + 0.4 * surprise.place_in_gap) * (high_s - low_s)
    vehicle = surprise.vehicle % len(plan.sysids)
    before, place, after = Oracle(plan).places_ned_m(at_s + np.array([-1e-4, 0.0, 1e-4]))[vehicle]
    velocity = (after - before)[:2] / 2e-4
    speed = float(np.linalg.norm(velocity))
    if speed < _SLOW_MPS:
        return None
    return _Spot(plan, vehicle, at_s, (low_s, high_s), place, velocity / speed, speed)


def wall(plan: Plan, surprise: Surprise) -> Bent | None:
    """A wall of up to 0.1 m, square to the way of a vehicle, or at an angle, 0.1 to 2 m long."""
    spot = _spot(plan, surprise)
    if spot is None:
        return None
    thick = min(_WALL_M, 1.2 * spot.room_s * spot.speed_mps)
    turned = _turned(spot.ahead, 0.8 * (surprise.angle - 0.5))
    along, half = np.array([-turned[1], turned[0]]), 0.05 * 20.0**surprise.size
    here = spot.place_ned_m[:2]
    corners = [here + a * half * along + b * 0.5 * thick * turned for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return _with_zone(spot, {"polygon_m": [c.tolist() for c in corners]})


def corner(plan: Plan, surprise: Surprise) -> Bent | None:
    """A triangle whose corner reaches a few centimetres across the way."""
    spot = _spot(plan, surprise)
    if spot is None:
        return None
    side = np.array([-spot.ahead[1], spot.ahead[0]]) * (1.0 if surprise.angle < 0.5 else -1.0)
    half_angle = 0.3 + 0.9 * abs(2.0 * surprise.angle - 1.0)
    longest = 0.8 * spot.room_s * spot.speed_mps / np.tan(half_angle)
    reach = min(longest, 0.1 / np.sin(half_angle)) * (0.3 + 0.7 * surprise.size)
    top = spot.place_ned_m[:2] - side * reach
    corners = [top, *(top + (reach + 0.3) * _turned(side, turn) for turn in (half_angle, -half_angle))]
    return _with_zone(spot, {"polygon_m": [c.tolist() for c in corners]})


def visit(plan: Plan, surprise: Surprise) -> Bent | None:
    """A disk that stands beside the way comes nearer and goes back within milliseconds."""
    spot = _spot(plan, surprise)
    if spot is None:
        return None
    deep = DEPTH_M[0] * 1.5 * (0.6 * DEPTH_M[1] / DEPTH_M[0]) ** surprise.size
    side = _turned(spot.ahead, 2.0 * np.pi * surprise.angle)
    away, radius = max(2.0 * deep, 1.2 * spot.speed_mps * spot.room_s), 0.05 + 0.3 * surprise.size
    centre = spot.place_ned_m[:2] + side * (radius + away)
    near = -(away + deep) * side
    half_s = 0.9 * spot.room_s
    moves = [[spot.at_s - half_s, 0.0, 0.0], [spot.at_s, *near.tolist()], [spot.at_s + half_s, 0.0, 0.0]]
    return _with_zone(
        spot, {"north_m": float(centre[0]), "east_m": float(centre[1]), "radius_m": radius, "moves": moves}
    )


def spike(plan: Plan, surprise: Surprise) -> Bent | None:
    """A mountain (Eq. 53) that is centimetres wide, under a vehicle."""
    spot = _spot(plan, surprise)
    if spot is None or plan.scenario.terrain.relief is not None:
        return None
    hills = plan.scenario.terrain.mountains.model_dump()
    wide = 0.02 + 0.2 * surprise.angle
    here = {
        "north_m": float(spot.place_ned_m[0]),
        "east_m": float(spot.place_ned_m[1]),
        "spread_north_m": wide,
        "spread_east_m": wide,
    }

    def raised(height_m: float) -> Plan:
        new = {key: [*value, here.get(key, height_m)] for key, value in hills.items()}
        return replace(plan, scenario=changed(plan.scenario, terrain={"mountains": new}))

    return _as_high_as(spot, surprise, raised, -float(spot.place_ned_m[2]))


def needle(plan: Plan, surprise: Surprise) -> Bent | None:
    """One pixel of an elevation model that stands out, where a vehicle flies over it between two samples."""
    relief = plan.scenario.terrain.relief
    spot = _spot(plan, surprise)
    if spot is None or relief is None:
        return None
    step = relief.spacing_m
    north, east = np.round(spot.place_ned_m[:2] / step) * step
    times = np.arange(spot.at_s - 0.6, spot.at_s + 0.6, 2e-3)
    track = Oracle(plan).places_ned_m(times)[spot.vehicle]
    near = int(np.argmin(np.hypot(track[:, 0] - north, track[:, 1] - east)))
    samples = samples_s(plan)
    gap = int(np.clip(np.searchsorted(samples, times[near]), 1, len(samples) - 1))
    spot = replace(spot, at_s=float(times[near]), gap_s=(float(samples[gap - 1]), float(samples[gap])))
    if spot.room_s < 5e-3:
        return None
    row, column = round(relief.row[0] + float(north)), round(relief.column[0] + float(east))

    def raised(height_m: float) -> Plan:
        pixels = relief.pixels_m.copy()
        pixels[row, column] = height_m
        new = relief.model_copy(update={"heights": packed(pixels)})
        terrain = {"relief": type(relief).model_validate(new.model_dump()).model_dump()}
        return replace(plan, scenario=changed(plan.scenario, terrain=terrain))

    return _as_high_as(spot, surprise, raised, -float(track[near, 2]))


SURPRISES: dict[str, Callable[[Plan, Surprise], Bent | None]] = {
    "wall": wall,
    "corner": corner,
    "visit": visit,
    "spike": spike,
    "needle": needle,
}


def _as_high_as(spot: _Spot, surprise: Surprise, raised: Callable[[float], Plan], vehicle_up_m: float) -> Bent | None:
    """Ground as high as brings it a little nearer than the least clearance; lower where that takes too long."""
    least = spot.plan.scenario.limits.clearance_min_m
    most = (0.8 * spot.room_s * spot.speed_mps) ** 2 / max(2.0 * least, 1e-3)  # the sag of a chord
    if most < 1.2 * DEPTH_M[0]:
        return None
    deep = 1.1 * DEPTH_M[0] * (min(most, DEPTH_M[1]) / DEPTH_M[0] / 1.1) ** surprise.size
    low, high = vehicle_up_m - least - 0.3, vehicle_up_m - least + 0.2
    now = spot.at_s + np.linspace(-0.2, 0.2, 9) * spot.room_s
    for _ in range(14):
        middle = 0.5 * (low + high)
        margin = Oracle(raised(middle)).margin(CLEARANCE, now, spot.vehicle).min()
        low, high = (middle, high) if margin > -deep else (low, middle)
    return _accepted(spot, raised(0.5 * (low + high)), CLEARANCE)


def _with_zone(spot: _Spot, zone: dict[str, object]) -> Bent | None:
    zones = [z.model_dump() for z in spot.plan.scenario.no_fly]
    plan = replace(spot.plan, scenario=changed(spot.plan.scenario, no_fly=[*zones, zone]))
    return _accepted(spot, plan, f"no-fly zone {len(zones) + 1}")


def _accepted(spot: _Spot, plan: Plan, name: str) -> Bent | None:
    found = measured(plan, name, *spot.gap_s, spot.vehicle)
    if found is None or not DEPTH_M[0] <= found.depth <= DEPTH_M[1] or not LASTS_S[0] <= found.lasts_s <= LASTS_S[1]:
        return None
    low_s, high_s = spot.gap_s
    samples = samples_s(plan)
    if name != CLEARANCE and np.any(Oracle(plan).margin(name, samples) < 0.0):
        return None  # another vehicle, or this one later, meets it at a sample
    return found if low_s < found.start_s and found.start_s + found.lasts_s < high_s else None


def _turned(direction: Array, angle_rad: float) -> Array:
    turn = np.exp(1j * angle_rad) * (direction[0] + 1j * direction[1])
    return np.array([turn.real, turn.imag])
