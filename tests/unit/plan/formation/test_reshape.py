"""New places: the fastest way where it is safe, else the next best, and an honest refusal where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.errors import Infeasible
from gcs.plan.formation.altitude_lanes import Deadlock, Lanes, find_lanes
from gcs.plan.formation.reshape import Reshaped, reshape
from gcs.plan.formation.separation import least_distance
from gcs.scenario.values.formations import places_up_m
from gcs.types import Array

LINE = places_up_m("line", 5, 2.0)
COLUMN = places_up_m("column", 5, 2.0)


def stops(made: Reshaped) -> list[Array]:
    return [made.legs[0].at(0.0), *(leg.at(1.0) for leg in made.legs)]


def ned(*north_east_up: tuple[float, float, float]) -> Array:
    """Offsets from the first, who is the leader."""
    return (np.array(north_east_up) - north_east_up[0]) * [1.0, 1.0, -1.0]


def test_the_fastest_way_is_taken_where_it_is_safe() -> None:
    """From abreast to behind: the outer ones fly sqrt(4^2 + 2^2 k) at least, whoever goes where."""
    made = reshape(LINE, COLUMN, 0, 1.0)
    assert made.way == "straight, shortest longest path"
    assert len(made.legs) == 1
    assert sorted(made.places) == list(range(5))
    assert made.places[0] == 0
    np.testing.assert_array_equal(made.offsets_after_ned_m, COLUMN[made.places])
    np.testing.assert_array_equal(made.legs[0].at(1.0), made.offsets_after_ned_m)
    # Two are 2 m beside the leader, two 4 m; the last place is 8 m behind: sqrt(4 + 64) for one of the inner two.
    assert np.linalg.norm(made.offsets_after_ned_m - LINE, axis=1).max() == pytest.approx(np.sqrt(68.0))


def test_a_symmetric_tie_is_not_decided_by_names() -> None:
    """Exchanged names of followers give the same formation and the same ways."""
    order = np.array([0, 3, 1, 4, 2])
    plain, renamed = reshape(LINE, COLUMN, 0, 1.0), reshape(LINE[order], COLUMN, 0, 1.0)
    lengths = [np.linalg.norm(made.offsets_after_ned_m - made.legs[0].at(0.0), axis=1) for made in (plain, renamed)]
    np.testing.assert_allclose(np.sort(lengths[0]), np.sort(lengths[1]))


def test_the_leader_keeps_his_place_wherever_he_is_listed() -> None:
    here, there = np.roll(LINE, 2, axis=0), np.roll(COLUMN, 2, axis=0)
    made = reshape(here, there, 2, 1.0)
    assert made.places[2] == 2
    np.testing.assert_array_equal(made.legs[0].offsets(np.linspace(0, 1, 11))[2], 0.0)


def test_two_who_would_cross_exchange_places_instead() -> None:
    """Fixed, they meet in the middle; free, both stay on their side."""
    here = ned((0, 0, 0), (3, -3, 0), (3, 3, 0))
    there = ned((0, 0, 0), (-3, 3, 0), (-3, -3, 0))
    free = reshape(here, there, 0, 1.0)
    assert free.places.tolist() == [0, 2, 1]
    fixed = reshape(here, there, 0, 1.0, fixed=True)
    assert fixed.places.tolist() == [0, 1, 2]
    assert "lane" in fixed.way


def test_a_way_through_the_leader_is_not_taken() -> None:
    """Ahead to behind: the shortest way leads through him. The other follower goes, or somebody passes above."""
    here, there = ned((0, 0, 0), (4, 0, 0), (0, 3, 0)), ned((0, 0, 0), (-4, 0, 0), (0, 3, 0))
    made = reshape(here, there, 0, 1.0)
    assert made.places.tolist() == [0, 2, 1]
    alone = reshape(here[:2], there[:2], 0, 1.0)
    assert alone.way == "in one altitude lane"
    assert [float(-stop[1, 2]) for stop in stops(alone)] == pytest.approx([0.0, 1.01, 1.01, 0.0])


def test_in_lanes_only_those_in_conflict_rise_and_the_others_go_straight_below() -> None:
    """Two exchange places through one another, a third moves beside them."""
    here = ned((0, 0, 0), (0, 4, 2), (0, 8, 0), (20, 0, 1))
    there = ned((0, 0, 0), (0, 8, 0), (0, 4, 2), (24, 0, 3))
    made = reshape(here, there, 0, 1.0, fixed=True)
    assert made.way == "in one altitude lane"
    up, across, down = made.legs
    risen = np.flatnonzero(np.linalg.norm(up.at(1.0) - up.at(0.0), axis=1))
    assert len(risen) == 1
    assert risen[0] in (1, 2)
    assert -up.at(1.0)[risen[0], 2] == pytest.approx(3.0 + 1.01)  # above the highest place, before or after
    np.testing.assert_array_equal(up.at(1.0)[risen[0], :2], here[risen[0], :2])
    np.testing.assert_array_equal(across.at(1.0)[3], there[3])
    np.testing.assert_array_equal(down.at(0.0)[risen[0], :2], there[risen[0], :2])
    assert made.least_distance_m >= 1.0


def test_lanes_are_as_many_as_cross_each_other() -> None:
    """Four at the corners of a square, all to the opposite one: one may stay below, three need lanes."""
    corners = ned((0, 100, 0), (3, 3, 0), (3, -3, 0), (-3, -3, 0), (-3, 3, 0))
    made = find_lanes(corners, corners[[0, 3, 4, 1, 2]], 0, 1.0)
    assert isinstance(made, Lanes)
    assert made.count == 3


def test_who_stands_above_rises_too_and_higher() -> None:
    """Below another and on a way through one who cannot rise: both go up in their order, though one is in no way."""
    here = ned((0, 8, 5), (0, 0, 0), (0, 0, 2), (0, 8, 0))
    there = ned((0, 8, 5), (0, 16, 0), (9, 9, 2), (0, 8, 0))
    made = find_lanes(here, there, 0, 1.0)
    assert isinstance(made, Lanes)
    rise = here[:, 2] - made.risen_ned_m[:, 2]
    assert rise[3] == 0.0
    assert -made.risen_ned_m[2, 2] > -made.risen_ned_m[1, 2] > 0.0
    for start, end in ((here, made.risen_ned_m), (made.risen_ned_m, made.crossed_ned_m), (made.crossed_ned_m, there)):
        assert least_distance(start, end)[0] >= 1.0


def test_of_two_in_conflict_the_one_with_nobody_above_rises() -> None:
    here = ned((50, 0, 0), (0, 0, 0), (0, 0, 2), (0, 8, 0))
    there = ned((50, 0, 0), (0, 8, 0), (9, 9, 2), (0, 0, 0))
    made = find_lanes(here, there, 0, 1.0)
    assert isinstance(made, Lanes)
    assert np.flatnonzero(made.risen_ned_m[:, 2] != here[:, 2]).tolist() == [3]


def test_nobody_rises_through_the_leader() -> None:
    """Who is below him stays below; the other one of the pair is lifted. If both are below him, there are no lanes."""
    here = ned((0, 0, 5), (0, 0, 0), (0, 8, 0))
    there = ned((0, 0, 5), (0, 8, 0), (0, 0.5, 1))
    made = find_lanes(here, there, 0, 1.0)
    assert isinstance(made, Deadlock)
    away = ned((0, 0, 5), (0, 8, 0), (0, -8, 0))
    assert least_distance(here, away)[0] < 1.0
    other = find_lanes(here, away, 0, 1.0)
    assert isinstance(other, Lanes)
    assert other.risen_ned_m[1, 2] == here[1, 2]


def test_where_lanes_fail_everything_spreads_out() -> None:
    """A wall of two columns that pass each other just too near, on both sides below the leader's height."""
    here = ned((0, 0, 9), (0, 0, 0), (0, 0, 3), (0, 0, 6))
    there = ned((0, 0, 9), (0, 0, 3), (0, 0.9, 0), (0, 0, 6))
    made = reshape(here, there, 0, 1.0, fixed=True)
    assert made.way.startswith("spread out to")
    assert len(made.legs) == 3
    assert made.least_distance_m >= 1.0
    np.testing.assert_array_equal(made.legs[2].at(1.0), there)


def test_a_refusal_names_the_two_and_what_to_do() -> None:
    """Two in the leader's column that have to change places, each his own."""
    here, there = ned((0, 0, 9), (0, 0, 0), (0, 0, 3)), ned((0, 0, 9), (0, 0, 3), (0, 0, 0))
    with pytest.raises(Infeasible) as caught:
        reshape(here, there, 0, 1.0, fixed=True, sysids=[1, 17, 4])
    assert "vehicles 17 and 4 would pass each other at 0.00 m" in caught.value.message
    assert "separation_min_m is 1 m" in caught.value.message
    assert 'leave out assignment = "fixed"' in caught.value.hint
    assert reshape(here, there, 0, 1.0).places.tolist() == [0, 2, 1]


@pytest.mark.parametrize("when", ["before", "after"])
def test_shapes_that_are_too_tight_themselves_are_refused(when: str) -> None:
    tight = LINE * 0.2
    pair = (tight, COLUMN) if when == "before" else (COLUMN, tight)
    with pytest.raises(Infeasible, match=f"{when} the change vehicles 1 and 2 stand 0.40 m apart") as caught:
        reshape(*pair, 0, 1.0)
    assert "spacing" in caught.value.hint


def test_offsets_are_from_the_leader() -> None:
    with pytest.raises(ValueError, match="from the leader"):
        reshape(LINE, COLUMN + 1.0, 0, 1.0)


@pytest.mark.parametrize("count", [1, 2])
def test_the_smallest_formations(count: int) -> None:
    made = reshape(LINE[:count], COLUMN[:count], 0, 1.0)
    np.testing.assert_array_equal(made.offsets_after_ned_m, COLUMN[:count])
