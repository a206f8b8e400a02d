"""Least distances of straight motions and of returns: no sample is nearer than what is found."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.mission.predicted.closest_approach import closest_approach
from gcs.mission.predicted.planned_flight import PredictedFlight
from gcs.mission.returns.rtl_cases import Returning, ReturnSpeeds, ReturnTo, pair_distances, places_at
from gcs.types import Array

untimed = settings(deadline=None)
coordinates = st.floats(-30, 30)


@st.composite
def fleets(draw: st.DrawFn) -> list[PredictedFlight]:
    fleet = []
    for _ in range(draw(st.integers(2, 4))):
        t_s = np.array(sorted(draw(st.lists(st.integers(0, 50), min_size=2, max_size=4, unique=True))), dtype=float)
        ned_m = np.array([[draw(coordinates) for _ in range(3)] for _ in t_s])
        fleet.append(PredictedFlight(t_s, ned_m, np.zeros(len(t_s)), float(t_s[0]), float(t_s[-1]), math.inf))
    return fleet


def at(flight: PredictedFlight, t_s: Array) -> Array:
    return np.stack([np.interp(t_s, flight.t_s, flight.ned_m[:, axis]) for axis in range(3)], axis=-1)


def lift_off_s(flight: PredictedFlight) -> float:
    moved = np.flatnonzero(np.any(flight.ned_m != flight.ned_m[0], axis=1))
    return float(flight.t_s[moved[0] - 1]) if len(moved) else math.inf


@untimed
@given(fleets())
def test_no_sample_is_nearer(fleet: list[PredictedFlight]) -> None:
    found = closest_approach(fleet)
    lifted = [lift_off_s(f) for f in fleet]
    if found is None:
        assert math.isinf(min(lifted))
        return
    i, j = found.pair
    there = at(fleet[i], np.array([found.t_s])) - at(fleet[j], np.array([found.t_s]))
    assert np.linalg.norm(there) == pytest.approx(found.distance_m, abs=1e-6)
    t_s = np.linspace(0.0, 50.0, 501)
    ends = [f.t_s[-1] for f in fleet]
    for a, b in itertools.combinations(range(len(fleet)), 2):
        flying = ((t_s > lifted[a]) & (t_s < ends[a])) | ((t_s > lifted[b]) & (t_s < ends[b]))
        distance = np.linalg.norm(at(fleet[a], t_s) - at(fleet[b], t_s), axis=-1)
        assert np.min(distance[flying], initial=np.inf) >= found.distance_m - 1e-6


points = st.tuples(coordinates, coordinates, st.floats(-30, 0))
speeds = st.builds(ReturnSpeeds, *[st.floats(0.5, 10)] * 3, st.floats(0, 10))


@untimed
@given(st.tuples(points, points), st.tuples(points, points), st.tuples(*[st.floats(0, 60)] * 2), speeds)
def test_no_moment_of_two_returns_is_nearer(
    starts: tuple[tuple[float, ...], ...],
    ends: tuple[tuple[float, ...], ...],
    heights_m: tuple[float, float],
    fast: ReturnSpeeds,
) -> None:
    ground = np.array(ends)[:, None] * [1, 1, 0]
    case = Returning(ReturnTo.HOME, np.zeros(1), np.array(starts)[:, None], ground, np.zeros((2, 1)), fast)
    motions = [case.motion(row, heights_m[row]) for row in range(2)]
    least = pair_distances(*motions)
    last_s = max(float(times[0, -1]) for times, _ in motions)
    looks = np.linspace(-1.0, last_s + 1.0, 1001)[None]
    between = np.linalg.norm(places_at(motions[0], looks) - places_at(motions[1], looks), axis=-1)
    assert between.min() >= least[0] - 1e-6
    # Nothing moves faster than these speeds, so samples that fine are not much farther apart either.
    step_s = (last_s + 2.0) / 1000
    assert between.min() <= least[0] + 2.0 * max(fast.climb_mps, fast.cruise_mps, fast.sink_mps) * step_s + 1e-6
