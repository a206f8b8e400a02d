"""The fence's inclusion: around all places, and with the same corners whatever their last bits."""

from __future__ import annotations

import numpy as np
import shapely

from gcs.mission.failsafe.fence_areas import INCLUSION_MARGIN_M, inclusion_corners


def test_last_bits_make_no_corners() -> None:
    """Three straight tracks beside each other, every 2 m: places in line are corners of their hull, or are not."""
    along_m = np.arange(0.0, 300.0, 2.0)[:, None] * np.array([0.8, 0.6])
    places_m = np.concatenate([along_m + aside_m * np.array([-0.6, 0.8]) for aside_m in (0.0, 7.0, 14.0)])
    found = []
    for seed in range(10):
        noise = 1.0 + 1e-9 * np.random.default_rng(seed).uniform(-1.0, 1.0, places_m.shape)
        corners = inclusion_corners(places_m * noise)
        inside = shapely.Polygon(corners).buffer(-INCLUSION_MARGIN_M + 0.01)
        assert shapely.covers(inside, shapely.points(places_m)).all()
        found.append(corners)
    assert {len(corners) for corners in found} == {4}
    assert np.ptp(np.array(found), axis=0).max() < 0.01


def test_vehicles_in_one_place_or_in_line_have_a_fence() -> None:
    for places_m in (np.zeros((3, 2)), np.array([[0.0, 0.0], [50.0, 0.0], [20.0, 0.0]])):
        corners = inclusion_corners(places_m)
        assert shapely.covers(shapely.Polygon(corners), shapely.points(places_m)).all()
        assert len(corners) == 4
        low_m, high_m = places_m.min(axis=0) - corners.min(axis=0), corners.max(axis=0) - places_m.max(axis=0)
        assert np.concatenate([low_m, high_m]).max() < 1.5 * INCLUSION_MARGIN_M
