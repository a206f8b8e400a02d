"""The smoothed path: smoother than the plan, near it, within its limits; and the export that carries it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs.errors import UsageError, VerificationError
from gcs.mission.export.atomic_folder import INDEX
from gcs.mission.export.bspline_smoothing import SHORTEST_KNOT_S, SmoothPath, path_bounds, smoothed
from gcs.mission.export.export import export
from gcs.mission.export.setpoint_stream import build_stream, of_vehicle
from gcs.mission.formats.tables.setpoint_table import read_setpoints
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.ground_distance import ground_distance_m
from gcs.scenario.schema.scenario import NoFlyZone

TOLERANCE_M = 0.1


@pytest.fixture(scope="module")
def path(hop: Plan) -> SmoothPath:
    return smoothed(hop, TOLERANCE_M)


@pytest.fixture(scope="module")
def times(hop: Plan) -> np.ndarray:
    """Instants that the fit did not see."""
    span = hop.phase("takeoff").end_s, hop.phase("landing").start_s
    return np.sort(np.random.default_rng(3).uniform(*span, 20_000))


def test_every_vehicle_stays_as_near_as_told(path: SmoothPath, times: np.ndarray) -> None:
    position, *_ = path.at(times)
    off = np.linalg.norm(position - path.plan.states(times)[..., POSITION], axis=-1)
    assert off.max() <= path.deviation_m * 1.01 + 1e-6
    assert path.deviation_m <= TOLERANCE_M
    assert path.deviation_m > 1e-4  # it is a path of its own


def test_it_is_four_times_differentiable_where_the_plan_has_corners(path: SmoothPath) -> None:
    knots = np.unique(path.spline.t)[1:-1]
    for order in range(5):
        before, after = (path.spline(knots + side * 1e-9, nu=order) for side in (-1, 1))
        assert before == pytest.approx(after, abs=1e-5)


def test_velocity_and_acceleration_are_its_derivatives(path: SmoothPath, times: np.ndarray) -> None:
    step = 1e-4
    t = times[(times > times[0] + 1) & (times < times[-1] - 1)][::50]
    (before, v0, *_), (_, velocity, acceleration, _), (after, v1, *_) = (path.at(t + d) for d in (-step, 0.0, step))
    assert (after - before) / (2 * step) == pytest.approx(velocity, abs=1e-5)
    assert (v1 - v0) / (2 * step) == pytest.approx(acceleration, abs=1e-5)


def test_limits_hold_on_instants_that_nobody_checked(path: SmoothPath, times: np.ndarray) -> None:
    position, velocity, acceleration, _ = path.at(times)
    scenario = path.plan.scenario
    assert np.all(np.abs(velocity) <= np.array(scenario.limits.speed_ned_mps) * 1.01)
    assert np.all(-position[..., 2] <= scenario.limits.height_m[1] * 1.01)
    north, east, up = position[..., 0], position[..., 1], -position[..., 2]
    clearance = ground_distance_m(scenario.terrain, north, east, up, 30.0)
    assert clearance.min() >= scenario.limits.clearance_min_m - 0.01
    assert max(clearance.min() - 0.1, scenario.limits.clearance_min_m - 0.01) <= path.clearance_min_m <= clearance.min()
    # Thrust by Newton's law: m (g - a) - drag.
    vehicle = path.plan.quadrotor
    force = vehicle.mass_kg * (np.array([0, 0, 9.8]) - acceleration) - np.array(vehicle.drag_Nspm) * velocity
    assert np.linalg.norm(force, axis=-1).max() <= scenario.limits.thrust_N[1] * 1.01


def test_it_begins_and_ends_at_rest_at_the_planned_places(path: SmoothPath) -> None:
    ends = np.array([path.spline.t[0], np.nextafter(path.spline.t[-1], 0.0)])
    position, velocity, acceleration, _ = path.at(ends)
    assert position == pytest.approx(path.plan.states(ends)[..., POSITION], abs=1e-6)
    assert velocity == pytest.approx(np.zeros_like(velocity), abs=1e-6)
    assert acceleration == pytest.approx(np.zeros_like(acceleration), abs=1e-6)


def test_less_room_takes_closer_knots(hop: Plan, path: SmoothPath) -> None:
    nearer = smoothed(hop, path.deviation_m / 3.0)
    assert nearer.knots_every_s < path.knots_every_s
    assert nearer.deviation_m <= path.deviation_m / 3.0


def test_a_limit_that_no_knots_can_hold_is_told(hop: Plan) -> None:
    scenario = hop.scenario
    fastest = np.abs(hop.states(np.arange(0.0, 275.0, 0.1))[..., VELOCITY]).max(axis=(0, 1))
    slower = (*(0.5 * fastest[:2]).tolist(), 2.0)
    limits = scenario.limits.model_copy(update={"speed_ned_mps": slower})
    plan = replace(hop, scenario=scenario.model_copy(update={"limits": limits}))
    with pytest.raises(VerificationError, match=rf"knots {SHORTEST_KNOT_S:g} s apart: north speed violated by"):
        smoothed(plan, TOLERANCE_M)


def test_a_tolerance_must_be_positive(hop: Plan) -> None:
    for tolerance_m in (0.0, -1.0, float("nan")):
        with pytest.raises(UsageError, match="smoothing tolerance is"):
            smoothed(hop, tolerance_m)


def test_an_export_carries_the_smoothed_setpoints(hop: Plan, path: SmoothPath, tmp_path: Path) -> None:
    index = export(hop, tmp_path, setpoint_rate_hz=2.0, smooth_m=TOLERANCE_M)
    stream = read_setpoints((tmp_path / "uav2.setpoints").read_bytes(), "x").stream
    position, _, _, yaw = path.at(stream.t_s)
    row = hop.sysids.index(2)
    assert stream.position_ned_m[0] == pytest.approx(position[row], abs=1e-6)
    assert stream.yaw_ned_rad[0] == pytest.approx(yaw[row], abs=1e-6)
    assert not np.any(stream.velocity_ned_mps[:, -1])
    document = json.loads((tmp_path / INDEX).read_text())
    assert index.smoothing is not None
    assert index.smoothing.deviation_m == path.deviation_m
    assert document["smoothing"]["deviation_m"] == pytest.approx(path.deviation_m, abs=1e-5)


def test_without_the_option_the_plan_itself_is_written(hop: Plan, tmp_path: Path) -> None:
    export(hop, tmp_path, setpoint_rate_hz=2.0)
    stream = read_setpoints((tmp_path / "uav2.setpoints").read_bytes(), "x").stream
    whole = build_stream(hop, 2.0)
    assert np.array_equal(stream.position_ned_m, of_vehicle(whole, whole.sysids.index(2)).position_ned_m)
    assert "smoothing" not in json.loads((tmp_path / INDEX).read_text())


def test_a_wall_between_two_samples_is_found(hop: Plan, path: SmoothPath) -> None:
    """At 2.3 m/s, 0.06 m of a wall take 26 ms: only every second look at every 50 ms is inside."""
    north, east = path.at(np.array([15.013]))[0][path.plan.leader, 0, :2]
    wall = NoFlyZone(
        polygon_m=(
            (north - 0.03, east - 300.0),
            (north + 0.03, east - 300.0),
            (north + 0.03, east),
            (north - 0.03, east),
        )
    )
    scenario = hop.scenario.model_copy(update={"no_fly": (wall,)})
    found = path_bounds(replace(hop, scenario=scenario), path.spline, 1e-2)
    assert any(text.startswith("no-fly zone 1 violated by") for text in found.violated)


def test_a_speed_between_two_samples_is_found(hop: Plan, path: SmoothPath) -> None:
    """The bound is above every sample, and less than 0.1 % above the greatest of many."""
    t_s = np.linspace(path.spline.t[0], np.nextafter(path.spline.t[-1], 0.0), 200_001)
    fastest = np.abs(path.at(t_s)[1]).max(axis=(0, 1))
    for share, violated in ((0.999, True), (1.0 + 2e-4, False)):
        limits = hop.scenario.limits.model_copy(update={"speed_ned_mps": tuple((share * fastest).tolist())})
        scenario = hop.scenario.model_copy(update={"limits": limits})
        texts = path_bounds(replace(hop, scenario=scenario), path.spline, 0.0).violated
        assert sum("speed" in text for text in texts) == (3 if violated else 0)
