"""Volumes of F3548 hold every vehicle with its navigation error at every instant, and a centimetre less does not."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st
from implicitdict import ImplicitDict
from pymap3d.vincenty import track2
from uas_standards.astm.f3548.v21.api import OperationalIntentDetails
from uas_standards.astm.f3548.v21.constants import OiMaxVertices

import gcs
from gcs.errors import UsageError
from gcs.frames import Origin, geodetic_to_ned, ned_to_geodetic
from gcs.mission.export import flight_volumes as flight_volumes_module
from gcs.mission.export.flight_volumes import VolumeOrder, containment, flight_volumes
from gcs.mission.formats.f3548 import read_operational_intent
from gcs.mission.formats.flight_volume import FlightVolume, OperationalIntent
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.navigation_error import navigation_error
from gcs.scenario.values.si import local_origin

TAKEOFF = datetime(2026, 11, 28, 10, 30, tzinfo=UTC)
ORDER = VolumeOrder(TAKEOFF, 47.9, 8)


def plane(plan: Plan, volume: FlightVolume) -> shapely.Polygon:
    lat, lon = np.array(volume.corners_deg).T
    return shapely.Polygon(geodetic_to_ned(lat, lon, 0.0, local_origin(plan.scenario))[:, :2])


def moved(plan: Plan, volume: FlightVolume, by_m: float) -> FlightVolume:
    """The volume with all of its edges so much farther in or, negative, out."""
    corners = np.array(plane(plan, volume).buffer(-by_m, join_style="mitre").exterior.coords)[:-1]
    lat, lon, _ = ned_to_geodetic(np.column_stack([corners, np.zeros(len(corners))]), local_origin(plan.scenario))
    return replace(volume, corners_deg=tuple(zip(lat.tolist(), lon.tolist(), strict=True)))


def content(plan: Plan, intent: OperationalIntent) -> float:
    return sum(
        plane(plan, one).area * (one.upper_w84_m - one.lower_w84_m) * (one.end - one.start).total_seconds()
        for one in intent.volumes
    )


def outside_m(plan: Plan, intent: OperationalIntent, t_s: np.ndarray, geoid_m: float = ORDER.geoid_m) -> float:
    """How far the worst of many places on the surface of a vehicle's navigation error is outside, by samples."""
    error, origin = navigation_error(plan.scenario), local_origin(plan.scenario)
    places = plan.states(t_s)[..., POSITION]
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    ring = error.horizontal_m * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    worst = np.full(len(t_s), np.inf)
    for one in intent.volumes:
        begins, ends = (plan.t_start_s + (at - TAKEOFF).total_seconds() for at in (one.start, one.end))
        own = np.flatnonzero((t_s >= begins) & (t_s <= ends))
        shape = plane(plan, one)
        shapely.prepare(shape)
        around = shapely.points(places[:, own, None, :2] + ring)
        away = np.where(shapely.covers(shape, around), 0.0, shapely.distance(shape, around)).max(axis=(0, 2))
        height = origin.alt_amsl_m + geoid_m - places[:, own, 2]
        above = (height + error.vertical_m - one.upper_w84_m).max(axis=0)
        below = (one.lower_w84_m - height + error.vertical_m).max(axis=0)
        worst[own] = np.minimum(worst[own], np.maximum(away, np.maximum(above, below)))
    return float(worst.max())


@pytest.mark.parametrize("count", [1, 2, 8, 40])
def test_dense_samples_with_their_navigation_error_are_inside(hop: Plan, count: int) -> None:
    found = flight_volumes(hop, replace(ORDER, volumes=count))
    assert 1 <= len(found.intent.volumes) <= count
    t_s = np.random.default_rng(count).uniform(hop.t_start_s, hop.t_end_s, 3000)
    assert outside_m(hop, found.intent, np.append(t_s, [hop.t_start_s, hop.t_end_s])) <= 0.0
    assert 0.0 <= found.margin_m < 0.01  # inside, and not by a centimetre more than needed


def test_more_volumes_are_tighter_and_follow_one_another(hop: Plan) -> None:
    sizes = []
    for count in (1, 3, 8, 20):
        volumes = flight_volumes(hop, replace(ORDER, volumes=count)).intent.volumes
        sizes.append(content(hop, OperationalIntent(volumes)))
        assert volumes[0].start == TAKEOFF
        assert abs(volumes[-1].end - TAKEOFF - timedelta(seconds=hop.t_end_s - hop.t_start_s)) <= timedelta(
            seconds=0.001
        )
        for one, following in itertools.pairwise(volumes):
            assert timedelta(0) <= one.end - following.start <= timedelta(seconds=0.001)
    assert sizes == sorted(sizes, reverse=True) and sizes[-1] < 0.5 * sizes[0]


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 5))
def test_no_other_division_has_less_volume_times_duration(seed: int, most: int) -> None:
    rng = np.random.default_rng(seed)
    places = rng.normal(scale=30.0, size=(6, 2)).cumsum(axis=0)
    out_m = flight_volumes_module._directions() @ places.T + 2.0
    low_m = rng.uniform(0.0, 5.0, 6)
    reach = flight_volumes_module._Reach(out_m, low_m, low_m + rng.uniform(1.0, 9.0, 6), rng.uniform(0.1, 9.0, 6))

    def cost(firsts: list[int]) -> float:
        return sum(float(reach.costs(a)[b - a - 1]) for a, b in itertools.pairwise([*firsts, 6]))

    found = flight_volumes_module._division(reach, most)
    every = [[0, *cuts] for count in range(most) for cuts in itertools.combinations(range(1, 6), count)]
    assert len(found) <= most and cost(found) <= 1.01 * min(map(cost, every))


def test_a_formation_that_stands_still_is_in_one_volume() -> None:
    still = np.ones(9)
    reach = flight_volumes_module._Reach(np.ones((16, 9)), 0.0 * still, 5.0 * still, still)
    assert flight_volumes_module._division(reach, 5) == [0]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6))
def test_the_shortest_path_between_two_corners_is_within_the_bow(seed: int) -> None:
    rng = np.random.default_rng(seed)
    origin = Origin(*(float(rng.uniform(-most, most)) for most in (80.0, 179.0)), float(rng.uniform(0.0, 3000.0)))
    corners = 10.0 ** rng.uniform(2.0, 4.6) * rng.uniform(-1.0, 1.0, (2, 2))
    lat, lon, _ = ned_to_geodetic(np.column_stack([corners, [0.0, 0.0]]), origin)
    path = track2(lat[0], lon[0], lat[1], lon[1], npts=21)
    places = geodetic_to_ned(*map(np.array, path), origin.alt_amsl_m, origin)[:, :2]
    length_m = float(np.linalg.norm(corners[1] - corners[0]))
    ahead = (corners[1] - corners[0]) / length_m
    off_m = np.abs((places - corners[0]) @ [-ahead[1], ahead[0]]).max()
    assert off_m <= flight_volumes_module._bow_m(corners, np.array([length_m])) + 1e-4  # what the path itself is off


def test_a_centimetre_less_on_any_side_is_found(hop: Plan) -> None:
    whole = flight_volumes(hop, ORDER).intent
    assert containment(hop, ORDER, whole)[0] >= 0.0
    for row, volume in enumerate(whole.volumes):
        spoilt = [
            moved(hop, volume, 0.01),
            replace(volume, upper_w84_m=volume.upper_w84_m - 0.01),
            replace(volume, lower_w84_m=volume.lower_w84_m + 0.01),
        ]
        for one in spoilt:
            volumes = (*whole.volumes[:row], one, *whole.volumes[row + 1 :])
            margin_m, t_s = containment(hop, ORDER, OperationalIntent(volumes))
            assert -0.0101 < margin_m < 0.0
            begins_s = hop.t_start_s + (volume.start - TAKEOFF).total_seconds()
            assert begins_s - 0.001 <= t_s <= begins_s + (volume.end - volume.start).total_seconds()
    geoid = replace(ORDER, geoid_m=ORDER.geoid_m + 0.02)
    assert containment(hop, geoid, whole)[0] < 0.0


def test_a_gap_of_two_milliseconds_between_windows_is_found(hop: Plan) -> None:
    first, second, *rest = flight_volumes(hop, ORDER).intent.volumes
    late = replace(second, start=first.end + timedelta(milliseconds=2))
    assert containment(hop, ORDER, OperationalIntent((first, late, *rest)))[0] == -np.inf
    assert containment(hop, ORDER, OperationalIntent((first, second, *rest[:-1])))[0] == -np.inf
    earlier = replace(ORDER, takeoff=TAKEOFF - timedelta(seconds=1))
    assert containment(hop, earlier, OperationalIntent((first, second, *rest)))[0] < 0.0


@settings(max_examples=15, deadline=None)
@example(1.4, 0.0, 20, 0.0)  # 17.4 - 1.4 is less than 16
@given(st.floats(0.0, 30.0), st.floats(-100.0, 100.0), st.integers(1, 25), st.floats(0.0, 1.0))
def test_a_late_flight_is_inside_too(hop: Plan, late_s: float, geoid_m: float, count: int, share: float) -> None:
    order = VolumeOrder(TAKEOFF, geoid_m, count, late_s)
    found = flight_volumes(hop, order)
    assert found.margin_m >= 0.0
    delayed = [
        replace(one, start=one.start - delay, end=one.end - delay)
        for delay in [timedelta(seconds=share * late_s)]
        for one in found.intent.volumes
    ]
    t_s = np.random.default_rng(count).uniform(hop.t_start_s, hop.t_end_s, 300)
    assert outside_m(hop, OperationalIntent(tuple(delayed)), t_s, geoid_m) <= 0.0


def test_the_file_is_of_the_standard_and_holds_what_was_proved(hop: Plan, tmp_path: Path) -> None:
    index = gcs.export(hop, tmp_path, formats=["f3548"], volumes=ORDER)
    data = (tmp_path / "formation.f3548.json").read_bytes()
    details: Any = ImplicitDict.parse(json.loads(data), OperationalIntentDetails)
    assert 1 <= len(details.volumes) <= 8 and details.off_nominal_volumes == []
    assert sum(len(one.volume.outline_polygon.vertices) for one in details.volumes) < OiMaxVertices
    for one in details.volumes:
        assert one.volume.altitude_lower.reference == "W84" and one.volume.outline_polygon.vertices[0].lat
        assert one.volume.altitude_lower.value < one.volume.altitude_upper.value
        assert one.time_start.value.datetime < one.time_end.value.datetime
        assert one.time_start.value.endswith("Z")
        corners = [(corner.lat, corner.lng) for corner in one.volume.outline_polygon.vertices]
        assert len(set(corners)) == len(corners)
    assert containment(hop, ORDER, read_operational_intent(data, "x"))[0] == index.volumes.margin_m  # type: ignore[union-attr]
    written = json.loads((tmp_path / "index.json").read_text())["volumes"]
    assert written["count"] == len(details.volumes) and written["geoid_m"] == 47.9


def test_what_a_plan_does_not_say_must_be_given(hop: Plan, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="volumes need the instant of the take-off"):
        gcs.export(hop, tmp_path, formats=["f3548"])
    for wrong in ({"takeoff": datetime(2026, 11, 28)}, {"volumes": 0}, {"geoid_m": 488.0}, {"late_s": -1.0}):
        with pytest.raises(UsageError):
            replace(ORDER, **wrong)
