"""The indices of the transcription's unknowns, and the constant matrices that act on them (Eqs. 37-47).

States and controls at any instant are linear in the unknowns.
"""

import itertools
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property

import numpy as np
from scipy import sparse

from gcs.physics.states import NU, NX
from gcs.plan.formation.coordinates import CoordinateName
from gcs.plan.nlp.gauss import barycentric_weights, gauss_rule, lagrange_matrix
from gcs.plan.nlp.mesh import Mesh
from gcs.plan.trajectory.constraint_id import CONTROLS, STATES, ConstraintId, Form, Kind
from gcs.types import Array

_Block = tuple[int, int, int, float]  # an identity in a sparse matrix: first row, first column, size, factor
_CHAIN = 4  # integrators of each coordinate; its control is the next derivative


class ControlForm(Enum):
    """How the control is interpolated between its unknowns."""

    LINEAR = "piecewise linear through the joints"
    LAGRANGE = "on each interval the polynomial through its nodes (Eq. 41)"


@dataclass(frozen=True)
class VariableLayout:
    """The index of each unknown in w, and the instants of the mesh."""

    mesh: Mesh
    control_form: ControlForm = ControlForm.LINEAR
    coordinates: tuple[CoordinateName, ...] = ()  # each adds a chain of four integrators to state and control

    @property
    def nx(self) -> int:
        """Number of state components at one instant."""
        return NX + 4 * len(self.coordinates)

    @property
    def nu(self) -> int:
        """Number of control components at one instant."""
        return NU + len(self.coordinates)

    @property
    def nz(self) -> int:
        """Number of components of state and control at one instant."""
        return self.nx + self.nu

    @cached_property
    def state_ids(self) -> tuple[ConstraintId, ...]:
        """What each state component is constrained as."""
        chains = [ConstraintId(Kind.COORDINATE, of=name, part=n) for name in self.coordinates for n in range(_CHAIN)]
        return (*map(ConstraintId, STATES), *chains)

    @cached_property
    def control_ids(self) -> tuple[ConstraintId, ...]:
        """What each control component is constrained as."""
        snaps = [ConstraintId(Kind.COORDINATE, of=name, part=_CHAIN) for name in self.coordinates]
        return (*map(ConstraintId, CONTROLS), *snaps)

    @cached_property
    def first_node(self) -> list[int]:
        """Index (M+1) of each interval's first node."""
        return [0, *itertools.accumulate(self.mesh.degrees)]

    @property
    def nodes(self) -> int:
        """Number N of collocation nodes."""
        return sum(self.mesh.degrees)

    @property
    def size(self) -> int:
        """Number of unknowns: states at joints and nodes, controls at either."""
        return self.nx * self.state_points + self.nu * self.control_points

    @property
    def state_points(self) -> int:
        """Number of instants at which the state is an unknown."""
        return self.mesh.intervals + 1 + self.nodes

    @property
    def control_points(self) -> int:
        """Number of instants at which the control is an unknown."""
        return self.nodes if self.control_form is ControlForm.LAGRANGE else self.mesh.intervals + 1

    def joint(self, i: int) -> int:
        """Index of the first state component at joint i."""
        return self.nx * i

    def node(self, i: int, k: int) -> int:
        """Index of the first state component at node k of interval i."""
        return self.nx * (self.mesh.intervals + 1 + self.first_node[i] + k)

    def control(self, point: int) -> int:
        """Index of the first control component at control point `point`: a joint, or a node of Eq. 41."""
        return self.nx * self.state_points + self.nu * point

    def control_support(self, i: int) -> tuple[range, Array]:
        """Control points (S) of interval i, and their positions (S,) on [-1, 1]."""
        if self.control_form is ControlForm.LAGRANGE:
            return range(self.first_node[i], self.first_node[i + 1]), gauss_rule(self.mesh.degrees[i]).nodes
        return range(i, i + 2), np.array([-1.0, 1.0])

    def control_times_s(self) -> Array:
        """Instants of all control points."""
        return self.node_times_s() if self.control_form is ControlForm.LAGRANGE else self.mesh.joints_s

    def limits(self) -> tuple[ConstraintId, ...]:
        """The limit of each unknown."""
        states, controls = (
            tuple(replace(one, form=Form.BOUND) for one in ids) for ids in (self.state_ids, self.control_ids)
        )
        return (*states * self.state_points, *controls * self.control_points)

    def node_times_s(self) -> Array:
        """Instants (N,) of all nodes."""
        joints = self.mesh.joints_s
        return np.concatenate(
            [
                joints[i] + 0.5 * (joints[i + 1] - joints[i]) * (gauss_rule(d).nodes + 1.0)
                for i, d in enumerate(self.mesh.degrees)
            ]
        )

    def sampling(self, times_s: Array) -> sparse.csc_matrix:
        """S (nz T, size): unknowns -> state and control at the given instants."""
        blocks: list[_Block] = []
        intervals = np.clip(np.searchsorted(self.mesh.joints_s, times_s, side="right") - 1, 0, self.mesh.intervals - 1)
        for point, (t, i) in enumerate(zip(times_s, intervals, strict=True)):
            low, high = self.mesh.joints_s[i], self.mesh.joints_s[i + 1]
            tau = np.array([2.0 * (t - low) / (high - low) - 1.0])
            rule = gauss_rule(self.mesh.degrees[i])
            weights = rule.interpolation(tau)[0]
            starts = [self.joint(i), *(self.node(i, k) for k in range(rule.degree))]
            for start, weight in zip(starts, weights, strict=True):
                if abs(weight) > 1e-14:
                    blocks.append((self.nz * point, start, self.nx, weight))
            points, support = self.control_support(i)
            weights = lagrange_matrix(support, barycentric_weights(support), tau)[0]
            for control, weight in zip(points, weights, strict=True):
                if abs(weight) > 1e-14:
                    blocks.append((self.nz * point + self.nx, self.control(control), self.nu, weight))
        return _matrix(blocks, (self.nz * len(times_s), self.size))

    def point_times_s(self) -> Array:
        """Instants of all state points: joints, then nodes."""
        return np.concatenate([self.mesh.joints_s, self.node_times_s()])

    def collocation(self) -> tuple[sparse.csc_matrix, sparse.csc_matrix]:
        """A, B of g = A w - B f: D times the states minus half the interval times f (44), and the joints (46)."""
        a: list[_Block] = []
        b: list[_Block] = []
        row, nx = 0, self.nx
        for i, degree in enumerate(self.mesh.degrees):
            rule = gauss_rule(degree)
            half = 0.5 * (self.mesh.joints_s[i + 1] - self.mesh.joints_s[i])
            first = self.nx * self.first_node[i]
            starts = [self.joint(i), *(self.node(i, k) for k in range(degree))]
            for k in range(degree):
                for start, d in zip(starts, rule.differentiation[k], strict=True):
                    a.append((row, start, nx, d))
                b.append((row, first + nx * k, nx, half))
                row += nx
            a += [(row, self.joint(i + 1), nx, 1.0), (row, self.joint(i), nx, -1.0)]
            b += [(row, first + nx * k, nx, half * rule.weights[k]) for k in range(degree)]
            row += nx
        return _matrix(a, (row, self.size)), _matrix(b, (row, nx * self.nodes))

    def collocation_times_s(self) -> Array:
        """Instants (N + M,) of the rows of A and B, one for each state component: an interval's nodes, then its end."""
        ends = np.cumsum(self.mesh.degrees)
        return np.insert(self.node_times_s(), ends, self.mesh.joints_s[1:])

    def quadrature(self) -> Array:
        """Weights (N,) that integrate a function of time over the whole flight (Eq. 47)."""
        lengths = np.diff(self.mesh.joints_s)
        return np.concatenate(
            [0.5 * h * gauss_rule(d).weights for h, d in zip(lengths, self.mesh.degrees, strict=True)]
        )


def _matrix(blocks: list[_Block], shape: tuple[int, int]) -> sparse.csc_matrix:
    """The sparse matrix that is made of these blocks."""
    if not blocks:
        return sparse.csc_matrix(shape)
    rows = np.concatenate([row + np.arange(size) for row, _, size, _ in blocks])
    columns = np.concatenate([column + np.arange(size) for _, column, size, _ in blocks])
    values = np.concatenate([np.full(size, value) for *_, size, value in blocks])
    return sparse.csc_matrix((values, (rows, columns)), shape=shape)
