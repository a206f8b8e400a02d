"""Places and heading of formations that bend: margins worked by hand, bounds at every instant, shapes without a fit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly

from gcs.plan.formation.coordinates import CoordinateName, composed
from gcs.plan.formation.shape import Shape, rigid
from gcs.plan.formation.timeline import lay
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.plan.verification.constraints import bent_formation
from gcs.plan.verification.constraints.allowed_shapes import AllowedShapes
from gcs.plan.verification.constraints.bent_formation import BentFormation
from gcs.plan.verification.constraints.scheduled_shape import stretches
from gcs.plan.verification.proof.subdivision import Proof, prove
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import offsets_ned_m
from gcs.types import Array
from tests.unit.plan.formations import COURSE, SHAPES, SHRINK, TO_FILE, TO_ROW, TURN, Planned, at, auto, fleet
from tests.unit.plan.problems import changed

END_S = 8.0
WIDE = auto({**TURN, "angle_deg": 120.0})


def family(plan: Plan) -> BentFormation:
    allowed = AllowedShapes.of(plan.scenario)
    assert allowed is not None
    names = [phase.name for phase in plan.phases]
    return BentFormation(plan, stretches(plan), allowed, names.index("mission"))


def proof(plan: Plan, end_s: float = END_S) -> Proof:
    """Of the first seconds of the mission, from intervals between the joints and the ends of changes."""
    law = family(plan)
    edges = np.concatenate([[0.0], plan.joints_s, [t for part in law.parts for t in (part.start_s, part.end_s)]])
    edges = np.unique(np.append(edges[(edges >= 0.0) & (edges <= end_s)], end_s))
    cells = law.cells(edges[:-1], edges[1:], np.full(len(edges) - 1, law.mission))
    with np.errstate(invalid="ignore"):  # as `verify` does: what has no bounds is not proved
        return prove(law, cells, len(plan.phases))


def still(planned: Planned, scenario: Scenario, offsets: Array) -> Plan:
    """A rigid shape (V, 3), whether it is allowed or not, along the track of another plan."""
    plan, _ = planned("turn")
    return replace(plan, scenario=scenario, shape=rigid(offsets, plan.t_start_s, plan.t_end_s), moves=())


def turned(offsets: Array, angle_deg: float) -> Array:
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return offsets @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def led(plan: Plan, state: Array, joints_s: Array) -> Plan:
    """The plan with another motion of its leader: state (C+1, P, 12), highest power first."""
    control = PPoly(np.zeros((len(state), len(joints_s) - 1, 4)), joints_s)
    return replace(plan, leader_trajectory=Trajectory(PPoly(state, joints_s), control))


CROSS = ({"name": "cross", "offsets_m": [[0, 0, 0], [4, 0, 1], [-4, 0, 1], [0, 4, 1], [0, -4, 1]]},)


@pytest.mark.parametrize(
    ("changes", "scale", "turn_deg", "margin_m"),
    [
        ((auto(SHRINK),), 0.7, 0.0, 0.0),
        ((auto(SHRINK),), 0.489, 0.0, -0.01 * np.sqrt(17.0)),  # 0.5, and 0.1 % beyond
        ((auto(SHRINK),), 1.046, 0.0, -0.02 * np.sqrt(17.0)),  # 5 % of its range beyond 1
        ((auto({**TURN, "angle_deg": 30.0}),), 1.0, -30.0, 0.0),
        ((auto({**TURN, "angle_deg": 30.0}),), 1.0, 31.03, -8.0 * np.sin(np.radians(0.5))),  # 1 degree beyond
        ((auto(TURN),), 1.01, 45.0, -0.01 * np.sqrt(17.0)),
    ],
)
def test_margins_worked_by_hand(
    planned: Planned,
    simulation1: Scenario,
    changes: tuple[dict[str, Any], ...],
    scale: float,
    turn_deg: float,
    margin_m: float,
) -> None:
    scenario = fleet(simulation1, 5, "cross", changes, CROSS)
    found = proof(still(planned, scenario, scale * turned(offsets_ned_m(scenario), turn_deg)))
    mission = np.isfinite(found.seen[0]).nonzero()[0]
    assert found.seen[0, mission] == pytest.approx(margin_m, abs=1e-7)
    assert margin_m - max(3e-4, 0.03 * abs(margin_m)) <= found.proved[0, mission[0]] <= margin_m + 1e-7


def moving(
    planned: Planned, scenario: Scenario, names: tuple[CoordinateName, ...], values: Array, base: Shape | None = None
) -> Plan:
    """A plan whose coordinates (C+1, A), highest power of t first, move as long as the base shape is laid out."""
    plan, _ = planned("turn")
    allowed = AllowedShapes.of(scenario)
    assert allowed is not None
    base = rigid(offsets_ned_m(scenario), 0.0, END_S) if base is None else base
    coordinates = PPoly(values[:, None], np.array([base.start_s, base.end_s]))
    shape = composed(base, allowed.target_ned_m, names, coordinates)
    return replace(plan, scenario=scenario, shape=shape, moves=())


# Coordinates at 0 s, and their rates: within their ranges until END_S.
FREE = np.array([[-0.05, 0.2, 0.11], [1.0, -0.6, 0.05]])
EVERY = tuple(CoordinateName)
ALL = (auto(SHRINK), WIDE, auto(TO_FILE))


@pytest.mark.parametrize("begin", ["row", "wedge"])  # a file is a row that has turned: there, parts are ambiguous
@pytest.mark.parametrize("chosen", [(0,), (1,), (2,), (0, 1), (0, 2), (1, 2), (0, 1, 2)])
def test_every_allowed_motion_is_proved(
    planned: Planned, simulation1: Scenario, begin: str, chosen: tuple[int, ...]
) -> None:
    scenario = fleet(simulation1, 5, begin, tuple(ALL[i] for i in chosen))
    plan = moving(planned, scenario, tuple(EVERY[i] for i in chosen), FREE[:, list(chosen)])
    found = proof(plan)
    mission = np.flatnonzero(np.isfinite(found.seen[0]))
    assert found.proved[0, mission] >= -0.8e-3
    assert found.seen[0, mission] >= -1e-6


TILTED = {"kind": "rotate", "angle_deg": 50.0, "axis": [1.0, 0.5, 2.0]}
GROW, ACROSS = {**SHRINK, "scale": 1.4}, {"kind": "reshape", "to": "swapped", "assignment": "fixed"}


@pytest.mark.parametrize(
    "schedule", [(TURN,), (TILTED,), (GROW, TO_ROW), (ACROSS,)], ids=["turn", "tilted turn", "grow, reshape", "lanes"]
)
@pytest.mark.parametrize("chosen", [(0,), (0, 1, 2)])
def test_scheduled_changes_that_bend_are_proved_and_late_ones_are_not(
    planned: Planned, simulation1: Scenario, schedule: tuple[dict[str, Any], ...], chosen: tuple[int, ...]
) -> None:
    """The timeline's shape, bent; then the same shape half a second later than its moves say."""
    shapes = (*SHAPES, {"name": "swapped", "offsets_m": [[0, 0, 0], [-3, -3, 0], [-3, 3, 0]]})
    changes = (*(at(change, 1.0 + 40.0 * i) for i, change in enumerate(schedule)), *(ALL[i] for i in chosen))
    scenario = fleet(simulation1, 3, "wedge", changes, shapes, time={"flight_s": 90.0})
    timeline = lay(scenario, tuple(1.0 + 40.0 * i for i in range(len(schedule))), 0.0, 90.0)
    values = FREE[:, list(chosen)] * np.array([[0.08], [1.0]])
    plan = moving(planned, scenario, tuple(EVERY[i] for i in chosen), values, timeline.shape)
    plan = replace(plan, moves=timeline.moves)
    found = proof(plan, 90.0)
    mission = np.flatnonzero(np.isfinite(found.seen[0]))
    assert found.proved[0, mission] >= -0.8e-3
    if len(chosen) > 1:
        return  # other coordinates make up for what is late
    late = tuple(replace(move, start_s=move.start_s - 0.5, end_s=move.end_s - 0.5) for move in timeline.moves)
    assert proof(replace(plan, moves=late), 90.0).seen[0, mission] < -0.8e-3


def test_many_intervals_are_bounded_as_few_are(
    planned: Planned, simulation1: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So many at once as there is memory for: the result does not depend on it."""
    plan = moving(planned, fleet(simulation1, 5, "wedge", ALL), EVERY, FREE)
    law, joints = family(plan), plan.shape.joints_s
    cells = law.cells(joints[:-1], joints[1:], np.full(len(joints) - 1, law.mission))
    whole = law.bounds(cells)
    monkeypatch.setattr(bent_formation, "_TOGETHER", 5)
    assert len(cells) > 2
    np.testing.assert_allclose(law.bounds(cells), whole, atol=1e-12)


def test_bounds_are_no_more_than_the_margin_at_any_instant(planned: Planned, simulation1: Scenario) -> None:
    """A shape that is out of its ranges, in a scenario that allows little: intervals of all lengths."""
    scenario = fleet(simulation1, 5, "wedge", (auto({**SHRINK, "scale": 0.9}), auto({**TURN, "angle_deg": 20.0})))
    plan = moving(planned, scenario, EVERY[:2], FREE[:, :2])
    law, random = family(plan), np.random.default_rng(6)
    joints = plan.shape.joints_s
    start = random.uniform(0.0, END_S, 40)
    end = np.minimum(start + 10.0 ** random.uniform(-3.0, 0.3, 40), joints[np.searchsorted(joints, start)])
    low, seen = law.bounds(law.cells(start, end, np.full(40, law.mission)))
    assert (low <= seen + 1e-12).all()
    for number in range(40):
        times = np.linspace(start[number], end[number], 60)
        margin = law.bounds(law.cells(times - 1e-7, times + 1e-7, np.full(60, law.mission)))[1][0]
        assert low[0, number] <= margin.min() + 1e-5


@pytest.mark.parametrize(
    ("speed_mps", "scale", "applies"), [(1.5, 1.0, True), (0.9, 1.0, False), (1.5, 1.02, True), (1.5, 0.9, True)]
)
def test_the_heading_worked_by_hand(
    planned: Planned, simulation1: Scenario, speed_mps: float, scale: float, applies: bool
) -> None:
    """The shape has turned by 30 degrees, the leader flies towards 33: of 5 degrees, 2 are left, whatever its scale."""
    scenario = changed(fleet(simulation1, 5, formation=COURSE), start={"velocity_mps": [0.0, 0.0, 0.0]})
    facing = scenario.start.roll_pitch_yaw_deg[2]
    plan = still(planned, scenario, scale * turned(offsets_ned_m(scenario), 30.0))
    course = np.radians(facing + 33.0)
    assert family(plan).constraints[1].tolerance == pytest.approx(0.05), "1 % of 5 degrees"
    state = np.zeros((2, 1, 12))
    state[1, 0, 3:5] = speed_mps * np.cos(course), speed_mps * np.sin(course)
    found = proof(led(plan, state, np.array([plan.t_start_s, plan.t_end_s])))
    margins = found.seen[1][np.isfinite(found.seen[1])]
    assert len(margins) == applies
    if applies:
        assert margins[0] == pytest.approx(2.0, abs=1e-9)
        assert 1.94 < found.proved[1][np.isfinite(found.seen[1])][0] <= 2.0


def test_a_speed_that_passes_the_threshold_is_judged_above_it_only(planned: Planned, simulation1: Scenario) -> None:
    """The leader flies aside at first, straight on at 1 m/s after 4 s, and 2.9 degrees aside at 2 m/s after 8 s."""
    scenario = changed(fleet(simulation1, 5, formation=COURSE), start={"velocity_mps": [0.0, 0.0, 0.0]})
    facing = np.radians(scenario.start.roll_pitch_yaw_deg[2])
    plan = still(planned, scenario, offsets_ned_m(scenario))
    ahead, aside = np.array([np.cos(facing), np.sin(facing)]), np.array([-np.sin(facing), np.cos(facing)])
    edges = np.array([0.0, END_S, plan.t_end_s])
    state = np.zeros((2, 2, 12))
    state[:, 0, 3:5] = [0.25 * ahead - 0.025 * aside, 0.1 * aside]
    state[1, 1, 3:5] = 2.0 * ahead - 0.1 * aside
    found = proof(led(plan, state, edges))
    chosen = np.isfinite(found.seen[1])
    proved, seen = found.proved[1][chosen][0], found.seen[1][chosen][0]
    assert proved <= 5.0 - np.degrees(np.arctan(0.1 / 2.0)) + 1e-9 <= seen + 2e-9
    assert seen - proved < 0.06


def test_the_vehicle_that_is_off_is_named(planned: Planned) -> None:
    plan, _ = planned("auto shrink")
    tables = np.concatenate([plan.shape.basis_ned_m, np.zeros((1, 5, 3))])
    tables[-1, 3, 2] = 0.02
    functions = np.pad(plan.shape.functions.c, ((0, 0), (0, 0), (0, 1)))
    functions[-1, :, -1] = 1.0
    off = replace(plan, shape=Shape(PPoly(functions, plan.shape.joints_s), tables))
    failures = [check for check in verify(off).failures if check.name == "place in formation"]
    assert {check.sysid for check in failures} == {plan.sysids[3]}
    assert all(check.worst == pytest.approx(-0.02, rel=1e-3) for check in failures)


@pytest.mark.parametrize(
    "name",
    [
        "auto shrink",
        *(
            pytest.param(n, marks=pytest.mark.slow)
            for n in ("auto turn", "auto reshape", "course", "course and schedule")
        ),
    ],
)
def test_of_valid_plans_nothing_is_only_sampled(planned: Planned, name: str) -> None:
    _, report = planned(name)
    assert report.sampled == ()
    assert {check.verdict for check in report.checks} == {"proved"}
