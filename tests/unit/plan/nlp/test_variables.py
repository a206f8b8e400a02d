"""Where each unknown is, and what the constant matrices make of a state that is a known polynomial of time."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.plan.formation.coordinates import CoordinateName
from gcs.plan.nlp.mesh import HOLD, Mesh
from gcs.plan.nlp.variables import ControlForm, VariableLayout
from gcs.types import Array

# Two legs of unequal intervals, between them a hold without nodes.
MESH = Mesh(np.array([2.0, 3.0, 6.0, 7.0, 11.0]), (2, 3, 0, 4), legs=(0, 0, HOLD, 1))
LINEAR = VariableLayout(MESH)
EQ_41 = VariableLayout(Mesh(np.array([2.0, 3.0, 6.0]), (2, 3)), ControlForm.LAGRANGE)
SHAPED = VariableLayout(MESH, coordinates=(CoordinateName.SCALE, CoordinateName.HEADING))
LAYOUTS = pytest.mark.parametrize("layout", [LINEAR, EQ_41, SHAPED], ids=["linear", "Eq. 41", "with coordinates"])


def states(layout: VariableLayout, t_s: Array) -> Array:
    """Each component another square of time; constant over the hold, which begins at 6 s and takes 1 s."""
    t_s = np.where(t_s > 6.0, np.maximum(t_s - 1.0, 6.0), t_s) if layout.mesh.legs else t_s
    number = np.arange(layout.nx) + 1.0
    return np.asarray(number + t_s[:, None] * (number % 3) + t_s[:, None] ** 2 * (number % 5))


def controls(layout: VariableLayout, t_s: Array) -> Array:
    """Each component another line of time."""
    number = np.arange(layout.nu) + 1.0
    return np.asarray(number + t_s[:, None] * (number % 3 - 1.0))


def unknowns(layout: VariableLayout) -> Array:
    """Joint by joint, node by node, then control point by control point: as the indices say."""
    w = np.full(layout.size, np.nan)
    joints, nodes = layout.mesh.joints_s, layout.node_times_s()
    for i, state in enumerate(states(layout, joints)):
        w[layout.joint(i) : layout.joint(i) + layout.nx] = state
    of_node = [(i, k) for i, degree in enumerate(layout.mesh.degrees) for k in range(degree)]
    for (i, k), state in zip(of_node, states(layout, nodes), strict=True):
        w[layout.node(i, k) : layout.node(i, k) + layout.nx] = state
    for point, control in enumerate(controls(layout, layout.control_times_s())):
        w[layout.control(point) : layout.control(point) + layout.nu] = control
    return w


@LAYOUTS
def test_every_unknown_has_one_index_and_one_name(layout: VariableLayout) -> None:
    w = unknowns(layout)
    assert not np.isnan(w).any()
    assert layout.size == len(layout.limits()) == layout.nx * layout.state_points + layout.nu * layout.control_points
    instants = layout.point_times_s()
    np.testing.assert_allclose(w[: layout.nx * len(instants)].reshape(-1, layout.nx), states(layout, instants))
    height, again = (layout.limits()[first + 2] for first in (layout.joint(1), layout.node(0, 1)))
    assert height == again and str(height) == "limit of height"
    assert str(layout.limits()[layout.control(1) + 3]) == "limit of control U4"
    assert layout.nz == layout.nx + layout.nu


def test_coordinates_add_chains_of_four_and_a_snap() -> None:
    assert (SHAPED.nx, SHAPED.nu, LINEAR.nx, LINEAR.nu) == (20, 6, 12, 4)
    assert tuple(map(str, SHAPED.state_ids[12:])) == (
        *("scale", "scale's rate", "scale's acceleration", "scale's jerk"),
        *("heading", "heading's rate", "heading's acceleration", "heading's jerk"),
    )
    assert tuple(map(str, SHAPED.control_ids[4:])) == ("scale's snap", "heading's snap")


@LAYOUTS
def test_samples_are_state_and_control_at_their_instants(layout: VariableLayout) -> None:
    t_s = np.array([2.0, 2.3, 3.0, 4.7, 5.9999, *([6.4, 7.0, 10.5, 11.0] if layout.mesh.legs else [6.0])])
    z = (layout.sampling(t_s) @ unknowns(layout)).reshape(len(t_s), layout.nz)
    np.testing.assert_allclose(z[:, : layout.nx], states(layout, t_s), atol=1e-9)
    np.testing.assert_allclose(z[:, layout.nx :], controls(layout, t_s), atol=1e-9)


@LAYOUTS
def test_a_motion_that_obeys_its_equation_leaves_nothing_of_eqs_44_and_46(layout: VariableLayout) -> None:
    """g = A w - B f is zero for the derivative f, and half the interval times the weights for an error of one node."""
    a, b = layout.collocation()
    nodes, number = layout.node_times_s(), np.arange(layout.nx) + 1.0
    moving = nodes - (nodes > 6.0) if layout.mesh.legs else nodes
    rate = number % 3 + 2.0 * moving[:, None] * (number % 5)
    left = a @ unknowns(layout) - b @ rate.ravel()
    np.testing.assert_allclose(left, 0.0, atol=1e-9)
    assert len(left) == layout.nx * len(layout.collocation_times_s())
    one = np.zeros_like(rate)
    one[2] = 1.0  # the first node of the second interval, 3 s long: a third of it is 5/18 of its length
    missed = (b @ one.ravel()).reshape(-1, layout.nx)
    np.testing.assert_allclose(missed[3], 1.5)
    np.testing.assert_allclose(missed[6], 3.0 * 5.0 / 18.0)
    assert np.flatnonzero(missed[:, 0]).tolist() == [3, 6]


def test_rows_of_eqs_44_and_46_are_at_their_nodes_and_ends() -> None:
    times = LINEAR.collocation_times_s()
    np.testing.assert_allclose(times[[2, 6, 7, 12]], [3.0, 6.0, 7.0, 11.0])
    np.testing.assert_allclose(np.delete(times, [2, 6, 7, 12]), LINEAR.node_times_s())
    root = np.sqrt(1.0 / 3.0)
    np.testing.assert_allclose(times[:2], [2.5 - 0.5 * root, 2.5 + 0.5 * root])


def test_weights_integrate_over_all_that_has_nodes() -> None:
    t_s = LINEAR.node_times_s()
    assert LINEAR.quadrature() @ t_s**2 == pytest.approx((6**3 - 2**3 + 11**3 - 7**3) / 3.0)


def test_controls_have_their_points_at_joints_or_at_nodes() -> None:
    assert LINEAR.control_points == 5
    points, support = LINEAR.control_support(1)
    assert (list(points), support.tolist()) == ([1, 2], [-1.0, 1.0])
    np.testing.assert_array_equal(LINEAR.control_times_s(), MESH.joints_s)
    points, support = EQ_41.control_support(1)
    assert list(points) == [2, 3, 4]
    np.testing.assert_allclose(support, [-np.sqrt(0.6), 0.0, np.sqrt(0.6)], atol=1e-15)
