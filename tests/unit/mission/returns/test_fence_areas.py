"""The fence's inclusion: around all places, and with the same corners whatever their last bits."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from gcs.mission.returns.fence_areas import INCLUSION_MARGIN_M, inclusion_area, inclusion_corners
from gcs.scenario.schema.scenario import KeepIn


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


def _area(*corners: tuple[float, float]) -> KeepIn:
    return KeepIn(polygon_m=corners)


WAY_M = np.linspace([0.0, 0.0], [100.0, 0.0], 51)


def test_a_keep_in_area_cuts_the_fence() -> None:
    """A straight way along the middle of 12 m: the hull's 10 m of margin become 6 m, and 8 m beside one more area."""
    assert np.array_equal(np.array(inclusion_area(WAY_M, ()).exterior.coords)[:-1], inclusion_corners(WAY_M))
    strip = _area((-50.0, -6.0), (150.0, -6.0), (150.0, 6.0), (-50.0, 6.0))
    cut = inclusion_area(WAY_M, [strip])
    assert cut.bounds[1::2] == pytest.approx((-6.0, 6.0))
    half = _area((-50.0, -50.0), (150.0, -50.0), (150.0, 1.5), (-50.0, 1.5))
    both = inclusion_area(WAY_M, [strip, half])
    assert both.bounds[1::2] == pytest.approx((-6.0, 2.0))  # the way is 1.5 m from the edge: 0.5 m more are free
    assert both.covers(shapely.MultiPoint(WAY_M)) and shapely.covers(cut, both.buffer(-1e-6))


def test_a_fence_in_an_area_of_many_corners_has_few_and_holds_all_of_the_way() -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    out_m = 58.0 + 3.0 * np.sin(40.0 * angles)
    waves = _area(*((float(50.0 + r * np.cos(a)), float(r * np.sin(a))) for r, a in zip(out_m, angles, strict=True)))
    wide = np.concatenate([WAY_M, 40.0 * np.array([[1.25, 1.0], [1.25, -1.0]])])
    fence = inclusion_area(wide, [waves])
    assert len(fence.exterior.coords) <= 41
    assert fence.covers(shapely.MultiPoint(wide)) and fence.is_valid
    assert fence.difference(waves.area.buffer(8.0)).area == pytest.approx(0.0, abs=1e-6)
