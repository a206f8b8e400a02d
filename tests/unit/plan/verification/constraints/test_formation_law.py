"""How far vehicles are from the law of a change, for places that keep it or are off it by a known amount."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gcs.plan.verification.constraints.formation_law import Span, _off
from gcs.plan.verification.proof.taylor import constant
from gcs.types import Array

ORDER = 4
BEFORE = np.array([[0.0, 0.0, 0.0], [4.0, 1.0, 0.0], [-2.0, -3.0, -1.0], [1.0, -6.0, 2.0]])
AFTER = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [-6.0, 5.0, 1.0], [1.0, -5.0, 2.0]])
AXIS = np.array([0.6, 0.0, 0.8])
SHARES = np.array([0.0, 0.2, 0.7, 1.0])


def off_m(law: str, places: Array, after: Array = AFTER, axis_ned: Array = AXIS) -> Array:
    """How far (V, N) vehicles at places (V, N, 3) are from a law."""
    span = Span(0.0, 9.0, law, BEFORE, after, axis_ned)
    off = _off(span, [constant(places[..., axis], ORDER) for axis in range(3)])
    assert all(np.abs(part.c[1:]).max() == 0.0 for part in off)
    return np.linalg.norm([part.middle for part in off], axis=0)


def lawful(law: str, axis_ned: Array = AXIS) -> Array:
    """Places (V, 4, 3) that keep a law."""
    if law == "rigid":
        return np.repeat(BEFORE[:, None], len(SHARES), axis=1)
    if law == "in step":
        return BEFORE[:, None] + SHARES[:, None] * (AFTER - BEFORE)[:, None]
    turns = Rotation.from_rotvec(2.2 * SHARES[:, None] * axis_ned)
    return np.stack([turns.apply(place) for place in BEFORE])


@pytest.mark.parametrize(
    ("law", "axis"),
    [
        ("rigid", AXIS),
        ("in step", AXIS),
        ("rotate", AXIS),
        *(("rotate", axis) for axis in (*np.eye(3)[::2], *-np.eye(3)[::2])),
    ],
)
def test_a_vehicle_off_the_law_of_a_change_is_seen_and_no_other(law: str, axis: Array) -> None:
    """Vehicle 1 is off by 0.5 m. The place of the one with the longest way, and of the widest one, tells the share."""
    places = lawful(law, axis)
    np.testing.assert_allclose(off_m(law, places, axis_ned=axis), 0.0, atol=1e-12)
    off = np.array([0.3, 0.0, -0.4])
    places[1] += off
    expected = np.zeros((4, len(SHARES)))
    expected[1] = 0.5
    np.testing.assert_allclose(off_m(law, places, axis_ned=axis), expected, atol=1e-12)


def test_the_vehicle_that_tells_the_share_of_a_way_is_judged_across_it() -> None:
    """Ahead of the others it is on time, and they are late: each by its own way."""
    places = lawful("in step")
    way = (AFTER - BEFORE)[2]
    places[2] += 0.1 * way
    expected = 0.1 * np.linalg.norm(AFTER - BEFORE, axis=1)
    expected[2] = 0.0
    np.testing.assert_allclose(off_m("in step", places), np.repeat(expected[:, None], 4, axis=1), atol=1e-12)
    aside = np.cross(way, AXIS)
    places = lawful("in step")
    places[2] += 0.2 * aside / np.linalg.norm(aside)
    np.testing.assert_allclose(off_m("in step", places)[2], 0.2, atol=1e-12)


def test_the_vehicle_that_tells_the_angle_of_a_turn_is_judged_by_its_radius() -> None:
    """Vehicle 3 is the widest; on a circle that is 1 % larger it is off, by half of c^2 + s^2 - 1 of its radius."""
    places = lawful("rotate")
    along = places[3] @ AXIS
    across = places[3] - along[:, None] * AXIS
    places[3] = 1.01 * across + along[:, None] * AXIS
    radius_m = float(np.linalg.norm(across[0]))
    longer_m = 0.5 * (1.01**2 - 1.0) * radius_m
    np.testing.assert_allclose(off_m("rotate", places)[3], longer_m, atol=1e-12)


def test_a_change_that_moves_nobody_keeps_the_shape() -> None:
    places = lawful("rigid")
    np.testing.assert_allclose(off_m("in step", places, BEFORE), 0.0)
    places[1] += [0.0, 0.3, 0.4]
    np.testing.assert_allclose(off_m("in step", places, BEFORE)[1], 0.5)
