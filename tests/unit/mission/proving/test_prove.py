"""Tracks against formulas, against a search by brute force, and against limits that each is made to violate."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly

import gcs
from gcs.errors import GcsError, UsageError, VerificationError
from gcs.mission.proving.timed_samples import through
from gcs.types import Array
from tests.unit.plan.problems import FLAT, changed


def line(name: str, start: Any, velocity: Any, t_s: Any = (0.0, 10.0)) -> gcs.PolynomialTrack:
    """A straight line at an even speed, with samples at these times."""
    times = np.asarray(t_s, dtype=float)
    return gcs.PolynomialTrack(
        name, through(times, np.asarray(start, float) + times[:, None] * np.asarray(velocity, float))
    )


def check_of(report: gcs.TrackReport, name: str) -> gcs.TrackCheck:
    (found,) = (check for check in report.checks if check.name == name)
    return found


@pytest.mark.parametrize("seed", range(20))
def test_two_lines_that_cross_are_as_near_as_the_formula_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, velocity = rng.uniform(-8.0, 8.0, (2, 3)), rng.uniform(-3.0, 3.0, (2, 3))
    scale = float(rng.uniform(0.5, 3.0)) if seed % 2 else 1.0
    squeeze = [1.0, 1.0, 1.0 / scale]
    apart, moving = (start[1] - start[0]) * squeeze, (velocity[1] - velocity[0]) * squeeze
    t_s = float(np.clip(-(apart @ moving) / (moving @ moving), 0.0, 10.0))
    least_m = float(np.linalg.norm(apart + t_s * moving))
    tracks = [
        line("a", start[0], velocity[0], [0.0, 0.7, 3.9, 10.0]),
        line("b", start[1], velocity[1], [0.0, 2.2, 10.0]),
    ]
    proved = check_of(gcs.prove(tracks, gcs.TrackLimits(least_m - 0.01, scale)), "separation")
    assert proved.verdict == "proved"
    assert proved.vehicles == ("a", "b")
    assert least_m - 1e-3 <= proved.proved <= least_m + 1e-9
    violated = check_of(gcs.prove(tracks, gcs.TrackLimits(least_m + 0.01, scale)), "separation")
    assert violated.verdict == "violated"
    assert violated.seen == pytest.approx(least_m, abs=1e-3)
    assert np.linalg.norm(apart + violated.t_s * moving) == pytest.approx(violated.seen, abs=1e-9)


def test_polynomials_that_overflow_or_whose_terms_cancel_are_refused() -> None:
    """(t - 500 s)^7 / 1000 is below 0.5 m from 497.6 s to 502.4 s: in powers of t, rounding moves it by far more."""
    c = np.zeros((8, 2, 3))
    c[0], c[7, 1] = 1e300, 5.0
    overflows = PPoly(c, [0.0, 1e200, 2e200])
    powers = np.zeros((8, 1, 3))
    powers[:, 0, 0] = np.poly([500.0] * 7) / 1000.0
    far = PPoly(np.full((1, 1, 3), 1e13), [0.0, 1.0])
    for polynomial in (overflows, PPoly(powers, [0.0, 1000.0]), far):
        with pytest.raises(UsageError, match="rounding moves its places by"):
            gcs.prove([gcs.PolynomialTrack("far", polynomial)])
    shifted = np.zeros((8, 1, 3))
    shifted[0, 0, 0] = 1e-3
    assert gcs.prove([gcs.PolynomialTrack("near", PPoly(shifted, [0.0, 9.0]))]).ok


@pytest.mark.parametrize("off_m", [-0.1, math.nan, math.inf])
def test_a_track_is_off_its_polynomial_by_a_length(off_m: float) -> None:
    with pytest.raises(GcsError, match="off_m"):
        gcs.PolynomialTrack("a", PPoly(np.zeros((1, 1, 3)), [0.0, 1.0]), off_m)


@pytest.mark.parametrize(("end_m", "verdict"), [(-10.0, "violated"), (0.0, "proved")])
def test_only_an_end_on_the_ground_may_be_outside_the_box(
    simulation1: gcs.Scenario, end_m: float, verdict: str
) -> None:
    scenario = changed(simulation1, terrain=FLAT, no_fly=[])
    places = np.array([[0, 0, 0], [0, 0, -10], [-90, 0, -10], [-90, 0, end_m]])
    away = gcs.PolynomialTrack("away", through(np.array([0.0, 5.0, 30.0, 35.0]), places))
    assert check_of(gcs.prove([away], None, scenario), "least northing").verdict == verdict


def near_pass(rng: np.random.Generator, limit_m: float, beyond_m: float, lasts_s: float) -> tuple[Array, Array]:
    """Times (N,) and places (3, N, 3) of three vehicles; of two the least distance is the limit less `beyond_m`.

    They are nearer than the limit for so long only, between two samples. All follow one random course beside that.
    """
    t_s = np.concatenate([[0.0], np.cumsum(np.round(rng.uniform(0.2, 1.0, 12), 3))]).round(3)
    piece = int(rng.integers(2, 9))
    nearest_s = rng.uniform(t_s[piece] + 0.05, t_s[piece + 1] - 0.05)
    least_m = limit_m - beyond_m
    speed_mps = 2.0 * np.sqrt(abs(limit_m**2 - least_m**2)) / lasts_s
    one, other = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
    relative_m = least_m * one + speed_mps * (t_s - nearest_s)[:, None] * other
    course_m = np.cumsum(rng.normal(0.0, 3.0, (len(t_s), 3)), axis=0)
    far_m = np.array([1e4, 0.0, 0.0])
    return t_s, np.stack([course_m, course_m + far_m, course_m + relative_m])


def smallest_m(t_s: Array, places_m: Array, at_s: Array) -> Array:
    """The distance of vehicles 0 and 2 at instants, by interpolation of the samples."""
    first, second = (np.stack([np.interp(at_s, t_s, p[:, axis]) for axis in range(3)], 1) for p in places_m[[0, 2]])
    return np.asarray(np.linalg.norm(first - second, axis=1))


def with_joints(track: gcs.PolynomialTrack, at_s: Array) -> gcs.PolynomialTrack:
    """The same motion, with joints at these times as well."""
    motion = track.position_ned_m
    x = np.union1d(motion.x, at_s)
    powers = [motion(x[:-1], order) / math.factorial(order) for order in range(len(motion.c))]
    return replace(track, position_ned_m=PPoly(np.stack(powers[::-1]), x))


def find_hidden_collisions(rng: np.random.Generator, count: int) -> None:
    """Hide collisions of 1 mm to 10 cm for 1 to 40 ms between samples, and find them by brute force and by proof."""
    for turn in range(count):
        limit_m, beyond_m = rng.uniform(0.2, 1.5), 10.0 ** rng.uniform(-3.0, -1.0)
        t_s, places_m = near_pass(rng, limit_m, beyond_m, rng.uniform(1e-3, 40e-3))
        every_s = np.linspace(0.0, t_s[-1], 50_001)
        around_s = every_s[smallest_m(t_s, places_m, every_s).argmin()] + np.linspace(-1e-3, 1e-3, 20_001)
        least_m = float(smallest_m(t_s, places_m, around_s).min())
        assert smallest_m(t_s, places_m, t_s).min() > limit_m  # no sample shows it
        assert least_m < limit_m - 0.9 * beyond_m
        motion: list[tuple[Array, ...]] = [(place,) for place in places_m]
        if turn % 2:  # cubics: what all do together does not change their distances
            together = rng.normal(0.0, 3.0, (len(t_s), 3))
            motion = [(place, together + np.gradient(place - places_m[0], t_s, axis=0)) for place in places_m]
        tracks = [gcs.PolynomialTrack(f"uav{row}", through(t_s, *each)) for row, each in enumerate(motion)]
        if turn % 3:  # each divided at times of its own
            tracks = [with_joints(track, rng.uniform(0.0, t_s[-1], int(rng.integers(40)))) for track in tracks]
        found = check_of(gcs.prove(tracks, gcs.TrackLimits(limit_m)), "separation")
        assert found.verdict == "violated"
        assert set(found.vehicles) == {"uav0", "uav2"}
        assert smallest_m(t_s, places_m, np.array([found.t_s]))[0] == pytest.approx(found.seen, abs=1e-6)
        assert found.seen < limit_m
        just = gcs.prove(tracks, gcs.TrackLimits(least_m - 1e-3))
        assert check_of(just, "separation").verdict == "proved"


@pytest.mark.parametrize("seed", range(8))
def test_every_collision_between_samples_is_found_and_no_other(seed: int) -> None:
    find_hidden_collisions(np.random.default_rng(seed), 15)


@pytest.mark.parametrize("seed", range(4))
def test_tracks_that_turn_at_times_of_their_own_are_as_near_as_the_formula_says(seed: int) -> None:
    """What shows and planners of each vehicle write: no vehicle has a joint where another has."""
    rng = np.random.default_rng(seed)
    tracks = []
    for row in range(8):
        t_s = np.concatenate([[0.0], np.sort(rng.uniform(1.0, 29.0, 20)), [30.0]])
        place = np.array([4.0 * (row % 4), 4.0 * (row // 4), -20.0]) + rng.uniform(-1.2, 1.2, (len(t_s), 3))
        tracks.append(gcs.PolynomialTrack(f"uav{row}", through(t_s, place)))
    every_s = np.unique(np.concatenate([track.position_ned_m.x for track in tracks]))
    places_m = np.stack([track.position_ned_m(every_s) for track in tracks])
    first, second = np.triu_indices(len(tracks), 1)
    apart_m = places_m[first] - places_m[second]
    start, change = apart_m[:, :-1], np.diff(apart_m, axis=1)
    share = np.clip(-(start * change).sum(axis=2) / np.maximum((change**2).sum(axis=2), 1e-12), 0.0, 1.0)
    least_m = float(np.linalg.norm(start + share[..., None] * change, axis=2).min())
    found = check_of(gcs.prove(tracks, gcs.TrackLimits(least_m - 0.01)), "separation")
    assert found.verdict == "proved"
    assert least_m - 2e-3 <= found.proved <= least_m + 1e-9
    assert least_m - 1e-9 <= found.seen <= least_m + 2e-3


@pytest.mark.parametrize("dash_s", np.linspace(3.05, 9.0, 12))
def test_a_dash_between_the_times_of_others_is_seen(dash_s: float) -> None:
    """One flies slowly away from another, dashes to 1 m from it within 0.1 s, and is 20 m away again 0.1 s later."""
    others = [
        line(f"far{k}", [100.0 + 50.0 * k, 0.0, -20.0], [0.0, 0.0, 0.0], np.arange(13) + 0.3 * k) for k in range(3)
    ]
    stands = line("stands", [0.0, 0.0, -20.0], [0.0, 0.0, 0.0], [0.0, 12.0])
    times = np.array([0.0, dash_s - 0.1, dash_s, dash_s + 0.1, 12.0])
    north_m = np.array([10.0, 20.0, 1.0, 20.0, 21.0])
    dashes = gcs.PolynomialTrack("dashes", through(times, np.stack([north_m, 0.0 * north_m, 0.0 * north_m - 20.0], 1)))
    found = check_of(gcs.prove([stands, *others, dashes], gcs.TrackLimits(2.0)), "separation")
    assert found.verdict == "violated"
    assert found.seen == pytest.approx(1.0, abs=0.05)
    assert set(found.vehicles) == {"stands", "dashes"}


@pytest.mark.long
def test_ten_thousand_collisions_between_samples_are_found(capsys: pytest.CaptureFixture[str]) -> None:
    """Six minutes of CPU time."""
    rng = np.random.default_rng(100)
    for found in range(500, 10_001, 500):
        find_hidden_collisions(rng, 500)
        with capsys.disabled():
            print(f"{found} of 10000 hidden collisions found", flush=True)


@pytest.mark.parametrize("seed", range(6))
def test_curves_of_every_degree_are_bounded_as_brute_force_finds_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    degree = int(rng.integers(3, 8))
    x = np.concatenate([[0.0], np.cumsum(rng.uniform(0.5, 2.0, 4))])
    tracks = []
    for name in "abc":
        pieces, place = [], rng.uniform(-4.0, 4.0, 3)
        for h in np.diff(x):
            c = rng.normal(0.0, 0.4, (degree + 1, 3)) / np.arange(1, degree + 2)[::-1, None]
            c[-1] = place
            place = np.array([np.polyval(c[:, axis], h) for axis in range(3)])
            pieces.append(c)
        tracks.append(gcs.PolynomialTrack(name, PPoly(np.stack(pieces, axis=1), x)))
    every_s = np.linspace(0.0, x[-1] * (1 - 1e-12), 200_001)
    places = np.stack([t.position_ned_m(every_s) for t in tracks])
    least_m = min(np.linalg.norm(places[a] - places[b], axis=1).min() for a, b in ((0, 1), (0, 2), (1, 2)))
    most = [np.linalg.norm([t.position_ned_m(every_s, n) for t in tracks], axis=2).max() for n in (1, 2)]
    high = -places[:, :, 2]
    limits = gcs.TrackLimits(least_m, 1.0, most[0] * 1.001, most[1] * 1.001, (high.min() - 0.01, high.max() + 0.01))
    report = gcs.prove(tracks, limits)
    assert not [c for c in report.failures if c.name != "step of the velocity at a joint"], report
    assert check_of(report, "separation").proved == pytest.approx(least_m, abs=1e-3)
    assert check_of(report, "speed").proved == pytest.approx(most[0], rel=3e-3)
    assert check_of(report, "acceleration").proved == pytest.approx(most[1], rel=3e-3)
    assert check_of(report, "greatest height").proved == pytest.approx(high.max(), abs=1e-2)


def curve(name: str, height_m: float = 10.0) -> gcs.PolynomialTrack:
    """From rest 9 m north within 3 s and to rest: 4.5 m/s after 1.5 s, 6 m/s² at both ends."""
    t_s = np.array([0.0, 3.0])
    return gcs.PolynomialTrack(
        name, through(t_s, np.array([[0.0, 0.0, -height_m], [9.0, 0.0, -height_m]]), np.zeros((2, 3)))
    )


@pytest.mark.parametrize(
    ("limits", "name", "seen", "at_s"),
    [
        ({"speed_mps": 4.4}, "speed", 4.5, 1.5),
        ({"acceleration_mps2": 5.9}, "acceleration", 6.0, None),
        ({"height_m": (10.2, 20.0)}, "least height", 10.0, None),
        ({"height_m": (0.0, 14.0)}, "greatest height", 15.0, None),
        ({"separation_m": 5.5}, "separation", 5.0, None),
    ],
)
def test_a_violated_limit_is_named_with_vehicle_and_time(
    limits: dict[str, Any], name: str, seen: float, at_s: float | None
) -> None:
    slow = gcs.PolynomialTrack(
        "slow", through(np.array([0.0, 3.0]), np.array([[0.0, 0.0, -15.0]] * 2), np.zeros((2, 3)))
    )
    high = replace(
        slow, position_ned_m=PPoly(slow.position_ned_m.c + curve("x").position_ned_m.c * [1, 0, 0], [0.0, 3.0])
    )
    tracks = [curve("fast"), high] if name == "separation" else [curve("fast"), slow]
    report = gcs.prove(tracks, gcs.TrackLimits(**{"separation_m": 0.1} | limits))
    (check,) = report.failures
    assert (check.name, check.verdict) == (name, "violated")
    assert check.seen == pytest.approx(seen, abs=0.03)
    assert set(check.vehicles) <= {"fast", "slow"}
    assert "fast" in check.vehicles or name == "greatest height"
    if at_s is not None:
        assert check.t_s == pytest.approx(at_s, abs=0.2)
    error = report.refusal()
    assert isinstance(error, VerificationError)
    assert name in error.message
    assert f"t = {check.t_s:.3f} s" in str(check)


def test_ground_and_zones_are_the_scenarios(simulation1: gcs.Scenario) -> None:
    disk = {"north_m": 50.0, "east_m": 0.0, "radius_m": 5.0}
    scenario = changed(simulation1, terrain=FLAT, no_fly=[disk])
    up = gcs.PolynomialTrack(
        "up",
        through(np.array([0.0, 5.0, 15.0, 20.0]), np.array([[0, 0, 0], [0, 0, -10], [100, 0, -10], [100, 0, 0.0]])),
    )
    report = gcs.prove([up], None, scenario)
    zone = check_of(report, "distance to no-fly zone 1")
    assert zone.verdict == "violated"
    assert zone.t_s == pytest.approx(10.0, abs=0.5)
    assert check_of(report, "clearance above the ground").verdict == "proved"
    low = gcs.PolynomialTrack(
        "low",
        through(np.array([0.0, 5.0, 9.0, 15.0]), np.array([[0, 9, 0], [0, 9, -10], [0, 30, -0.1], [0, 40, -10.0]])),
    )
    ground = check_of(gcs.prove([low], None, scenario), "clearance above the ground")
    assert (ground.verdict, ground.vehicles) == ("violated", ("low",))
    assert ground.t_s == pytest.approx(9.0, abs=0.01)
    assert ground.seen == pytest.approx(0.1, abs=0.01)


def test_a_broken_polynomial_is_a_violation_at_its_joint_and_hides_no_pair() -> None:
    """The step is to the other vehicle, within a window that boxes and velocities alone would pass."""
    steady = line("steady", (0.0, 0.0, -10.0), (0.0, 0.0, 0.0))
    times = np.array([0.0, 4.0, 4.5, 10.0])
    c = np.zeros((2, 3, 3))
    c[1] = [[5.0, 0.0, -10.0], [0.3, 0.0, -10.0], [5.0, 0.0, -10.0]]
    report = gcs.prove([steady, gcs.PolynomialTrack("broken", PPoly(c, times))], gcs.TrackLimits(1.0))
    step = check_of(report, "step of the place at a joint")
    assert (step.verdict, step.vehicles) == ("violated", ("broken",))
    assert step.seen == pytest.approx(4.7)
    assert step.t_s in (4.0, 4.5)
    near = check_of(report, "separation")
    assert near.verdict == "violated"
    assert near.seen == pytest.approx(0.3)
    assert 4.0 <= near.t_s <= 4.5


def test_a_vehicle_stands_before_and_after_its_own_track() -> None:
    landed = line("landed", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 2.0))
    later = line("later", (2.0, -6.0, 0.0), (0.0, 1.0, 0.0), (1.0, 9.0))
    near = check_of(gcs.prove([landed, later], gcs.TrackLimits(0.5)), "separation")
    assert near.verdict == "violated"
    assert near.t_s == pytest.approx(6.0, abs=0.5)


@pytest.mark.parametrize(
    ("tracks", "limits", "words"),
    [
        ([], {}, "no tracks"),
        ([line("a", (0, 0, 0), (1, 0, 0))] * 2, {"separation_m": 1.0}, "name a"),
        ([line("a", (0, 0, 0), (1, 0, 0)), line("b", (9, 0, 0), (1, 0, 0))], {}, "no separation"),
        ([line("a", (0, 0, 0), (1, 0, 0))], {"acceleration_mps2": 3.0}, "straight between samples"),
        ([line("a", (0, 0, 0), (1, 0, 0))], {"clearance_m": 3.0}, "needs the ground"),
    ],
)
def test_what_leaves_nothing_to_prove_is_refused(
    tracks: list[gcs.PolynomialTrack], limits: dict[str, Any], words: str
) -> None:
    with pytest.raises(UsageError, match=words) as refused:
        gcs.prove(tracks, gcs.TrackLimits(**limits))
    assert refused.value.hint


@pytest.mark.parametrize(
    "limits",
    [{"separation_m": 0.0}, {"speed_mps": np.nan}, {"height_m": (5.0, 5.0)}, {"vertical_scale": -1.0}],
)
def test_limits_that_are_none_are_refused(limits: dict[str, Any]) -> None:
    with pytest.raises(UsageError):
        gcs.TrackLimits(**limits)


@pytest.mark.parametrize(("c", "x"), [([[[np.nan] * 3]], [0, 1]), ([[[0.0] * 3]], [1, 0]), ([[[0.0] * 2]], [0, 1])])
def test_polynomials_that_are_none_are_refused(c: Any, x: Any) -> None:
    broken = PPoly.construct_fast(np.array(c, float), np.array(x, float))
    with pytest.raises(GcsError, match="track a"):
        gcs.PolynomialTrack("a", broken)


def test_what_is_not_decided_counts_as_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Vehicles that cross within a few intervals are not known to be apart after one look at the whole flight."""
    monkeypatch.setattr("gcs.mission.proving.track_report.CELLS_MAX", 0)
    tracks = [
        line("a", (0, 0, 0), (1, 0, 0), np.arange(11.0)),
        line("b", (3, -9.9, 0), (0, 2, 0), np.arange(11.0)),
    ]
    check = check_of(gcs.prove(tracks, gcs.TrackLimits(0.5)), "separation")
    assert check.verdict == "undecided"
    assert not check.ok
    assert "undecided, between" in str(check)
    monkeypatch.undo()
    assert check_of(gcs.prove(tracks, gcs.TrackLimits(0.5)), "separation").verdict == "proved"


def test_a_formation_that_flies_and_turns_together_takes_few_intervals(monkeypatch: pytest.MonkeyPatch) -> None:
    """What all do together is no part of their distances: 49 vehicles 2 m apart wind along at 20 m/s."""
    monkeypatch.setattr("gcs.mission.proving.track_report.CELLS_MAX", 30_000)
    rng = np.random.default_rng(3)
    t_s = np.arange(0.0, 60.0, 0.5)
    course_m = np.stack([200.0 * np.sin(0.1 * t_s), 200.0 * np.cos(0.1 * t_s), -20.0 + 3.0 * np.sin(t_s)], axis=1)
    grid_m = [np.array([2.0 * (row // 7), 2.0 * (row % 7), 0.0]) for row in range(49)]
    tracks = [
        gcs.PolynomialTrack(f"v{row}", through(t_s, course_m + place_m + rng.uniform(-0.1, 0.1, (len(t_s), 3))))
        for row, place_m in enumerate(grid_m)
    ]
    check = check_of(gcs.prove(tracks, gcs.TrackLimits(1.2)), "separation")
    assert check.verdict == "proved"
    assert check.proved > 1.5
