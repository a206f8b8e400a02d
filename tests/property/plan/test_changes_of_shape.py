"""Two hundred random changes of 2 to 50 vehicles: apart at every instant, gentle at every joint, within the budget."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from numpy.random import Generator as Random
from scipy.spatial.distance import pdist

from gcs.errors import Infeasible
from gcs.plan.formation.reshape import Reshaped, reshape
from gcs.plan.formation.separation import least_distance, least_gap
from gcs.plan.formation.shape import Shape, joined, stretched
from gcs.plan.formation.time_scaling import Budget, least_duration
from gcs.plan.formation.transforms import rotation, shrinking
from gcs.scenario.schema.scenario import Generator
from gcs.scenario.values.formations import places_up_m
from gcs.types import Array

SEPARATION_M = 1.2
FLAT: list[Generator] = ["triangle", "line", "column", "vee", "grid", "circle"]
BUDGET = Budget(speed_mps=1.0, accel_mps2=0.3, jerk_mps3=1.0, snap_mps4=20.0)


def scattered(random: Random, count: int, size: tuple[float, float, float]) -> Array:
    """Random places in a box of these proportions, the first at the origin, a little further apart than they must."""
    extent = SEPARATION_M * random.uniform(1.5, 3.0) * count ** (1.0 / np.count_nonzero(size)) * np.array(size)
    places = [np.zeros(3)]
    while len(places) < count:
        new = random.uniform(-extent / 2, extent / 2)
        if np.linalg.norm(new - places, axis=1).min() >= 1.02 * SEPARATION_M:
            places.append(new)
        extent *= 1.001
    return np.array(places)


def generated(random: Random, count: int, names: list[Generator]) -> Array:
    """A generator's shape with its followers in any order."""
    places = places_up_m(names[random.integers(len(names))], count, SEPARATION_M * random.uniform(1.02, 1.5)) * [
        1.0,
        1.0,
        -1.0,
    ]
    return np.concatenate([places[:1], random.permutation(places[1:])])


@dataclass(frozen=True)
class Case:
    """A change between two formations; `made` is None where it was refused."""

    group: str
    here: Array
    there: Array
    made: Reshaped | None


def flat(random: Random, count: int) -> Array:
    return scattered(random, count, (1.0, 1.0, 0.0)) if random.random() < 0.5 else generated(random, count, FLAT)


def spatial(random: Random, count: int) -> Array:
    kind = random.integers(4)
    if kind == 0:
        return generated(random, count, ["sphere"])
    if kind == 1:
        return scattered(random, count, (0.0, 1.0, 1.0))  # upright
    return scattered(random, count, (1.0, 1.0, 1.0))


GROUPS = {
    "flat": (80, (flat, flat), False),
    "flat, each its own place": (40, (flat, flat), True),
    "flat and spatial": (40, (flat, spatial), False),
    "spatial": (40, (spatial, spatial), False),
}


@pytest.fixture(scope="module")
def cases() -> list[Case]:
    random = np.random.default_rng(2024)
    found = []
    for group, (number, kinds, fixed) in GROUPS.items():
        for _ in range(number):
            count = round(2.0 * 25.0 ** random.random())
            here, there = (kind(random, count) for kind in kinds)
            try:
                made = reshape(here, there, 0, SEPARATION_M, fixed=fixed)
            except Infeasible:
                made = None
            found.append(Case(group, here, there, made))
    return found


@pytest.fixture(scope="module")
def flown(cases: list[Case]) -> list[tuple[Case, Reshaped]]:
    return [(case, case.made) for case in cases if case.made is not None]


def timed(legs: tuple[Shape, ...]) -> Shape:
    """All legs, each in its least time."""
    parts: list[Shape] = []
    for leg in legs:
        now_s = parts[-1].end_s if parts else 7.0
        seconds, _ = least_duration(leg, BUDGET)
        parts.append(stretched(leg, now_s, now_s + seconds))
    return joined(parts)


def test_there_are_two_hundred_and_almost_all_can_be_flown(cases: list[Case]) -> None:
    """Flat formations always can: above them there is room for all vehicles."""
    assert len(cases) == 200
    refused = Counter(case.group for case in cases if case.made is None)
    assert refused["flat"] == refused["flat, each its own place"] == 0
    assert refused.total() <= 2


def test_every_way_is_taken_by_some_and_named(flown: list[tuple[Case, Reshaped]]) -> None:
    ways = Counter(re.sub(r"[\d.]+|\bone\b", "N", made.way).replace("lanes", "lane") for _, made in flown)
    assert set(ways) == {
        "straight, shortest longest path",
        "straight, least sum of squared paths",
        "straight, each vehicle to its own place",
        "straight, in N turns",
        "in N altitude lane",
        "spread out to N times the size, across, together again",
    }, ways


def test_every_leg_keeps_the_separation_at_every_instant(flown: list[tuple[Case, Reshaped]]) -> None:
    share = np.linspace(0.0, 1.0, 61)
    for case, made in flown:
        least = np.inf
        for leg in made.legs:
            exact = least_distance(leg.at(0.0), leg.at(1.0))[0]
            sampled = min(pdist(places).min() for places in leg.offsets(share).transpose(1, 0, 2))
            assert SEPARATION_M - 1e-9 <= exact <= sampled + 1e-9, case.group
            least = min(least, exact)
        assert made.least_distance_m == pytest.approx(least)


def test_every_way_leads_from_here_to_there_and_the_leader_stays(flown: list[tuple[Case, Reshaped]]) -> None:
    for case, made in flown:
        assert sorted(made.places) == list(range(len(case.here)))
        np.testing.assert_array_equal(made.legs[0].at(0.0), case.here)
        np.testing.assert_array_equal(made.legs[-1].at(1.0), case.there[made.places])
        for before, after in pairwise(made.legs):
            np.testing.assert_array_equal(before.at(1.0), after.at(0.0))
        for leg in made.legs:
            np.testing.assert_array_equal(leg.at(0.4)[0], 0.0)


def test_no_joint_is_felt_up_to_the_jerk(flown: list[tuple[Case, Reshaped]]) -> None:
    for _, made in flown:
        shape = timed(made.legs)
        joints = shape.joints_s[1:-1]
        for order in range(4):
            left = shape.offsets(np.nextafter(joints, 0.0), order)
            np.testing.assert_allclose(shape.offsets(joints, order), left, atol=1e-10)


def test_every_leg_uses_its_budget_whole_and_no_more(flown: list[tuple[Case, Reshaped]]) -> None:
    limits = np.array([BUDGET.speed_mps, BUDGET.accel_mps2, BUDGET.jerk_mps3, BUDGET.snap_mps4])
    for _, made in flown:
        for leg in made.legs:
            shape = timed((leg,))
            t_s = np.linspace(shape.start_s, shape.end_s, 601)
            used = [np.linalg.norm(shape.offsets(t_s, order), axis=2).max() for order in (1, 2, 3, 4)]
            assert 0.999 <= np.max(used / limits) <= 1.001


@pytest.mark.parametrize("seed", range(20))
def test_turning_and_shrinking_keep_what_they_promise(seed: int) -> None:
    random = np.random.default_rng(seed)
    places = (flat if seed % 2 else spatial)(random, int(random.integers(2, 51)))
    turn = rotation(places, random.normal(size=3), float(random.uniform(-7.0, 7.0)))
    gap_m = least_gap(places)[0]
    share = np.linspace(0.0, 1.0, 61)
    for at in turn.offsets(share).transpose(1, 0, 2):
        np.testing.assert_allclose(pdist(at), pdist(places), rtol=1e-10)
    scale = SEPARATION_M / gap_m
    for at in shrinking(places, scale).offsets(share).transpose(1, 0, 2):
        assert pdist(at).min() >= SEPARATION_M * (1.0 - 1e-12)
