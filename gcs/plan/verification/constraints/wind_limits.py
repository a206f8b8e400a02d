"""The greatest additional wind in which every vehicle keeps its planned track within the limits of tilt and thrust.

A controller that keeps the planned places in another wind makes up for the drag alone: by Eq. 1 the force of the rotors
is F(w) = F + K s (w - w_plan), with the planned force F, the drag K and the share s of the wind at that height. So at
every instant the winds in which a limit holds are a convex set: a slab for the pitch, a ball for the largest thrust.
Of roll and least thrust it is not; a half-plane that touches it at the planned force stands for it, which is on the
safe side. The convex hull of winds in which all limits are proved is therefore proved as a whole.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from gcs.physics.wind import SteadyWind
from gcs.plan.trajectory.constraint_id import Kind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.constraints.state_control_limits import ORDER, divided
from gcs.plan.verification.proof.polynomials import enclosed
from gcs.plan.verification.proof.subdivision import Cells, Constraint, Mask, Rows
from gcs.plan.verification.proof.taylor import FUNCTIONS, Taylor, constant
from gcs.plan.verification.proof.vehicle_tree import VehicleTree, enclosed_offsets
from gcs.plan.verification.proof.verdict import LIMIT_TOLERANCE
from gcs.types import Array

MOST_MPS = 30.0  # stronger winds are not looked at; no scenario has one
KINDS = (Kind.PITCH, Kind.ROLL, Kind.LARGEST_THRUST, Kind.LEAST_THRUST)
_RESOLUTION_MPS = 0.02
_RIGHT_ANGLE_DEG = 90.0
_Vector = tuple[Taylor, Taylor, Taylor]


@dataclass(frozen=True)
class WindLimits:
    """Margins are additional winds, m/s, along each direction: for every direction those of all `KINDS`.

    `toward` (K, 2) are unit vectors, north and east, in which the air moves. The family is of the leader alone, or of
    all vehicles by groups of a tree.
    """

    plan: Plan
    tree: VehicleTree | None
    toward: Array

    @cached_property
    def constraints(self) -> tuple[Constraint, ...]:
        """In the order of the margins."""
        return (Constraint(0.0, _RESOLUTION_MPS),) * (len(self.toward) * len(KINDS))

    def bounds(self, cells: Cells) -> tuple[Array, Array]:
        """See `Family`."""
        leader, limits, q = self.plan.leader_trajectory, self.plan.scenario.limits, self.plan.quadrotor
        x = enclosed(leader.state, cells.start_s, cells.end_s, ORDER)
        thrust = enclosed(leader.control, cells.start_s, cells.end_s, ORDER)[0]
        (north, east, down), share = self._force(cells, x, thrust)
        sy, cy = x[8].sin(), x[8].cos()
        ahead, left = north * cy + east * sy, north * sy - east * cy
        planned = np.stack([north.middle, east.middle, down.middle])
        planned = planned / np.maximum(np.linalg.norm(planned, axis=0), 1e-9)
        tilted = np.arctan2(ahead.middle, down.middle)
        over = 1.0 + LIMIT_TOLERANCE
        tan_roll, tan_pitch = (_tangent(over * deg) for deg in limits.roll_pitch_yaw_deg[:2])
        least_N, most_N = limits.thrust_N[0] * (1.0 - LIMIT_TOLERANCE), limits.thrust_N[1] * over
        within = down * tan_pitch
        beside = (ahead * np.sin(tilted) + down * np.cos(tilted)) * tan_roll
        room = most_N**2 - (north.square() + east.square() + down.square())
        above = north * planned[0] + east * planned[1] + down * planned[2] - least_N
        found = []
        for d_north, d_east in self.toward:
            k_north, k_east = share * (q.drag_Nspm[0] * d_north), share * (q.drag_Nspm[1] * d_east)
            more, aside = k_north * cy + k_east * sy, k_north * sy - k_east * cy
            pitch = _least(_reached(within - ahead, more), _reached(within + ahead, -more))
            sideways = more * np.sin(tilted) * tan_roll
            roll = _least(_reached(beside - left, aside - sideways), _reached(beside + left, -aside - sideways))
            found += [
                pitch,
                roll if np.isfinite(tan_roll) else _free(cells),
                _in_ball(room, north, east, share, (q.drag_Nspm[0] * d_north, q.drag_Nspm[1] * d_east)),
                _reached(above, -(k_north * planned[0] + k_east * planned[1])),
            ]
        return np.stack([low for low, _ in found]), np.stack([seen for _, seen in found])

    def children(self, cells: Cells, chosen: Mask) -> tuple[Cells, Rows]:
        """See `Family`: first the group, then the time is divided."""
        return divided(cells, chosen, self.tree)

    def row(self, who: Rows) -> int:
        """The row of the vehicle that a group stands for."""
        return self.plan.leader if self.tree is None else int(self.tree.row[who[0]])

    def _force(self, cells: Cells, x: Taylor, thrust: Taylor) -> tuple[_Vector, Taylor]:
        """The planned force of the rotors (NED, turned over), N, and the share of the wind at the height."""
        sr, cr, sp, cp = x[6].sin(), x[6].cos(), x[7].sin(), x[7].cos()
        sy, cy = x[8].sin(), x[8].cos()
        force = [thrust * (cy * sp * cr + sy * sr), thrust * (sy * sp * cr - cy * sr), thrust * (cp * cr)]
        wind, q = self.plan.quadrotor.wind, self.plan.quadrotor
        share = self._share(wind, -x[2])
        if self.tree is None:
            return (force[0], force[1], force[2]), share
        offset, speed, acceleration = (
            enclosed_offsets(self.plan.shape, self.tree, cells.who[:, 0], cells.start_s, cells.end_s, ORDER, order)
            for order in range(3)
        )
        own = self._share(wind, -(x[2] + offset[2]))
        for axis, toward_mps in enumerate((wind.north_mps, wind.east_mps, 0.0)):
            moved = acceleration[axis] * q.mass_kg + speed[axis] * q.drag_Nspm[axis]
            force[axis] = force[axis] - moved + (own - share) * (q.drag_Nspm[axis] * toward_mps)
        return (force[0], force[1], force[2]), own

    def _share(self, wind: SteadyWind, height: Taylor) -> Taylor:
        if not wind.has_shear:
            return constant(np.ones(np.shape(height.middle)), height.order)
        share: Taylor = wind.share(height, FUNCTIONS)
        return share


def wind_directions(count: int) -> Array:
    """Unit vectors (count, 2), north and east, along which air moves; the first comes from the north."""
    from_rad = 2.0 * np.pi * np.arange(count) / count
    return -np.stack([np.cos(from_rad), np.sin(from_rad)], axis=1)


def every_limit(count: int) -> tuple[tuple[int, Kind], ...]:
    """The direction and the kind of each margin, in their order."""
    return tuple(product(range(count), KINDS))


def _tangent(deg: float) -> float:
    return float(np.tan(np.radians(deg))) if deg < _RIGHT_ANGLE_DEG else np.inf


def _free(cells: Cells) -> tuple[Array, Array]:
    return np.full(len(cells), MOST_MPS), np.full(len(cells), MOST_MPS)


def _least(a: tuple[Array, Array], b: tuple[Array, Array]) -> tuple[Array, Array]:
    return np.minimum(a[0], b[0]), np.minimum(a[1], b[1])


def _reached(room: Taylor, rate: Taylor) -> tuple[Array, Array]:
    """The wind at which `rate` times it uses up the room: over the interval at least, and in the middle."""
    return _quotient(room.low(), rate.range()[1]), _quotient(room.middle, rate.middle)


def _quotient(room: Array, rate: Array) -> Array:
    found = np.where(rate > 0.0, np.maximum(room, 0.0) / np.maximum(rate, 1e-12), MOST_MPS)
    return np.asarray(np.where(room >= 0.0, np.minimum(found, MOST_MPS), 0.0))


def _in_ball(
    room: Taylor, north: Taylor, east: Taylor, share: Taylor, drag: tuple[float, float]
) -> tuple[Array, Array]:
    """The wind at which the thrust is the largest: |F|² + 2 s F·k + s² |k|² = T²; `room` is T² - |F|²."""
    size = float(np.hypot(*drag))
    if size == 0.0:
        free = np.full(np.shape(room.middle), MOST_MPS)
        return free, free
    along = north * (drag[0] / size) + east * (drag[1] / size)

    def solved(spare: Array, parallel: Array, growth: Array) -> Array:
        # Falls with the part of F along the wind, grows with what is to spare.
        root = np.sqrt(parallel**2 + np.maximum(spare, 0.0))
        most = np.maximum(root - parallel, 0.0) / np.maximum(size * growth, 1e-12)
        return np.asarray(np.where(spare >= 0.0, np.minimum(most, MOST_MPS), 0.0))

    low = solved(room.low(), along.range()[1], share.range()[1])
    return low, solved(room.middle, along.middle, share.middle)
