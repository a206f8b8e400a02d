"""The refinement of the mesh: which intervals drift, when a flight is good enough, and what the next round knows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.errors import PlanningError
from gcs.physics.quadrotor import hover_trim
from gcs.plan.formation.coordinates import coordinates
from gcs.plan.formation.shape import joined, rigid
from gcs.plan.nlp import mesh_refinement
from gcs.plan.nlp.ipopt import Solution
from gcs.plan.nlp.mesh import Mesh
from gcs.plan.nlp.mesh_refinement import (
    Warm,
    clearance_reserve_m,
    drifting_intervals,
    flown_shape,
    optimise,
    with_end,
    with_times,
)
from gcs.plan.nlp.violations import Violation
from gcs.plan.ocp.problem import Problem, Tightening, flight_problem
from gcs.plan.ocp.stage_functions import RowReach
from gcs.plan.trajectory.constraint_id import ConstraintId, Kind
from gcs.plan.trajectory.integration_windows import WindowErrors
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array
from tests.unit.plan.formations import SHRINK, TURN, auto, fleet
from tests.unit.plan.problems import alone, meadow
from tests.unit.plan.route_flights import CORNER, FAR, flight_through


def hovering(problem: Problem, joints_s: Array, extra_mps2: dict[int, float] | None = None) -> Trajectory:
    """At rest in the end state, with a thrust that accelerates it downwards over some of the intervals."""
    q, end, chains = problem.quadrotor, problem.end_state, len(problem.coordinates)
    state, control = (np.zeros((1, len(joints_s) - 1, size)) for size in (12 + 4 * chains, 4 + chains))
    state[0, :, :12], state[0, :, 12::4] = end, [c.rest for c in problem.coordinates]
    control[0, :, 0] = hover_trim(-float(end[2]), float(end[8]), q)[0]
    for interval, extra in (extra_mps2 or {}).items():
        control[0, interval, 0] -= extra * q.mass_kg
    return Trajectory(PPoly(state, joints_s), PPoly(control, joints_s))


@pytest.fixture(scope="module")
def problem(simulation1: Scenario) -> Problem:
    return flight_problem(meadow(alone(simulation1)))


EVEN = np.arange(0.0, 21.0, 2.0)


@pytest.mark.parametrize(
    ("joints_s", "fault", "intervals"),
    [
        # 1.2 mm/s2 from 8 to 10 s lead 5.8 and 7.2 mm away in the windows from 7 and 8 s, those around them by 4 mm.
        (EVEN, {4: 1.2e-3}, {3, 4, 5, 6}),
        (EVEN, {4: 0.8e-3}, set()),
        # Short intervals, up to half of the longest, are left alone.
        (np.sort(np.append(EVEN, [9.0, 11.01])), {4: 1.2e-3, 5: 1.2e-3}, {3, 6, 8}),
        # The last polynomial ends at rest: its error grows while the vehicle hovers on.
        (EVEN, {9: 1.2e-3}, {8, 9}),
    ],
)
def test_intervals_that_overlap_a_window_with_too_much_drift_are_halved(
    problem: Problem, joints_s: Array, fault: dict[int, float], intervals: set[int]
) -> None:
    found, words = drifting_intervals(problem, hovering(problem, joints_s, fault), problem.shape)
    assert found == intervals
    assert len(words) == bool(intervals)
    if intervals == {3, 4, 5, 6}:
        assert words[0].startswith("Eq. 1 drifts by 7.2 mm")
        assert words[0].endswith("in the 5 s from t = 8.0 s")


def test_after_an_end_in_motion_nobody_hovers(problem: Problem) -> None:
    """The same fault in the last interval counts up to the end only."""
    for column, value in ((3, 1.0), (9, 0.01), (6, 0.01)):
        end = problem.end_state.copy()
        end[column] = value
        moving = replace(problem, end_state=end)
        assert drifting_intervals(moving, hovering(problem, EVEN, {9: 1.2e-3}), problem.shape) == (set(), ())


@pytest.mark.parametrize("rests", [True, False])
def test_after_an_end_at_rest_it_hovers_for_a_window_more(
    simulation1: Scenario, problem: Problem, monkeypatch: pytest.MonkeyPatch, rests: bool
) -> None:
    """In a wind, at the yaw of its end."""
    flown = hovering(problem, EVEN)
    flown.state.c[0, :, 0], flown.control.c[0, :, :] = EVEN[:-1], 7.0  # a step north at each joint
    given: list[tuple[Array, Array, Array]] = []

    def errors(states: Any, controls: Any, joints_s: Array, *_: Any, **__: Any) -> WindowErrors:
        t_s = np.array([5.0, 19.9, 20.1, 24.0])
        given.append((states(t_s)[0, :, 0], controls(t_s)[0], joints_s))
        return WindowErrors(np.zeros(1), np.zeros((1, 1)))

    monkeypatch.setattr(mesh_refinement, "window_errors", errors)
    wind = {"wind": {"speed_mps": 2.0, "from_deg": 200.0, "shear": 0.3}}
    problem = flight_problem(meadow(alone(simulation1), **wind))
    end = problem.end_state.copy()
    end[8] = 0.5
    thrust, end[6], end[7] = hover_trim(5.0, 0.5, problem.quadrotor)
    end[4] += 0.0 if rests else 1.0
    assert drifting_intervals(replace(problem, end_state=end), flown, problem.shape) == (set(), ())
    ((north, controls, joints_s),) = given
    assert north.tolist() == [4.0, 18.0, 18.0, 18.0]
    np.testing.assert_array_equal(controls[:2], 7.0)
    np.testing.assert_allclose(controls[2:], [[thrust, 0.0, 0.0, 0.0]] * 2)
    assert joints_s.tolist() == [*EVEN, *([25.0] if rests else [])]


def test_the_outermost_vehicles_drift_where_they_move_apart(
    simulation1: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The farthest, the highest and the lowest, over windows that begin at the joints of the shape as well."""
    problem = flight_problem(fleet(simulation1, 5))
    places = np.array([[0, 0, 0], [1, 1, -3], [-9, 9, 0], [0, 1, 2], [1, 0, 0]], dtype=float)
    moving = np.stack([places, np.ones((5, 3))])
    moving[1, 4] = 9.0, 9.0, -9.0  # at the end the farthest, which does not count
    bend = np.zeros((2, 1, 2))
    bend[1, 0, 0], bend[0, 0, 1] = 1.0, 0.1
    shape = joined(
        [
            rigid(places, 0.0, 7.0),
            replace(problem.shape, functions=PPoly(bend, np.array([7.0, 30.0])), basis_ned_m=moving),
        ]
    )
    flown = hovering(problem, np.array([0.0, 6.0, 12.0, 18.0, 30.0]))
    calls: list[tuple[Array, Array, float]] = []

    def errors(states: Any, controls: Any, joints_s: Array, *_: Any, step_s: float) -> WindowErrors:
        calls.append((states(np.array([10.0]))[:, 0, :3], joints_s, step_s))
        assert controls(np.array([10.0])).shape == (*states(np.array([10.0])).shape[:2], 4)
        return WindowErrors(np.array([20.0]), np.array([[1e-3], [0.0], [8e-3]][: 1 if len(calls) == 1 else 3]))

    monkeypatch.setattr(mesh_refinement, "window_errors", errors)
    intervals, (words,) = drifting_intervals(problem, flown, shape, quick=True)
    assert intervals == {3}
    assert "8.0 mm in the 5 s from t = 20.0 s" in words
    np.testing.assert_allclose(calls[0][0], [flown.state(10.0)[:3]])
    np.testing.assert_allclose(calls[1][0] - flown.state(10.0)[:3], places[[1, 2, 3]] + 0.3)
    assert {7.0, 6.0, 30.0} <= set(calls[1][1].tolist())
    assert calls[0][2] == calls[1][2] == 0.1
    assert drifting_intervals(problem, flown, problem.shape) == (set(), ())  # rigid: the leader stands for all
    assert len(calls) == 3
    assert calls[2][2] == 0.05


def test_another_end_keeps_the_shares_of_points_and_tightenings(simulation1: Scenario) -> None:
    problem = flight_problem(flight_through(simulation1, CORNER, FAR))
    problem = replace(
        problem, start_s=10.0, end_s=60.0, point_s=(20.0, 40.0), tightenings=(Tightening(3, 15.0, 35.0, 0.5),)
    )
    problem = replace(problem, shape=rigid(problem.shape.at(0.0), 10.0, 60.0))
    later = with_end(problem, 85.0)  # half as long again, from 10 s on
    assert later.point_s == pytest.approx((25.0, 55.0))
    assert later.tightenings == (Tightening(3, 17.5, 47.5, 0.5),)
    assert (later.start_s, later.end_s, later.shape.start_s, later.shape.end_s) == (10.0, 85.0, 10.0, 85.0)
    assert with_end(problem, 60.0) is problem


def test_changes_at_points_begin_when_the_leader_is_there(simulation1: Scenario) -> None:
    tables: dict[str, Any] = {"vehicles": 3, "formation": {"change": [{**SHRINK, "at_point": 1, "scale": 1.5}]}}
    problem = flight_problem(flight_through(simulation1, CORNER, FAR, **tables))
    timed = with_times(problem, 70.0, (21.0, 44.0))
    assert (timed.end_s, timed.point_s) == (70.0, (21.0, 44.0))
    ((start_s, _),) = timed.shape.moving_s
    assert start_s == pytest.approx(21.0)
    # No room is left for the change: its shape stays as it was, in less time.
    short = with_times(timed, 7.0, (2.0, 3.0))
    assert short.point_s == (2.0, 3.0)
    assert short.shape.moving_s[0][0] == pytest.approx(2.1)
    plain = flight_problem(flight_through(simulation1, CORNER, FAR))
    assert with_times(plain, 70.0, (21.0, 44.0)).point_s == (21.0, 44.0)
    whole = flight_problem(meadow(alone(simulation1)))
    assert with_times(whole, 25.0, ()).end_s == 25.0


def test_the_clearance_at_the_nodes_is_more_where_the_ends_leave_room(simulation1: Scenario) -> None:
    """Over level ground: what the lower of both ends leaves, in fifths, counted for the lowest vehicle."""
    for start_m, end_m, share in (
        *((3.0, 5.0, 1.0), (0.5255, 5.0, 0.8), (0.5225, 5.0, 0.6), (5.0, 0.5225, 0.6)),
        *((0.5155, 5.0, 0.4), (0.5075, 5.0, 0.2), (0.505, 5.0, 0.0)),
    ):
        scenario = meadow(
            alone(simulation1),
            start={"position_m": [2.0, 1.0, start_m]},
            end={"position_m": [40.0, 14.0, end_m]},
            limits={"clearance_min_m": 0.5},
        )
        assert clearance_reserve_m(flight_problem(scenario)) == pytest.approx(0.03 * share)
    assert clearance_reserve_m(flight_problem(scenario), 0.0) == 0.0
    three = [v.model_dump() for v in simulation1.formation.vehicle[:3]]
    places = [list(vehicle["position_m"]) for vehicle in three]
    places[1][2] -= 2.4875
    scenario = meadow(
        simulation1,
        formation={"vehicle": [{**v, "position_m": p} for v, p in zip(three, places, strict=True)]},
        limits={"clearance_min_m": 0.5},
    )
    assert clearance_reserve_m(flight_problem(scenario)) == pytest.approx(0.012)  # 12.5 mm are left


def test_the_reserve_is_that_over_the_ground_below_each_end_in_the_shape_it_has_there(simulation1: Scenario) -> None:
    """A steep ridge 3.985 m high under one of the ends; the start is at 3 m, the end at 5 m, and 1 m is asked."""
    problem = flight_problem(fleet(simulation1, 3, end={"position_m": [40.0, 14.0, 5.0]}))
    level = replace(problem, shape=rigid(np.zeros((3, 3)), 0.0, 30.0))
    aside = np.array([[0.0, 0.0, 0.0], [20.0, 30.0, 0.0], [0.0, 0.0, 0.0]])
    later = PPoly(np.array([[[1.0, 0.0], [0.0, 1.0]]]), np.array([0.0, 15.0, 30.0]))
    shape = replace(level.shape, functions=later, basis_ned_m=np.stack([0.0 * aside, aside]))
    at_end, at_none, at_start = ((60.0, 44.0), (40.0, 14.0)), ((22.0, 31.0), (44.0, 60.0)), ((2.0, 1.0),)
    cases = [(place, share) for places, share in ((at_end, 0.4), (at_none, 1.0), (at_start, 0.0)) for place in places]
    for (north_m, east_m), share in cases:
        hill = {"north_m": [north_m], "east_m": [east_m], "height_m": [3.985], "spread_north_m": [90.0]}
        terrain = {"ripple": None, "mountains": {**hill, "spread_east_m": [0.2]}}
        scenario = fleet(simulation1, 3, end={"position_m": [40.0, 14.0, 5.0]}, terrain=terrain)
        given = replace(level, scenario=scenario, shape=shape)
        assert clearance_reserve_m(given) == pytest.approx(0.03 * share), (north_m, east_m)


def test_the_flown_shape_has_the_coordinates_of_the_solution(simulation1: Scenario) -> None:
    problem = flight_problem(fleet(simulation1, 5, "row", (auto(SHRINK), auto(TURN))))
    names = [c.name for c in coordinates(problem.scenario)]
    flown = hovering(problem, np.array([0.0, 30.0]))
    flown.state.c[0, 0, [12 + 4 * names.index("scale"), 12 + 4 * names.index("heading")]] = 0.8, np.pi / 2.0
    row = problem.shape.at(0.0)
    expected = 0.8 * np.stack([-row[:, 1], row[:, 0], row[:, 2]], axis=1)
    np.testing.assert_allclose(flown_shape(problem, flown).at(12.0), expected, atol=1e-9)
    rigid_problem = replace(problem, coordinates=())
    assert flown_shape(rigid_problem, flown.vehicle) is problem.shape


@dataclass
class Rounds:
    """Stands for the program, its solver and the check between the nodes: what each round was given, and finds."""

    found: list[tuple[Violation, ...]]
    drifts: list[set[int]]
    stretches: list[float]
    problems: list[Problem]
    meshes: list[Mesh]
    solved: list[tuple[Solution | None, bool]]

    @property
    def layout(self) -> Rounds:
        return self

    size = 77

    def transcribe(self, problem: Problem, mesh: Mesh, _: Trajectory, *, reach: RowReach) -> Rounds:
        self.problems.append(problem)
        self.meshes.append(mesh)
        return self

    def scaled(self, _: Trajectory) -> Array:
        return np.zeros(1)

    def solve(self, _: Rounds, __: Array, before: Solution | None, *, near: bool, most: int | None) -> Solution:
        self.solved.append((before, near))
        return Solution(np.zeros(1), np.zeros(1), {("limit", 1.0): 2.0}, 5.0 - len(self.solved), 10, 0.5)

    def mesh(self, _: Array) -> Mesh:
        mesh = self.meshes[-1]
        by = self.stretches[len(self.meshes) - 1] if len(self.meshes) <= len(self.stretches) else 1.0
        return mesh.stretched(np.full(mesh.leg_count, by))

    def trajectory(self, _: Array) -> Trajectory:
        return hovering(self.problems[-1], self.mesh(_).joints_s)

    def find_violations(self, *_: Any) -> tuple[Violation, ...]:
        number = len(self.meshes) - 1
        return self.found[number] if number < len(self.found) else ()

    def drifting_intervals(self, *_: Any) -> tuple[set[int], tuple[str, ...]]:
        number = len(self.meshes) - 1
        drift = self.drifts[number] if number < len(self.drifts) else set()
        return drift, ("it drifts",) if drift else ()


@pytest.fixture
def rounds(monkeypatch: pytest.MonkeyPatch) -> Rounds:
    made = Rounds([], [], [], [], [], [])
    for name in ("transcribe", "solve", "find_violations", "drifting_intervals"):
        monkeypatch.setattr(mesh_refinement, name, getattr(made, name))
    monkeypatch.setattr(mesh_refinement, "_with_reserve", lambda program, _: program)
    return made


def miss(kind: Kind, t_s: float, by: float, tolerated: float = 9.0, **keys: Any) -> Violation:
    return Violation(ConstraintId(kind), "m", t_s, by, 0.1, tolerated, (t_s - 0.5, t_s + 1.5), beyond_leader=by, **keys)


def test_a_flight_without_violations_is_solved_once(problem: Problem, rounds: Rounds) -> None:
    seen: list[Any] = []
    best = optimise(problem, hovering(problem, EVEN), seen.append)
    assert len(rounds.meshes) == len(best.history) == 1
    (made,) = seen
    assert made == best.history[0]
    assert (made.unknowns, made.watched, made.iterations, made.objective, made.complaints) == (77, 0, 10, 4.0, ())
    assert made.intervals == rounds.meshes[0].intervals
    assert (best.objective, best.last, best.point_s) == (4.0, None, ())
    assert rounds.solved == [(None, True)]  # a route is near a flight
    assert rounds.problems[0].clearance_reserve_m == pytest.approx(0.03)
    assert np.diff(rounds.meshes[0].joints_s)[[0, -1]] == pytest.approx(1.0)
    assert set(rounds.meshes[0].degrees) == {5}


def test_each_round_knows_what_the_rounds_before_it_missed(problem: Problem, rounds: Rounds) -> None:
    rounds.found = [
        (miss(Kind.ACCELERATION, 5.0, 0.1), miss(Kind.JERK, 6.0, 0.2), miss(Kind.PITCH, 5.0, 0.02)),
        (miss(Kind.ACCELERATION, 7.0, 0.3), miss(Kind.JERK, 6.0, 0.1)),
    ]
    rounds.drifts = [{1}]
    best = optimise(problem, hovering(problem, EVEN), near=True)
    first, second, third = rounds.problems
    assert (first.tightenings, first.accel_reserve_mps2, first.jerk_reserve_mps3) == ((), 0.0, 0.0)
    assert [t.column for t in second.tightenings] == [t.column for t in third.tightenings] == [7]
    assert second.accel_reserve_mps2 == pytest.approx(0.12)
    assert third.accel_reserve_mps2 == pytest.approx(0.48)
    assert second.jerk_reserve_mps3 == pytest.approx(0.24)
    assert third.jerk_reserve_mps3 == pytest.approx(0.36)
    assert {5.0, 6.0} < set(rounds.meshes[1].extra_s.tolist()) < set(rounds.meshes[2].extra_s.tolist())
    assert {5.0, 6.0, 7.0} < set(rounds.meshes[2].extra_s.tolist())
    assert [m.intervals - rounds.meshes[0].intervals for m in rounds.meshes] == [0, 1, 1]
    assert [before is None for before, _ in rounds.solved] == [True, False, False]
    assert [near for _, near in rounds.solved] == [True, False, False]
    assert [made.watched for made in best.history] == [len(mesh.extra_s) for mesh in rounds.meshes]
    assert "it drifts" in best.history[0].complaints


def test_a_violation_that_is_tolerated_and_a_small_move_of_the_end_are_good_enough(
    problem: Problem, rounds: Rounds
) -> None:
    rounds.found = [(miss(Kind.HEIGHT, 5.0, 1e-4, 0.9),)]
    rounds.stretches = [1.009]
    best = optimise(problem, hovering(problem, EVEN))
    assert len(best.history) == 1
    assert best.trajectory.end_s == pytest.approx(20.18)


def test_where_the_end_has_moved_far_it_is_solved_again(problem: Problem, rounds: Rounds) -> None:
    rounds.stretches = [1.011]
    best = optimise(problem, hovering(problem, EVEN))
    assert len(best.history) == 2
    before, _ = rounds.solved[1]
    assert before is not None
    assert list(before.g_multipliers) == [("limit", 1.0)]  # rows of one leg keep their times
    assert rounds.problems[1].end_s == pytest.approx(20.22)
    assert rounds.meshes[1].joints_s[-1] == pytest.approx(20.22)


@pytest.mark.parametrize("frame", ["inertial", "course"])
def test_coordinates_of_the_shape_have_shorter_intervals(simulation1: Scenario, rounds: Rounds, frame: str) -> None:
    tables: dict[str, Any] = {"time": {"flight_s": 60.0}, "formation": {"frame": frame}}
    problem = flight_problem(fleet(simulation1, 3, "row", (auto(SHRINK),), **tables))
    optimise(problem, hovering(problem, EVEN))
    assert np.diff(rounds.meshes[0].joints_s).max() <= 6.0
    assert rounds.solved[0] == (None, False)  # a guess of these is not near a flight


def test_a_flight_of_legs_is_warm_the_next_time(simulation1: Scenario, rounds: Rounds) -> None:
    problem = flight_problem(flight_through(simulation1, CORNER, FAR))
    problem = replace(problem, point_s=(20.0, 40.0))
    rounds.stretches = [1.02]
    best = optimise(problem, hovering(problem, EVEN))
    assert best.point_s == pytest.approx((20.4, 40.8))
    assert best.last is not None
    assert best.last.mesh.joints_s[-1] == pytest.approx(61.2)
    (before, _), (second, _) = rounds.solved
    assert before is None
    assert second is not None
    assert list(second.g_multipliers) == [("limit", pytest.approx(1.02))]  # moved with its leg
    again = optimise(problem, hovering(problem, EVEN), warm=Warm(best.last.mesh, best.last.solution), near=True)
    assert len(again.history) == 1
    assert rounds.meshes[-1] is best.last.mesh
    assert rounds.solved[-1] == (best.last.solution, False)


def test_a_flight_that_never_gets_better_is_given_up_with_its_leg(simulation1: Scenario, rounds: Rounds) -> None:
    problem = flight_problem(flight_through(simulation1, CORNER, FAR))
    problem = replace(problem, point_s=(20.0, 40.0))
    rounds.found = [(miss(Kind.HEIGHT, 5.0, 0.1, 2.0), miss(Kind.ROLL, 30.0, 0.1, 3.0))] * 20
    with pytest.raises(PlanningError, match=r"height violated by .*roll violated by .*, in leg 2 \(point 1") as caught:
        optimise(problem, hovering(problem, EVEN))
    assert "8 refinements" in str(caught.value)
    assert len(rounds.meshes) == 8
    rounds.found, rounds.drifts = [], [{0}] * 20
    rounds.meshes.clear()
    with pytest.raises(PlanningError, match=r"were not enough: it drifts$"):
        optimise(flight_problem(meadow(alone(simulation1))), hovering(problem, EVEN))
