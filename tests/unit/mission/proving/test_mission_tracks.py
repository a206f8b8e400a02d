"""Missions as tracks: the flights of their autopilots' models, in the frame of the scenario."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gcs
from gcs.errors import FileFormatError, UsageError
from gcs.mission.check.fleet_check import check_fleet
from gcs.mission.flight_limits import limits_of, surroundings_of
from gcs.mission.formats.any_mission import load_missions
from gcs.mission.predicted.autopilot_flight import AutopilotFlight
from gcs.mission.proving.timed_samples import through
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.si import ability_of, quadrotor


@pytest.fixture(scope="module")
def exported(hop: Plan, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("exported")
    gcs.export(hop, folder, formats=["plan", "waypoints"])
    return sorted(folder.glob("uav*.plan"))


def test_missions_are_as_near_as_the_check_of_missions_says(hop: Plan, exported: list[Path]) -> None:
    """Two proofs of one prediction: by pairs of straight pieces there, by Taylor models here."""
    scenario = hop.scenario
    read = gcs.read_tracks(exported, scenario=scenario)
    assert [track.name for track in read.tracks] == [file.stem for file in exported]
    model = AutopilotFlight(ability_of(quadrotor(scenario), scenario.limits))
    checked = check_fleet(load_missions(exported), surroundings_of(scenario), limits_of(scenario, 1.0), model)
    assert checked.closest is not None
    separation = gcs.prove(read.tracks, gcs.TrackLimits(1.0), scenario).checks[1]
    assert separation.name == "separation"
    assert separation.ok
    assert separation.seen == pytest.approx(checked.closest.distance_m, abs=0.05)
    assert separation.proved >= checked.closest.proved_m - 0.1  # the most that any piece bends, of both


def test_a_model_that_bends_takes_that_from_the_proved_separation() -> None:
    """Two that stand 5 m apart, each somewhere within 0.3 m."""
    rows = np.array([[0.0, 0.0, -5.0], [5.0, 0.0, -5.0]])
    still = [
        gcs.PolynomialTrack(name, through(np.array([0.0, 1.0]), np.array([at, at])), 0.3)
        for name, at in zip("ab", rows, strict=True)
    ]
    proved = gcs.prove(still, gcs.TrackLimits(4.3)).checks[-1]
    assert proved.ok
    assert 4.0 <= proved.proved <= 4.4
    assert not gcs.prove(still, gcs.TrackLimits(4.5)).ok


def test_the_speed_of_a_mission_is_not_bounded_by_straight_pieces(exported: list[Path]) -> None:
    with pytest.raises(UsageError, match=r"uav1.*do not bound its speed"):
        gcs.prove(gcs.read_tracks(exported).tracks, gcs.TrackLimits(1.0, speed_mps=20.0))


def test_a_mission_that_leads_nowhere_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "home.waypoints"
    file.write_text("QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t47\t8\t400\t1\n")
    with pytest.raises(FileFormatError, match=r"home\.waypoints: the mission leads nowhere"):
        gcs.read_tracks([file])
