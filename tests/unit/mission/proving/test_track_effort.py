"""Thrust, tilt and jerk of tracks, and the scenario's box and speeds: against dense samples and closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly

import gcs
from gcs.errors import UsageError
from gcs.mission.proving.timed_samples import through
from gcs.mission.proving.track import FleetMotion
from gcs.mission.proving.track_criteria import TrackEffort
from gcs.physics.quadrotor import Quadrotor, thrust_and_tilt
from gcs.plan.verification.proof.subdivision import Cells
from gcs.scenario.sources.load import vehicle_type
from tests.unit.plan.problems import FLAT, changed

VEHICLE = "quad500"


def check_of(report: gcs.TrackReport, name: str) -> gcs.TrackCheck:
    (found,) = (check for check in report.checks if check.name == name)
    return found


def wild(seed: int) -> gcs.PolynomialTrack:
    """A polynomial of degree 5 over 4 s, with accelerations of some m/s²."""
    c = (
        np.random.default_rng(seed).uniform(-1.0, 1.0, (6, 1, 3))
        * np.array([0.02, 0.1, 0.4, 1.0, 3.0, 10.0])[:, None, None]
    )
    return gcs.PolynomialTrack("wild", PPoly(c, [0.0, 4.0]))


def test_a_force_that_sweeps_through_straight_down_is_tilted_by_180_degrees() -> None:
    """It falls faster than freely, and its level acceleration changes its sign at 0.3 s."""
    c = np.zeros((4, 1, 3))
    c[0, 0, 0], c[1, 0, 0], c[1, 0, 2] = -16.0 / 6.0, 4.8 / 2.0, 12.0 / 2.0
    motion = FleetMotion.of([gcs.PolynomialTrack("falling", PPoly(c, [0.0, 1.0]))], np.empty(0))
    body = Quadrotor(**vehicle_type(VEHICLE).vehicle.model_dump(exclude={"name", "power"}))
    family = TrackEffort(motion, body, (0.0, 100.0), math.radians(170.0))
    none = np.zeros(1, dtype=np.intp)
    low, _ = family.bounds(Cells(none[:, None], np.zeros(1), np.ones(1), none, np.zeros((1, 0))))
    assert low[2, 0] <= 170.0 - 180.0


@pytest.mark.parametrize("seed", range(6))
def test_thrust_tilt_and_jerk_are_bounded_as_dense_samples_find_them(seed: int) -> None:
    track = wild(seed)
    of = vehicle_type(VEHICLE)
    body = Quadrotor(**of.vehicle.model_dump(exclude={"name", "power"}))
    t_s = np.linspace(0.0, 4.0, 40_001)
    velocity, acceleration, jerk = (track.position_ned_m(t_s, order) for order in (1, 2, 3))
    thrust, roll, pitch = thrust_and_tilt(acceleration, velocity, np.zeros(len(t_s)), body)
    tilt = np.degrees(np.arccos(np.cos(roll) * np.cos(pitch)))
    limits: dict[str, Any] = {
        "thrust_N": (thrust.min() * 0.99, thrust.max() * 1.01),
        "tilt_deg": tilt.max() * 1.01,
        "jerk_mps3": np.linalg.norm(jerk, axis=1).max() * 1.01,
    }
    assert gcs.prove([track], gcs.TrackLimits(**limits), vehicle=VEHICLE).ok
    for key, wrong, name, at_s in (
        ("thrust_N", (thrust.min() * 1.01, thrust.max() * 1.01), "least thrust", t_s[thrust.argmin()]),
        ("thrust_N", (thrust.min() * 0.99, thrust.max() * 0.99), "greatest thrust", t_s[thrust.argmax()]),
        ("tilt_deg", tilt.max() * 0.99, "tilt", t_s[tilt.argmax()]),
        ("jerk_mps3", limits["jerk_mps3"] * 0.98, "jerk", t_s[np.linalg.norm(jerk, axis=1).argmax()]),
    ):
        (broken,) = gcs.prove([track], gcs.TrackLimits(**limits | {key: wrong}), vehicle=VEHICLE).failures
        assert (broken.name, broken.verdict) == (name, "violated")
        assert broken.t_s == pytest.approx(at_s, abs=0.3)


def test_a_vehicle_that_hovers_in_the_scenarios_wind_leans_against_its_drag(simulation1: gcs.Scenario) -> None:
    windy = changed(simulation1, terrain=FLAT, no_fly=[], wind={"speed_mps": 8.0, "from_deg": 270.0})
    body = vehicle_type(VEHICLE).vehicle
    tilt_deg = math.degrees(math.atan2(body.drag_Nspm[1] * 8.0, body.mass_kg * 9.8))
    still = gcs.PolynomialTrack("still", through(np.array([0.0, 9.0]), np.full((2, 3), -10.0), np.zeros((2, 3))))
    assert check_of(gcs.prove([still], gcs.TrackLimits(tilt_deg=90.0), windy, VEHICLE), "tilt").seen == pytest.approx(
        tilt_deg
    )
    calm = changed(simulation1, terrain=FLAT, no_fly=[])
    assert check_of(gcs.prove([still], None, calm, VEHICLE), "tilt").seen == pytest.approx(0.0, abs=1e-9)


def test_the_limits_are_the_vehicles_unless_stated() -> None:
    own = vehicle_type(VEHICLE).limits
    report = gcs.prove([wild(1)], vehicle=VEHICLE)
    assert check_of(report, "greatest thrust").limit == own.thrust_N[1]
    assert check_of(report, "tilt").limit == pytest.approx(min(own.roll_pitch_yaw_deg[:2]))
    assert "thrust" in gcs.prove([wild(1)]).unchecked


@pytest.mark.parametrize(("derivative", "name"), [(0, "place"), (1, "velocity"), (2, "acceleration")])
def test_a_step_that_the_motion_forbids_is_found_at_its_joint(derivative: int, name: str) -> None:
    c = np.zeros((4, 2, 3))
    c[3 - derivative, 1, 0] = 0.1
    c[3, :, 2] = -10.0
    report = gcs.prove([gcs.PolynomialTrack("a", PPoly(c, [0.0, 1.0, 2.0]))], gcs.TrackLimits(jerk_mps3=5.0))
    (step,) = report.failures
    assert step.name == f"step of the {name} at a joint"
    assert step.t_s == 1.0


@pytest.mark.parametrize(
    ("end_m", "name"),
    [
        ((1500.0, 0.0), "greatest northing"),
        ((-60.0, 0.0), "least northing"),
        ((0.0, 1500.0), "greatest easting"),
        ((0.0, -60.0), "least easting"),
        ((0.0, 30.0), "speed along east"),
    ],
)
def test_the_box_and_the_speeds_are_the_scenarios(
    simulation1: gcs.Scenario, end_m: tuple[float, float], name: str
) -> None:
    box = {"north_m": [-50.0, 50.0], "east_m": [-50.0, 50.0], "speed_ned_mps": [6.0, 2.0, 3.0]}
    scenario = changed(simulation1, terrain=FLAT, no_fly=[], limits=box)
    every_s = 10.0 if "speed" in name else 1000.0
    places = np.array([[0.0, 0.0, -10.0], [*end_m, -10.0], [0.0, 0.0, -10.0]])
    track = gcs.PolynomialTrack("a", through(np.array([0.0, every_s, 2.0 * every_s]), places))
    (broken,) = gcs.prove([track], None, scenario).failures
    assert broken.name == name


def test_thrust_needs_a_vehicle_and_a_motion() -> None:
    straight = gcs.PolynomialTrack("a", through(np.array([0.0, 1.0]), np.zeros((2, 3))))
    with pytest.raises(UsageError, match="depend on mass"):
        gcs.prove([wild(1)], gcs.TrackLimits(tilt_deg=10.0))
    with pytest.raises(UsageError, match="straight between samples"):
        gcs.prove([straight], vehicle=VEHICLE)
    with pytest.raises(gcs.GcsError, match="bird"):
        gcs.prove([wild(1)], vehicle="bird")
