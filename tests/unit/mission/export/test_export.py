"""Export folders: complete, consistent, and replaced whole or not at all."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from gcs.autopilots.parameter_names import with_new_names
from gcs.autopilots.traits import TRAITS, Autopilot
from gcs.errors import FileFormatError, NotWritten, UsageError
from gcs.frames import geodetic_to_ned
from gcs.mission.export.atomic_folder import INDEX
from gcs.mission.export.export import export
from gcs.mission.export.flight_volumes import VolumeOrder
from gcs.mission.formats.param import read_parameters
from gcs.mission.formats.qgc_plan import read_mission
from gcs.mission.formats.qgc_wpl import read_fence, read_rally, read_waypoints
from gcs.mission.formats.registry import FLEET, FORMATS
from gcs.mission.formats.tables.csv_table import read_csv
from gcs.mission.formats.tables.history_csv import COLUMNS as HISTORY_COLUMNS
from gcs.mission.formats.tables.setpoint_table import read_setpoints
from gcs.mission.formats.tables.setpoints_parquet import read_setpoints_parquet
from gcs.mission.model import Altitude
from gcs.mission.waypoints.mission_items import build_missions
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.si import local_origin
from tests.unit.mission.map_tracks import geojson_tracks, kml_tracks


def contents(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.iterdir()}


def test_everything_is_there_and_says_the_same(hop: Plan, tmp_path: Path) -> None:
    index = export(hop, tmp_path / "out", setpoint_rate_hz=2)
    written = contents(tmp_path / "out")
    document = json.loads(written.pop(INDEX))
    assert document["plan_hash"] == hop.hash
    assert document["sha256"] == index.sha256
    assert {name: hashlib.sha256(data).hexdigest() for name, data in written.items()} == index.sha256
    for mission in index.missions:
        waypoints = read_waypoints(written[f"uav{mission.sysid}.waypoints"], "w")
        plan = read_mission(written[f"uav{mission.sysid}.plan"], "p")
        assert waypoints.items == plan.items == mission.items
        assert waypoints.home == plan.home == mission.home
        assert index.items == len(mission.items)
        setpoints = read_setpoints(written[f"uav{mission.sysid}.setpoints"], "s")
        assert (setpoints.stream.sysids, setpoints.plan_hash) == ((mission.sysid,), hop.hash)
    assert len(written) == 3 * len(hop.sysids)


def test_every_format(hop: Plan, tmp_path: Path) -> None:
    plan = hop
    export(plan, tmp_path, formats=["all"], setpoint_rate_hz=2)
    written = contents(tmp_path)
    for sysid in plan.sysids:
        csv = read_setpoints(written[f"uav{sysid}.setpoints"], "s")
        parquet = read_setpoints_parquet(written[f"uav{sysid}.parquet"], "s")
        assert (parquet.plan_hash, parquet.origin) == (csv.plan_hash, csv.origin)
        assert np.array_equal(parquet.stream.position_ned_m, csv.stream.position_ned_m)
        plan_file = read_mission(written[f"uav{sysid}.plan"], "p")
        assert read_fence(written[f"uav{sysid}.fence"], "f") == plan_file.geofence
        assert read_rally(written[f"uav{sysid}.rally"], "r") == plan_file.rally
        parameters = read_parameters(written[f"uav{sysid}.param"], "p", Autopilot.ARDUPILOT)
        listed = json.loads(written[INDEX])["parameters"][str(sysid)]
        assert parameters.values == with_new_names(Autopilot.ARDUPILOT, listed.items())
        assert plan_file.rally[0].alt_m * 100 == pytest.approx(dict(parameters.values)["RTL_ALT"])
        comments, table = read_csv(written[f"uav{sysid}.history.csv"], HISTORY_COLUMNS)
        assert (comments["vehicle"], comments["plan"]) == (str(sysid), plan.hash)
        values = np.column_stack([table.column(name).to_numpy() for name in HISTORY_COLUMNS])
        assert (values[0, 0], values[-1, 0]) == (plan.t_start_s, plan.t_end_s)
        states, controls = plan.motion(values[1:-1, 0])
        assert np.abs(values[1:-1, 1:13] - states[plan.sysids.index(sysid)]).max() <= 0.51e-6
        assert np.abs(values[1:-1, 13:] - controls[plan.sysids.index(sysid)]).max() <= 0.51e-7
    for drawn in (kml_tracks(written["formation.kml"]), geojson_tracks(written["formation.geojson"])):
        assert [track.sysid for track in drawn] == list(plan.sysids)
        origin = local_origin(plan.scenario)
        for row, track in enumerate(drawn):
            flown = geodetic_to_ned(track.lat_deg, track.lon_deg, track.alt_amsl_m, origin)
            wanted = plan.states(track.t_s[:-1])[row, :, POSITION]
            assert np.allclose(flown[:-1], wanted, atol=7e-3)  # seven decimals of a degree


def test_every_format_reads_back_what_it_wrote(hop: Plan, tmp_path: Path) -> None:
    """Each row by its own writer and reader, for both autopilots."""
    for firmware in Autopilot:
        folder = tmp_path / firmware.key
        volumes = VolumeOrder(datetime(2026, 11, 28, 10, 30, tzinfo=UTC), 47.9)
        export(hop, folder, formats=FORMATS, firmware=firmware, setpoint_rate_hz=1, timed=False, volumes=volumes)
        for row in FORMATS:
            if row.reader is None:
                continue
            name = row.file_name("uav1" if row.content.per_vehicle else FLEET, firmware)
            data = (folder / name).read_bytes()
            written = row.write(row.read(data, name, firmware))
            assert (written.encode() if isinstance(written, str) else written) == data, name


def test_autopilot_and_altitude_on_request(hop: Plan, tmp_path: Path) -> None:
    export(hop, tmp_path, formats=["plan"], firmware=Autopilot.PX4, altitude=Altitude.AMSL, timed=False)
    plan = read_mission((tmp_path / "uav1.plan").read_bytes(), "p")
    assert plan.firmware is Autopilot.PX4
    assert {i.frame for i in plan.items} == {0, 2}
    index = json.loads((tmp_path / INDEX).read_text())
    assert (index["firmware"], index["altitude"]) == ("px4", "amsl")
    assert set(index["sha256"]) == {f"uav{sysid}.plan" for sysid in hop.sysids}


def test_px4_counts_no_home(hop: Plan, tmp_path: Path) -> None:
    options = hop.scenario.mission.model_copy(update={"autopilot": "px4"})
    plan = replace(hop, scenario=hop.scenario.model_copy(update={"mission": options}))
    export(plan, tmp_path, setpoint_rate_hz=2, timed=False)
    file = read_waypoints((tmp_path / "uav1.waypoints").read_bytes(), "w", home_first=False)
    assert file.items == build_missions(plan)[0].items
    assert json.loads((tmp_path / "uav1.plan").read_text())["mission"]["firmwareType"] == 12


def test_the_same_plan_gives_the_same_bytes_and_replaces_the_old(hop: Plan, tmp_path: Path) -> None:
    out = tmp_path / "out"
    export(hop, out, setpoint_rate_hz=2)
    before = contents(out)
    (out / "uav3.plan").write_text("damaged")
    export(hop, out, setpoint_rate_hz=2)
    assert contents(out) == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_failure_on_the_way_leaves_the_old_export(hop: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    export(hop, out, setpoint_rate_hz=2)
    before = contents(out)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        export(hop, out, setpoint_rate_hz=5)
    assert contents(out) == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_folder_that_cannot_be_swapped_in_is_put_back(
    hop: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    export(hop, out, setpoint_rate_hz=2)
    before = contents(out)
    rename = Path.rename

    def refuse_new(self: Path, target: Path) -> Path:
        if self.name == "new":
            raise PermissionError(13, "Permission denied")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", refuse_new)
    with pytest.raises(PermissionError):
        export(hop, out, setpoint_rate_hz=5)
    assert contents(out) == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_what_no_export_made_is_never_replaced(hop: Plan, tmp_path: Path) -> None:
    out = tmp_path / "out"
    export(hop, out, setpoint_rate_hz=2)
    (out / "notes.txt").write_text("mine")
    with pytest.raises(UsageError, match=r"notes\.txt"):
        export(hop, out, setpoint_rate_hz=2)
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "cat.jpg").write_bytes(b"")
    with pytest.raises(UsageError, match=r"cat\.jpg"):
        export(hop, tmp_path / "photos", setpoint_rate_hz=2)
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="is a file"):
        export(hop, tmp_path / "file", setpoint_rate_hz=2)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"format": "other", "sha256": {}}'])
def test_somebody_elses_index(hop: Plan, tmp_path: Path, text: str) -> None:
    (tmp_path / INDEX).write_text(text)
    with pytest.raises(FileFormatError, match="not the index of an export"):
        export(hop, tmp_path, setpoint_rate_hz=2)
    assert (tmp_path / INDEX).read_text() == text


def test_a_tolerance_that_no_mission_keeps_is_a_limit_of_missions_only(hop: Plan, tmp_path: Path) -> None:
    mission = hop.scenario.mission.model_copy(update={"tolerance_m": 0.0005})
    fine = replace(hop, scenario=hop.scenario.model_copy(update={"mission": mission}))
    export(fine, tmp_path / "stream", formats=["setpoints"], setpoint_rate_hz=2)
    assert len(contents(tmp_path / "stream")) >= 2


@pytest.mark.slow
def test_a_limit_of_missions_does_not_keep_other_files_from_being_written(
    hop: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    row = Autopilot.ARDUPILOT.traits
    few = replace(row, missions=replace(row.missions, items_max=3))
    monkeypatch.setitem(TRAITS, Autopilot.ARDUPILOT, few)
    for name, formats in (("stream", ["setpoints"]), ("map", ["history", "kml"])):
        export(hop, tmp_path / name, formats=formats, setpoint_rate_hz=2)
        assert len(contents(tmp_path / name)) >= 2
    for name, formats in (("default", None), ("mixed", ["plan", "setpoints"])):
        index = export(hop, tmp_path / name, formats=formats, setpoint_rate_hz=2)
        assert "ArduCopter stores at most 3" in index.refused
        assert {Path(file).suffix for file in index.sha256} == {".setpoints"}
    with pytest.raises(NotWritten, match="ArduCopter stores at most 3"):
        export(hop, tmp_path / "missions", formats=["plan", "waypoints"])
    assert not (tmp_path / "missions").exists()
