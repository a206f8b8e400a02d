"""Emulated flights inside and outside of the border of a plan's wind envelope."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gcs
from gcs.physics.states import ATTITUDE
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.wind_envelope import wind_envelope
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.formations import fleet

MOST_DEG = 12.0
FEEDBACK_DEG = 0.3  # control of a vehicle in its own noise; 0.13 degrees were seen


def largest_pitch_deg(plan: Plan, speed_mps: float, from_deg: float, folder: Path) -> float:
    """The largest true |pitch| of all vehicles in the air."""
    emulated = gcs.Emulated(speedup="max", seed=3, wind=f"{speed_mps:.2f}@{from_deg:g}")
    flown = gcs.fly(plan, to=folder, emulated=emulated)
    assert flown.verdict is not None and flown.verdict.ok
    truth = gcs.load_truth(flown.folder)
    t_s = flown.times.plan_time.t_s(truth.unix_s)
    inside = (t_s > plan.airborne_s) & (t_s < plan.landing_s)
    return float(np.degrees(np.abs(truth.states[:, inside][..., ATTITUDE][..., 1]).max()))


@pytest.mark.slow
def test_a_flight_outside_leans_more_than_the_limit_and_one_inside_does_not(
    simulation1: Scenario, tmp_path: Path
) -> None:
    plan = make_plan(fleet(simulation1, limits={"roll_pitch_yaw_deg": [MOST_DEG, MOST_DEG, 180.0]}))
    envelope, from_deg = wind_envelope(plan), 180.0
    assert envelope.borders[12].from_deg == from_deg and envelope.borders[12].limit == "pitch"
    border_mps = envelope.ok_from(from_deg)
    assert largest_pitch_deg(plan, 0.9 * border_mps, from_deg, tmp_path) < MOST_DEG
    assert largest_pitch_deg(plan, border_mps, from_deg, tmp_path) == pytest.approx(MOST_DEG, abs=FEEDBACK_DEG)
    assert largest_pitch_deg(plan, 1.15 * border_mps, from_deg, tmp_path) > MOST_DEG + FEEDBACK_DEG
