"""A vehicle that leaves the volumes that its supplier has is an incident, by setpoints and by missions on board."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import pytest

from gcs.cli.flights.attach_view import AttachRequest, _volumes
from gcs.cli.shared.console import Screen
from gcs.errors import FileFormatError
from gcs.flight.contingency.choices import FlightMode
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.execution.resume import Resume
from gcs.flight.monitoring.volume_watch import VOLUMES, FlownVolumes
from gcs.mission.export.flight_volumes import VolumeOrder, flight_volumes
from gcs.mission.formats.f3548 import write_operational_intent
from gcs.plan.trajectory.plan import Plan
from tests.bridge.flying import fly
from tests.fleets import EPOCH_UNIX_S

OUTSIDE = "outside its volumes"
GEOID_M = 47.9


def volumes_file(plan: Plan, folder: Path, begin_s: float = 0.0) -> Path:
    """Of a take-off so long after the emulated vehicles' clock begins, up to 2 minutes late."""
    takeoff = datetime.fromtimestamp(EPOCH_UNIX_S + begin_s, UTC)
    order = VolumeOrder(takeoff, GEOID_M, volumes=4, late_s=120.0)
    file = folder / "f3548.json"
    file.write_text(write_operational_intent(flight_volumes(plan, order).intent))
    return file


@pytest.mark.slow
def test_the_one_that_is_pushed_out_of_its_volume_is_told_and_the_others_are_not(hop: Plan, tmp_path: Path) -> None:
    volumes = FlownVolumes.read(volumes_file(hop, tmp_path), hop, GEOID_M)
    flown = fly(hop, "3:push=0,6@20", volumes=volumes)
    assert OUTSIDE in flown.happened(3)
    assert OUTSIDE not in flown.happened(1) + flown.happened(2)
    told = next(event for event in flown.events if event.what == OUTSIDE)
    assert told.alarm
    assert "m beside volume" in told.rule and "of 4" in told.rule
    pushed_s = hop.t_start_s + 20.0  # after the take-off
    assert 0.5 < flown.at_s(3, OUTSIDE) - pushed_s < 4.0


@pytest.mark.slow
def test_missions_on_board_are_watched_too(hop: Plan, tmp_path: Path) -> None:
    volumes = FlownVolumes.read(volumes_file(hop, tmp_path), hop, GEOID_M)
    flown = fly(hop, "3:push=0,6@20", mode=FlightMode.MISSION, volumes=volumes)
    assert OUTSIDE in flown.happened(3)


@pytest.mark.slow
def test_a_take_off_before_the_volumes_are_in_force_is_told(hop: Plan, tmp_path: Path) -> None:
    volumes = FlownVolumes.read(volumes_file(hop, tmp_path, begin_s=3600.0), hop, GEOID_M)
    flown = fly(hop, volumes=volumes)
    assert flown.error is None
    for sysid in hop.sysids:
        assert flown.happened(sysid) == [OUTSIDE]
    assert "no volume is in force at" in next(event for event in flown.events if event.what == OUTSIDE).rule


def test_volumes_of_another_plan_or_geoid_are_refused(hop: Plan, tmp_path: Path) -> None:
    file = volumes_file(hop, tmp_path)
    with pytest.raises(FileFormatError, match="volumes of another flight"):
        FlownVolumes.read(file, hop, GEOID_M - 5.0)
    (tmp_path / "other.json").write_text('{"volumes": []}')
    with pytest.raises(FileFormatError, match="has no volumes"):
        FlownVolumes.read(tmp_path / "other.json", hop, GEOID_M)


def test_attach_watches_the_volumes_that_a_flight_was_begun_with(
    hop: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    volumes = FlownVolumes.read(volumes_file(hop, tmp_path), hop, GEOID_M)
    flight = tmp_path / "flight"
    flight.mkdir()
    FlightOptions().keep(flight)
    assert not [*flight.iterdir()]
    FlightOptions(volumes=volumes).keep(flight)
    assert FlownVolumes.load(flight / VOLUMES, hop).volumes == volumes.volumes

    def watched(what: Resume) -> FlownVolumes | None:
        return _volumes(AttachRequest(flight, what, (), None, Screen(json=False)), hop)

    for what in (Resume.RETURN, Resume.RESUME):
        taken = watched(what)
        assert taken is not None
        assert taken.volumes == volumes.volumes
    assert watched(Resume.SHOW) is None
    for damaged in ("{}", '{"geoid_m": NaN, "operational_intent": {}}', "[", '{"geoid_m": 1, "operational_intent": 2}'):
        (flight / VOLUMES).write_text(damaged)
        assert watched(Resume.RESUME) is None
        assert "not detected" in capsys.readouterr().out
