"""Curves for other planners and shows: read again they are the plan, within a millimetre, and as far apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gcs
from gcs.mission.export.plan_curves import plan_curves
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan


@pytest.mark.parametrize(
    ("name", "pattern", "factor"), [("pieces", "uav*.pieces.csv", 1.0), ("skyc", "formation.skyc", 3.0)]
)
def test_a_plan_read_again_is_within_a_millimetre(
    hop: Plan, tmp_path: Path, name: str, pattern: str, factor: float
) -> None:
    gcs.export(hop, tmp_path, formats=[name])
    read = gcs.read_tracks(sorted(tmp_path.glob(pattern)), start_s=hop.t_start_s)
    t_s = np.random.default_rng(1).uniform(hop.t_start_s, hop.t_end_s, 4000)
    planned = hop.states(t_s)
    assert len(read.tracks) == len(hop.sysids)
    for row, track in enumerate(read.tracks):
        ends_s = track.position_ned_m.x[[0, -1]]
        np.testing.assert_allclose(ends_s, [hop.t_start_s, hop.t_end_s], atol=1e-5)
        off_m = np.linalg.norm(track.position_ned_m(t_s) - planned[row][:, POSITION], axis=1)
        assert off_m.max() < 1e-3
        off_mps = np.linalg.norm(track.position_ned_m(t_s, 1) - planned[row][:, VELOCITY], axis=1)
        assert off_mps.max() < 0.01 * factor
    least_m = hop.separations_m(t_s).min()
    proved = gcs.prove(read.tracks, None, hop.scenario)
    assert proved.ok
    (separation,) = (check for check in proved.checks if check.name == "separation")
    assert separation.seen == pytest.approx(least_m, abs=2e-3)


def test_yaw_is_that_of_the_plan_from_east_to_north(hop: Plan, tmp_path: Path) -> None:
    gcs.export(hop, tmp_path, formats=["pieces"])
    table = np.loadtxt(tmp_path / "uav2.pieces.csv", delimiter=",", skiprows=1)
    starts_s = hop.t_start_s + np.concatenate([[0.0], np.cumsum(table[:-1, 0])])
    share = 0.4
    at_s = starts_s + share * table[:, 0]
    yaw = sum(table[:, 25 + power] * (share * table[:, 0]) ** power for power in range(8))
    turn = np.angle(np.exp(1j * (0.5 * np.pi - yaw - hop.states(at_s)[1][:, 8])))
    np.testing.assert_allclose(turn, 0.0, atol=0.01)


def test_all_vehicles_have_the_same_instants_and_straight_flight_has_few(hop: Plan) -> None:
    curves = list(plan_curves(hop, quintics=True))
    assert [curve.sysid for curve in curves] == list(hop.sysids)
    for curve in curves[1:]:
        np.testing.assert_array_equal(curve.t_s, curves[0].t_s)
    assert curves[0].t_s[0] == 0.0
    assert len(curves[0].t_s) < 80 < len(next(plan_curves(hop, quintics=False)).t_s) * 2
