"""The winds in which a verified plan can be flown: tilt, thrust, battery, and the position error in gusts.

Tilt and thrust are proved over whole intervals of time, for every vehicle, along a number of directions
(`constraints/wind_limits.py`). For each limit the winds of an instant are a convex set, so the convex hull of what is
proved along the directions is proved between them too. The charge of the battery is a convex function of the wind,
integrated as the verifier does.

A gust is a wind that differs from the steady one by at most a share of its speed, in any direction and however it
changes. Tilt and thrust hold in every such wind. What it moves a vehicle off its place is bounded by the gain of the
autopilot's loops (`autopilots/waypoint_models/disturbance_gain.py`).
"""

import math
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
import shapely

from gcs.plan.trajectory.constraint_id import Kind
from gcs.plan.trajectory.energy import ChargeInWind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.constraints.wind_limits import MOST_MPS, WindLimits, every_limit, wind_directions
from gcs.plan.verification.proof.subdivision import Looks, Proof, Rows, plain_cells, settle
from gcs.plan.verification.proof.vehicle_tree import vehicle_tree
from gcs.scenario.values.navigation_error import navigation_error
from gcs.types import Array
from gcs.util.cache import once

DIRECTIONS = 24
_LONGEST_S = 4.0
_CELLS_MAX = 3_000_000
_FEW = 16  # up to so many vehicles, each is a group of its own from the beginning
_BISECTIONS = 12
_ROUNDING_MPS = 1e-9
BATTERY, POSITION_ERROR = "battery", "position error in gusts"


@dataclass(frozen=True)
class WindBorder:
    """The greatest wind from one direction, and what a stronger one violates first, with vehicle and plan time.

    `limit` is None where no limit is reached below 30 m/s; the battery and gusts have no time.
    """

    from_deg: float
    speed_mps: float
    limit: str | None
    sysid: int | None = None
    t_s: float | None = None


@dataclass(frozen=True, eq=False)
class WindEnvelope:
    """The set of winds at `reference_m` above height 0 under which the limits of a plan stay proved.

    `borders` are those of the steady wind with gusts of `gust_share` times its speed. `instant` and `steady` are convex
    polygons (north, east), m/s, of the direction in which air moves: winds that may occur at an instant, and winds in
    which the battery lasts as well.
    """

    borders: tuple[WindBorder, ...]
    wind_ok_mps: float  # a steady wind of this speed is allowed from every direction
    gust_ok_mps: float  # gusts of this size keep the position error of [judge]; infinite without drag
    gust_share: float
    reference_m: float
    shear: float
    knows_battery: bool
    instant: shapely.Polygon
    steady: shapely.Polygon

    def allows(self, speed_mps: float, from_deg: float) -> bool:
        """Whether a steady wind, with gusts of the envelope's share, is inside."""
        from_rad = np.radians(from_deg)
        wind = -speed_mps * np.array([np.cos(from_rad), np.sin(from_rad)])
        gust_mps = self.gust_share * speed_mps
        if gust_mps > self.gust_ok_mps + _ROUNDING_MPS or not _holds(self.steady, wind, 0.0):
            return False
        return _holds(self.instant, wind, gust_mps)

    def ok_from(self, from_deg: float) -> float:
        """The greatest speed of a steady wind from a direction, with gusts of the envelope's share, m/s."""
        from_rad = np.radians(from_deg)
        toward = -np.array([np.cos(from_rad), np.sin(from_rad)])
        most = MOST_MPS if self.gust_share == 0.0 else min(self.gust_ok_mps / self.gust_share, MOST_MPS)
        return min(most, _along(self.steady, toward, 0.0), _along(self.instant, toward, self.gust_share))


@once
def wind_envelope(plan: Plan, gust_share: float = 0.0, directions: int = DIRECTIONS) -> WindEnvelope:
    """The envelope of a verified plan, in steady wind with gusts of a share of its speed (0.5: half as strong again).

    Where the plan has a [wind], winds are meant at its height and grow with its shear; otherwise they are the same at
    every height. Without [vehicle.power] the battery is not looked at. Raises ValueError for a share below 0 or fewer
    than three directions.
    """
    if gust_share < 0.0 or directions < 3:
        raise ValueError("the share of gusts must be 0 or more, and directions at least 3")
    toward = wind_directions(directions)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        proved, binding = _proved(plan, toward)
    least = proved.min(axis=1)
    centre = np.array([plan.quadrotor.wind.north_mps, plan.quadrotor.wind.east_mps])
    knows = plan.begin_state is None and plan.scenario.vehicle.power is not None
    lasting, empty = _lasting(plan, centre, toward, least) if knows else (least, {})
    instant, steady = (_hull(centre + toward * speeds[:, None]) for speeds in (least, lasting))
    wind = plan.quadrotor.wind
    inner = WindEnvelope(
        (), 0.0, _gust_ok_mps(plan), gust_share, wind.reference_m, wind.exponent if wind.has_shear else 0.0,
        knows, instant, steady,
    )  # fmt: skip
    corners = centre + toward * lasting[:, None]
    borders = []
    for number, (north, east) in enumerate(toward):
        from_deg = 360.0 * number / directions
        speed = inner.ok_from(from_deg)
        nearest = int(np.argmin(np.linalg.norm(corners - speed * (1.0 + gust_share) * np.array([north, east]), axis=1)))
        if speed >= MOST_MPS - _ROUNDING_MPS:
            borders.append(WindBorder(from_deg, speed, None))
        elif gust_share and speed >= inner.gust_ok_mps / gust_share - _ROUNDING_MPS:
            borders.append(WindBorder(from_deg, speed, POSITION_ERROR))
        elif nearest in empty and lasting[nearest] < least[nearest]:
            borders.append(WindBorder(from_deg, speed, BATTERY, empty[nearest]))
        else:
            kind, sysid, t_s = binding[nearest]
            borders.append(WindBorder(from_deg, speed, kind.value, sysid, t_s))
    return WindEnvelope(
        tuple(borders), _everywhere(inner), inner.gust_ok_mps, gust_share, inner.reference_m, inner.shear, knows,
        instant, steady,
    )  # fmt: skip


def proved_mps(speed_mps: float) -> str:
    """A speed for people, rounded down: more is not proved."""
    return f"{math.floor(10.0 * speed_mps + 1e-6) / 10.0:.1f}"


def proved_everywhere(plan: Plan) -> str:
    """The wind that is allowed from every direction, in words."""
    return f"up to {proved_mps(wind_envelope(plan).wind_ok_mps)} m/s from every direction"


def _proved(plan: Plan, toward: Array) -> tuple[Array, list[tuple[Kind, int, float]]]:
    """Winds in addition to the planned one (K, 4) that every limit allows, and the limit that allows least of each."""
    start_s, end_s = _intervals(plan)
    middle = 0.5 * (start_s + end_s)
    apart = plan.shape.moves_apart(middle, plan.quadrotor.wind)
    tree = vehicle_tree(plan.shape)
    few = len(plan.sysids) <= _FEW
    groups: Rows = tree.leaves if few else np.zeros(1, dtype=np.intp)
    speeds = np.full(len(toward) * len(every_limit(1)), np.inf)
    seen: list[tuple[float, int, float]] = [(np.inf, plan.leader, plan.t_start_s)] * len(speeds)
    for family, chosen, who in (
        (WindLimits(plan, None, toward), ~apart, np.zeros(1, dtype=np.intp)),
        (WindLimits(plan, tree, toward), apart, groups),
    ):
        if not chosen.any():
            continue
        count = int(chosen.sum())
        cells = plain_cells(np.repeat(who, count)[:, None], *(np.tile(t[chosen], len(who)) for t in (start_s, end_s)))
        proof = Proof.begun((len(speeds), 1), 1)
        settle(family, cells, proof, Looks(_CELLS_MAX))
        speeds = np.minimum(speeds, np.minimum(proof.proved[:, 0], proof.seen[:, 0]))
        for number, value in enumerate(proof.seen[:, 0].tolist()):
            if value < seen[number][0]:
                seen[number] = value, family.row(proof.who[number, 0]), float(proof.t_s[number, 0])
    found = np.maximum(speeds.reshape(len(toward), -1), 0.0)
    binding = []
    for number, row in enumerate(found):
        kind = int(row.argmin())
        _, vehicle, t_s = seen[number * found.shape[1] + kind]
        binding.append((every_limit(1)[kind][1], plan.sysids[vehicle], t_s))
    return found, binding


def _intervals(plan: Plan) -> tuple[Array, Array]:
    """Starts and ends (N,) of intervals that reach over no joint and are at most 4 s long."""
    edges = plan.joints_s[(plan.joints_s > plan.t_start_s) & (plan.joints_s < plan.t_end_s)]
    edges = np.unique(np.concatenate([[plan.t_start_s], edges, [plan.t_end_s]]))
    parts = [np.linspace(a, b, int(np.ceil((b - a) / _LONGEST_S)), endpoint=False) for a, b in pairwise(edges)]
    every = np.concatenate([*parts, edges[-1:]])
    return every[:-1], every[1:]


def _lasting(plan: Plan, centre: Array, toward: Array, most: Array) -> tuple[Array, dict[int, int]]:
    """Additional winds (K,) in which the battery lasts too, and whose battery first does not beyond them."""
    charge, allowed = ChargeInWind(plan), 1.0 - plan.scenario.preflight.reserve
    found, empty = np.array(most), {}
    # A convex function is largest at corners: who lasts at those of a box round all winds lasts in each of them.
    corners = centre + most[:, None] * toward
    low_mps, high_mps = corners.min(axis=0), corners.max(axis=0)
    box = [charge.needed(np.array(corner)) for corner in product(*zip(low_mps, high_mps, strict=True))]
    rows: Rows = np.flatnonzero(np.max(box, axis=0) > allowed)
    for number, direction in enumerate(toward if len(rows) else ()):
        needed = charge.needed(corners[number], rows)
        if needed.max() <= allowed:
            continue
        low, high = 0.0, float(most[number])
        # The charge is convex along the ray and allowed at its begin: what is below `low` is allowed.
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            needed = charge.needed(centre + middle * direction, rows)
            low, high = (middle, high) if needed.max() <= allowed else (low, middle)
        found[number], empty[number] = low, plan.sysids[int(rows[needed.argmax()])]
    return found, empty


def _gust_ok_mps(plan: Plan) -> float:
    """The largest gust whose position error, with the navigation error, stays within `judge.position_rms_m`."""
    q, scenario = plan.quadrotor, plan.scenario
    drag_ps = max(q.drag_Nspm[:2]) / q.mass_kg
    if drag_ps == 0.0:
        return np.inf
    gain_s = drag_ps * max(each.navigator.disturbance_gain_s2(drag_ps) for each in plan.autopilots)
    return max(scenario.judge.position_rms_m - navigation_error(scenario).horizontal_m, 0.0) / gain_s


def _hull(corners: Array) -> shapely.Polygon:
    """The convex hull of winds (K, 2); one without an area is a line or a point, which holds no gust."""
    return shapely.MultiPoint(corners).convex_hull


def _half_planes(hull: shapely.Polygon) -> tuple[Array, Array]:
    """Outward normals (M, 2) and offsets (M,): a wind is inside where normals @ wind <= offsets."""
    if hull.geom_type != "Polygon":
        return np.zeros((0, 2)), np.zeros(0)
    corners = np.array(shapely.geometry.polygon.orient(hull).exterior.coords)
    sides = np.diff(corners, axis=0)
    normals = np.stack([sides[:, 1], -sides[:, 0]], axis=1) / np.linalg.norm(sides, axis=1)[:, None]
    return normals, np.einsum("mi,mi->m", normals, corners[:-1])


def _holds(hull: shapely.Polygon, wind: Array, gust_mps: float) -> bool:
    """Whether a wind and all others within a gust of it are inside."""
    normals, offsets = _half_planes(hull)
    if not len(offsets):
        return gust_mps == 0.0 and bool(hull.distance(shapely.Point(wind)) <= _ROUNDING_MPS)
    return bool(np.all(normals @ wind + gust_mps <= offsets + _ROUNDING_MPS))


def _along(hull: shapely.Polygon, toward: Array, gust_share: float) -> float:
    """The greatest speed along a direction, with gusts of a share of it; 0 where no such wind is inside."""
    normals, offsets = _half_planes(hull)
    rates = normals @ toward + gust_share
    if not len(offsets) or np.any(offsets[rates <= 0.0] < -_ROUNDING_MPS):
        return 0.0
    most = float(np.min(offsets[rates > 0.0] / rates[rates > 0.0], initial=MOST_MPS))
    return max(most, 0.0)


def _everywhere(envelope: WindEnvelope) -> float:
    """The speed up to which winds from all directions are inside, with their gusts."""
    share = envelope.gust_share
    most = MOST_MPS if share == 0.0 else min(envelope.gust_ok_mps / share, MOST_MPS)
    for hull, gusts in ((envelope.steady, 0.0), (envelope.instant, share)):
        _, offsets = _half_planes(hull)
        most = min(most, float(offsets.min(initial=np.inf)) / (1.0 + gusts) if len(offsets) else 0.0)
    return max(most, 0.0)
