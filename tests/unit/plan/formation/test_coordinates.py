"""Scale, heading and blend bend a shape as the closed form says, to the snap, and never ask more than they may."""

from __future__ import annotations

import itertools
import math
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import PPoly, make_interp_spline

from gcs.errors import Infeasible
from gcs.plan.formation.coordinates import (
    Coordinate,
    CoordinateName,
    bent,
    budget_of_each,
    composed,
    coordinates,
    target_ned_m,
)
from gcs.plan.formation.shape import Shape, joined, rigid, stretched
from gcs.plan.formation.time_scaling import Budget, budget
from gcs.plan.formation.timeline import lay
from gcs.plan.formation.transforms import rotation, straight
from gcs.plan.search.shape_schedule import automatic_moves
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import offsets_ned_m, shape_offsets_ned_m
from gcs.types import Array
from tests.unit.plan.formations import SHRINK, TO_FILE, TO_ROW, TURN, at, auto, fleet

NAMES = tuple(CoordinateName)
SOME = [chosen for count in (1, 2, 3) for chosen in itertools.combinations(NAMES, count)]
BASE = np.concatenate([np.zeros((1, 3)), np.random.default_rng(1).normal(size=(6, 3)) * 8.0])
TARGET = np.concatenate([np.zeros((1, 3)), np.random.default_rng(2).normal(size=(6, 3)) * 8.0])
JOINTS = np.array([0.0, 1.0, 2.5, 6.0, 12.0, 18.0, 20.0])
AUTOS: dict[str, dict[str, Any]] = {
    "scale": auto({**SHRINK, "scale": 0.4}),
    "heading": auto({**TURN, "angle_deg": 120.0}),
    "blend": auto(TO_FILE),
}


def smooth(random: np.random.Generator, names: tuple[CoordinateName, ...]) -> PPoly:
    """Slow waves as quintics that meet to the fourth derivative; headings go from side to side by 170 degrees."""
    points = np.linspace(JOINTS[0], JOINTS[-1], 17)
    rest = {"scale": 0.8, "heading": 0.0, "blend": 0.5}
    size = {"scale": 0.2, "heading": 1.5, "blend": 0.3}
    waves = 2.0 * np.pi * (points[:, None] / random.uniform(16.0, 30.0, len(names)) + random.uniform(size=len(names)))
    return quintics(points, [rest[name] for name in names] + [size[name] for name in names] * np.sin(waves))


def quintics(points: Array, values: Array) -> PPoly:
    """Through values (N, A) at points (N,), meeting to the fourth derivative."""
    spline = make_interp_spline(points, values, k=5)
    joints = np.unique(spline.t)
    series = [spline.derivative(n)(joints[:-1]) / math.factorial(n) if n else spline(joints[:-1]) for n in range(6)]
    return PPoly(np.stack(series[::-1]), joints)


def product(a: Array, b: Array) -> Array:
    """Of two Taylor series (5, ...)."""
    return np.stack([sum(a[i] * b[n - i] for i in range(n + 1)) for n in range(5)])


def turned(heading: Array) -> Array:
    """Taylor series of exp(i heading): e' = i heading' e."""
    e = np.zeros(heading.shape, dtype=complex)
    e[0] = np.exp(1j * heading[0])
    for n in range(1, 5):
        e[n] = sum(1j * k * heading[k] * e[n - k] for k in range(1, n + 1)) / n
    return e


def closed_form(base: Shape, names: tuple[CoordinateName, ...], values: PPoly, t: Array) -> Array:
    """s Rz(theta) ((1 - b) base + b target) and its first four derivatives (5, V, N, 3), series by series."""
    factorial = np.array([math.factorial(n) for n in range(5)])[:, None]
    series = {name: np.stack([values(t, nu=n)[:, i] for n in range(5)]) / factorial for i, name in enumerate(names)}
    zero = np.zeros((5, len(t)))
    blend, heading = series.get("blend", zero), series.get("heading", zero)
    one = zero.copy()
    one[0] = 1.0
    scale = series.get("scale", one)
    own = np.stack([base.offsets(t, n) for n in range(5)]) / factorial[..., None, None]
    goal = np.zeros_like(own)
    goal[0] = TARGET[:, None]
    mixed = product((one - blend)[:, None, :, None], own) + product(blend[:, None, :, None], goal)
    mixed = product(scale[:, None, :, None], mixed)
    flat = product(turned(heading)[:, None], mixed[..., 0] + 1j * mixed[..., 1])
    return np.stack([flat.real, flat.imag, mixed[..., 2]], axis=-1) * factorial[..., None, None]


def scheduled() -> Shape:
    """Rigid, flown straight elsewhere, rigid, turned, rigid: joints where the coordinates have none."""
    goal = BASE[::-1] - BASE[-1]
    turn = rotation(goal, np.array([1.0, 0.0, 2.0]), 1.0)
    return joined(
        [
            rigid(BASE, 0.0, 3.3),
            stretched(straight(BASE, goal), 3.3, 8.0),
            rigid(goal, 8.0, 9.1),
            stretched(turn, 9.1, 15.0),
            rigid(turn.at(1.0), 15.0, 20.0),
        ]
    )


@pytest.mark.parametrize("names", SOME, ids="+".join)
def test_a_composed_shape_is_the_closed_form_to_its_snap(names: tuple[CoordinateName, ...]) -> None:
    for seed, base in enumerate((rigid(BASE, 0.0, 20.0), scheduled())):
        values = smooth(np.random.default_rng(seed), names)
        shape = composed(base, TARGET, names, values)
        assert (shape.start_s, shape.end_s) == (0.0, 20.0)
        # Not at the middles and ends of anything.
        t = np.linspace(0.003, 19.997, 701)
        exact = closed_form(base, names, values, t)
        for order, tolerance in enumerate((1e-8, 1e-7, 1e-6, 1e-5, 1e-4)):
            np.testing.assert_allclose(shape.offsets(t, order), exact[order], atol=tolerance)


@pytest.mark.parametrize("names", SOME, ids="+".join)
def test_a_composed_shape_goes_on_at_its_joints_to_the_jerk(names: tuple[CoordinateName, ...]) -> None:
    shape = composed(scheduled(), TARGET, names, smooth(np.random.default_rng(7), names))
    joints = shape.joints_s[1:-1]
    for order, tolerance in enumerate((1e-8, 1e-7, 1e-6, 1e-5)):
        left = shape.offsets(np.nextafter(joints, 0.0), order)
        np.testing.assert_allclose(shape.offsets(joints, order), left, atol=tolerance)


def test_the_leader_stays_where_he_is() -> None:
    shape = composed(scheduled(), TARGET, NAMES, smooth(np.random.default_rng(3), NAMES))
    t = np.linspace(0.0, 20.0, 50)
    mine = BASE.copy()
    mine[0] = 0.0
    for order in range(3):
        found = composed(rigid(mine, 0.0, 20.0), TARGET, NAMES, smooth(np.random.default_rng(3), NAMES))
        np.testing.assert_array_equal(found.offsets(t, order)[0], 0.0)
    assert shape.offsets(t).shape == (7, 50, 3)


def test_at_rest_nothing_is_bent() -> None:
    still = PPoly(np.array([1.0, 0.0, 0.0])[None, None].repeat(len(JOINTS) - 1, axis=1), JOINTS)
    shape = composed(scheduled(), TARGET, NAMES, still)
    t = np.linspace(0.0, 20.0, 211)
    np.testing.assert_allclose(shape.offsets(t), scheduled().offsets(t), atol=1e-11)


def test_arrays_and_symbols_are_bent_alike() -> None:
    values = {"scale": 0.7, "heading": -2.1, "blend": 0.3}
    for names in SOME:
        chosen = {name: values[name] for name in names}
        symbols = {name: ca.SX.sym(name) for name in names}
        made = ca.Function("bent", list(symbols.values()), bent(symbols, list(BASE[3]), list(TARGET[3]), ca))
        found = np.array([float(part) for part in made(*chosen.values())])
        s, h, b = (chosen.get(name, rest) for name, rest in (("scale", 1.0), ("heading", 0.0), ("blend", 0.0)))
        north, east, down = s * ((1.0 - b) * BASE[3] + b * TARGET[3])
        exact = [
            np.cos(h) * north - np.sin(h) * east,
            np.sin(h) * north + np.cos(h) * east,
            down,
        ]
        np.testing.assert_allclose(found, exact, atol=1e-12)
        np.testing.assert_allclose(bent(chosen, BASE[3], TARGET[3]), exact, atol=1e-12)  # type: ignore[arg-type]


def test_heading_turns_to_the_right_as_seen_from_above() -> None:
    north, east, _ = bent({"heading": np.pi / 2}, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert (north, east) == (pytest.approx(0.0, abs=1e-15), pytest.approx(1.0))


def test_ranges_are_the_scenarios_and_rest_lies_inside(simulation1: Scenario) -> None:
    found = {c.name: c for c in coordinates(fleet(simulation1, 5, "row", tuple(AUTOS.values())))}
    assert set(found) == set(NAMES)
    assert found["scale"].low == 0.4
    assert (found["heading"].low, found["heading"].high) == (-np.radians(120.0), np.radians(120.0))
    assert found["blend"].high == 1.0
    for c in found.values():
        assert c.low < c.rest < c.high
        assert min(c.rest - c.low, c.high - c.rest) <= 0.05 * (c.high - c.low) or c.name == "heading"
        assert c.weight == 0.3
        assert not c.free_end
    assert coordinates(fleet(simulation1)) == ()
    dear = coordinates(fleet(simulation1, changes=(auto(SHRINK, weight=2.0),)))
    assert dear[0].weight == 2.0


def test_with_the_course_the_heading_is_free_and_costs_nothing(simulation1: Scenario) -> None:
    (heading,) = coordinates(fleet(simulation1, formation={"frame": "course"}))
    assert (heading.name, heading.free_end, heading.weight) == ("heading", True, 0.0)
    assert heading.low < -2 * np.pi < 2 * np.pi < heading.high


def moved(scenario: Scenario, random: np.random.Generator, count: int) -> tuple[float, float]:
    """Largest speed and acceleration of any vehicle for random values within what coordinates may do, at full tilt."""
    found = coordinates(scenario)
    base, target = offsets_ned_m(scenario), target_ned_m(scenario)

    def drawn(number: int, coordinate: Coordinate) -> Array:
        value = random.uniform(max(coordinate.low, -2.0), min(coordinate.high, 2.0), count)
        full = random.integers(-1, 2, (2, count)) * random.choice([1.0, 1.0, 0.7], (2, count))
        return np.array([value, full[0] * coordinate.most[0], full[1] * coordinate.most[1]])

    drawn_all = [drawn(i, c) for i, c in enumerate(found)]
    step = 1e-3

    def offsets(h: float) -> Array:
        values: dict[CoordinateName, Array] = {
            c.name: q[0] + q[1] * h + 0.5 * q[2] * h * h for c, q in zip(found, drawn_all, strict=True)
        }
        parts = bent(values, tuple(base.T[:, :, None]), tuple(target.T[:, :, None]))
        return np.stack(np.broadcast_arrays(*parts), axis=-1)

    less, here, more = offsets(-step), offsets(0.0), offsets(step)
    speed = np.linalg.norm(more - less, axis=-1).max() / (2.0 * step)
    acceleration = np.linalg.norm(more - 2.0 * here + less, axis=-1).max() / step**2
    return float(speed), float(acceleration)


# Of a file, the last one; turns and growing go about the leader, so this is where limits bind.
ONE_SHAPE = ({"name": "row", "generator": "line", "spacing_m": 3.0},)


@pytest.mark.parametrize("names", SOME, ids="+".join)
@pytest.mark.parametrize(("speed_mps", "accel_mps2"), [(1.0, 0.3), (2.0, 0.8), (4.0, 0.3), (0.5, 1.4)])
def test_whatever_the_coordinates_do_no_vehicle_exceeds_its_budget(
    simulation1: Scenario, names: tuple[CoordinateName, ...], speed_mps: float, accel_mps2: float
) -> None:
    """All at once, every rate and acceleration as large as it may be."""
    wanted = {"change_speed_mps": speed_mps, "change_accel_mps2": accel_mps2}
    changes = tuple(AUTOS[name] for name in names)
    cases = [fleet(simulation1, 7, "row", changes, formation=wanted)]
    if "blend" not in names:
        cases.append(fleet(simulation1, 7, "row", changes, ONE_SHAPE, formation=wanted))
    for scenario in cases:
        speed, acceleration = moved(scenario, np.random.default_rng(0), 4000)
        assert speed <= speed_mps * 1.01  # a scale may go 2 % beyond one
        assert acceleration <= accel_mps2 * 1.02
        assert speed > 0.15 * speed_mps or acceleration > 0.25 * accel_mps2


@pytest.mark.parametrize("names", SOME, ids="+".join)
def test_a_motion_of_the_optimisers_keeps_the_budget_on_a_moving_base(
    simulation1: Scenario, names: tuple[CoordinateName, ...]
) -> None:
    """Scheduled changes and automatic ones at the same time: each has its share."""
    changes = (*(AUTOS[name] for name in names), at(TO_ROW, 1.0), at({"kind": "shrink", "scale": 1.5}, 60.0))
    scenario = fleet(simulation1, 5, "wedge", changes, time={"flight_s": 200.0})
    base = lay(scenario, (1.0, 60.0), 0.0, 200.0).shape
    found = coordinates(scenario)
    random = np.random.default_rng(len(names))
    # Bang-bang rates between their limits, their corners far too sharp for the acceleration, which is not looked at.
    joints = np.linspace(0.0, 200.0, 201)
    rates = np.column_stack([c.most[0] * random.integers(-1, 2, 200) for c in found])
    values = np.array([c.rest for c in found]) + np.concatenate([np.zeros((1, len(found))), np.cumsum(rates, axis=0)])
    values = np.clip(values, [c.low for c in found], [c.high for c in found])
    lines = PPoly(np.stack([np.diff(values, axis=0), values[:-1]]), joints)
    shape = composed(base, target_ned_m(scenario), [c.name for c in found], lines)
    t = np.linspace(0.5, 199.5, 3001)
    speed = np.linalg.norm(shape.offsets(t, 1), axis=-1).max()
    assert 0.3 < speed <= scenario.formation.change_speed_mps * 1.01


def test_a_budget_is_shared_only_where_motions_can_pass_at_once(simulation1: Scenario) -> None:
    whole = budget(fleet(simulation1))
    assert budget_of_each(fleet(simulation1, changes=(at(TURN, 1.0), at(TO_ROW, 20.0)))) == whole
    assert budget_of_each(fleet(simulation1, changes=(auto(SHRINK),))) == whole
    both = budget_of_each(fleet(simulation1, changes=(auto(SHRINK), at(TO_ROW, 20.0))))
    for one, of in zip(astuple_of(both), astuple_of(whole), strict=True):
        assert 0.0 < one <= 0.5 * of


def astuple_of(limit: Budget) -> tuple[float, ...]:
    return (limit.speed_mps, limit.accel_mps2, limit.jerk_mps3, limit.snap_mps4)


def test_a_blend_leads_to_the_shape_with_its_places_assigned(simulation1: Scenario) -> None:
    scenario = fleet(simulation1, 5, "row", (auto(TO_FILE),))
    target = target_ned_m(scenario)
    assert sorted(target[:, 0].round(9) + 0.0) == [-12.0, -9.0, -6.0, -3.0, 0.0]
    np.testing.assert_allclose(target[:, 1], 0.0, atol=1e-12)
    np.testing.assert_array_equal(target_ned_m(fleet(simulation1, 5, "row")), offsets_ned_m(scenario))


def test_a_blend_that_would_need_lanes_is_refused(simulation1: Scenario) -> None:
    shapes = (
        {"name": "a", "offsets_m": [[0, 0, 0], [0, 6, 0], [0, -6, 0]]},
        {"name": "b", "offsets_m": [[0, 0, 0], [0, -6, 0], [0, 6, 0]]},
    )
    swap = auto({"kind": "reshape", "to": "b", "assignment": "fixed"})
    with pytest.raises(
        Infeasible, match=r'no straight path .* to the shape "b" keeps 1 m; the only solution is in .* lanes'
    ) as e:
        target_ned_m(fleet(simulation1, 3, "a", (swap,), shapes))
    assert "instead of auto" in e.value.hint


def test_moves_of_its_own_are_told_as_changes(simulation1: Scenario) -> None:
    """Scale down to 0.6 and back, twice; the heading a little, not worth a line."""
    scenario = fleet(simulation1, 5, "row", (AUTOS["scale"], AUTOS["heading"]))
    points = np.linspace(0.0, 80.0, 81)
    scale = 1.0 - 0.4 * (np.sin(np.pi * points / 20.0) ** 2) * ((points < 20.0) | ((points > 40.0) & (points < 60.0)))
    heading = 0.02 * np.sin(points)
    values = quintics(points, np.column_stack([scale, heading]))
    shrink, again = automatic_moves(
        rigid(offsets_ned_m(scenario), 0.0, 80.0), target_ned_m(scenario), coordinates(scenario), values, 2.0
    )
    assert (shrink.kind, shrink.name, shrink.trigger) == ("shrink", "shrink to 0.60", "auto")
    assert 0.0 < shrink.start_s < 3.0
    assert 17.0 < shrink.end_s < 20.0
    assert 40.0 < again.start_s < again.end_s < 60.0
    assert shrink.least_gap_m == pytest.approx(0.6 * 3.0, abs=0.01)
    assert shrink.paper_time_s == pytest.approx(2.0 * 0.4 * 6.0 / 2.0, abs=0.02)


def test_an_automatic_turn_and_blend_have_their_words(simulation1: Scenario) -> None:
    scenario = fleet(simulation1, 5, "row", (AUTOS["heading"], AUTOS["blend"]))
    points = np.linspace(0.0, 40.0, 81)
    bump = np.sin(np.pi * points / 40.0) ** 4
    values = quintics(points, np.column_stack([-0.5 * bump, 0.8 * bump]))
    moves = automatic_moves(
        rigid(offsets_ned_m(scenario), 0.0, 40.0), target_ned_m(scenario), coordinates(scenario), values, 1.0
    )
    assert [move.name for move in moves] == ["rotate -29 deg", "reshape, 80 % done"]
    assert [move.kind for move in moves] == ["rotate", "reshape"]


def test_a_blend_beside_scheduled_changes_counts_the_longest_way_that_there_may_be(simulation1: Scenario) -> None:
    """From anywhere to the vehicle farthest from the leader: both distances, and nothing of the other vehicles."""
    scenario = fleet(simulation1, 5, "wedge", (AUTOS["blend"], at(TO_ROW, 1.0)))
    (blend,) = coordinates(scenario)
    shapes = [offsets_ned_m(scenario), *(shape_offsets_ned_m(scenario, s.name) for s in scenario.formation.shape)]
    way_m = np.linalg.norm(target_ned_m(scenario), axis=1).max() + np.linalg.norm(shapes, axis=2).max()
    assert blend.most == pytest.approx([rate / way_m for rate in astuple_of(budget_of_each(scenario))])
