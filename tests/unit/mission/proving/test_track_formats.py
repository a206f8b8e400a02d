"""Files of trajectories: frames and units, the polynomials that are flown, and what is refused by line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gcs
from gcs.errors import FileFormatError, GcsError, UsageError
from gcs.mission.formats.tables.setpoint_table import StreamFile, write_setpoints
from gcs.mission.model import SetpointStream
from gcs.scenario.values.si import local_origin

PLACES = [[1.0, 2.0, -3.0], [2.0, 4.0, -3.5]]  # NED, at 0 s and 2 s
PIECE = "1.5,1,2,0,0,0,0,0,0,3,0,-1,0,0,0,0,0,4,0,0,0.5,0,0,0,0,0,0,0,0,0,0,0,0"
NEXT = "0.5,4,0,0,0,0,0,0,0,0.75,0,0,0,0,0,0,0,5.6875,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0"
HEADER = "Duration," + ",".join(f"{axis}^{power}" for axis in ("x", "y", "z", "yaw") for power in range(8))


def written(folder: Path, text: str, name: str = "cf1.csv") -> Path:
    file = folder / name
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("text", "frame"),
    [
        ("t,north,east,down\n0,1,2,-3\n2,2,4,-3.5\n", None),
        ("t_s,east_m,north_m,up_m\n0,2,1,3\n2,4,2,3.5\n", None),
        ("time [msec];x [m];y [m];z [m]\n0;2;1;3\n2000;4;2;3.5\n", "enu"),
        ("t,x,y,z\n0,1,2,-3\n\n# a remark\n2,2,4,-3.5\n", "ned"),
        ("# t,x_cm,y_cm,z_cm,red\n0,100,200,-300,9\n2,200,400,-350,9\n", "ned"),
    ],
)
def test_samples_say_their_frame_and_units(tmp_path: Path, text: str, frame: str | None) -> None:
    read = gcs.read_tracks([written(tmp_path, text)], frame=frame)
    (track,) = read.tracks
    assert track.name == "cf1"
    np.testing.assert_allclose(track.position_ned_m([0.0, 1.0, 2.0]), [PLACES[0], [1.5, 3.0, -3.25], PLACES[1]])
    assert read.account[0].endswith("left out: red") == ("red" in text)


def test_velocities_make_cubics(tmp_path: Path) -> None:
    """Those of t^3 and t^2: two samples are enough to know them everywhere."""
    rows = "".join(f"{t},{t**3},{t**2},{-t},{3 * t**2},{2 * t},-1\n" for t in (0, 1, 3))
    file = written(tmp_path, f"t,north,east,down,vn,ve,vd\n{rows}")
    (track,) = gcs.read_tracks([file]).tracks
    t_s = np.linspace(0.0, 3.0, 13)
    np.testing.assert_allclose(track.position_ned_m(t_s), np.stack([t_s**3, t_s**2, -t_s], axis=1), atol=1e-12)
    assert track.accelerates


def test_one_file_holds_a_fleet(tmp_path: Path) -> None:
    file = written(
        tmp_path, "vehicle,t,x,y,z,vx,vy,vz\na,0,0,0,1,1,0,0\nb,0,5,0,1,0,0,0\na,1,1,0,1,1,0,0\nb,2,5,0,1,0,0,0\n"
    )
    read = gcs.read_tracks([file], frame="enu")
    assert [track.name for track in read.tracks] == ["a", "b"]
    np.testing.assert_allclose(read.tracks[0].position_ned_m(0.5), [0.0, 0.5, -1.0], atol=1e-12)


@pytest.mark.parametrize(
    "column", ["drone_id", "Vehicle ID", "uav_name", "sys_id", "robot", "cf", "agent-no", "DroneIndex", "vehicle.nr"]
)
def test_a_column_that_tells_vehicles_apart_is_known_by_many_names(tmp_path: Path, column: str) -> None:
    """Taken for one vehicle that jumps to and fro, it would be proved that this one keeps its height."""
    rows = "0,0,0,1,7\n0.1,5,0,1,8\n1,0,0,1,7\n1.1,5,0,1,8\n"
    read = gcs.read_tracks([written(tmp_path, f"t,x,y,z,{column}\n{rows}")], frame="enu")
    assert [track.name for track in read.tracks] == ["7", "8"]


def test_setpoints_of_different_origins_are_not_proved_together(tmp_path: Path, simulation1: gcs.Scenario) -> None:
    stream = SetpointStream((1,), np.array([0.0, 1.0]), *np.zeros((3, 1, 2, 3)), np.zeros((1, 2)))
    here = local_origin(simulation1)
    north = replace(here, lat_deg=here.lat_deg + 1e-5)
    files = [tmp_path / "one.setpoints", tmp_path / "two.setpoints"]
    for file, sysid, origin in zip(files, (1, 2), (here, north), strict=True):
        file.write_bytes(write_setpoints(StreamFile(replace(stream, sysids=(sysid,)), "", origin)))
    with pytest.raises(FileFormatError, match=r"two\.setpoints: its places .* 1\.11 m from that of .*one\.setpoints"):
        gcs.read_tracks(files)
    with pytest.raises(FileFormatError, match=r"two\.setpoints: .* from that of the scenario"):
        gcs.read_tracks(files[1:], scenario=simulation1)
    assert len(gcs.read_tracks(files[:1], scenario=simulation1).tracks) == 1


@pytest.mark.parametrize("header", ["", HEADER + "\n", "# " + HEADER.lower() + ",\n"])
def test_pieces_of_crazyswarm(tmp_path: Path, header: str) -> None:
    """x is east, y north and z up."""
    read = gcs.read_tracks([written(tmp_path, f"{header}{PIECE},\n{NEXT}\n")])
    (track,) = read.tracks
    np.testing.assert_allclose(track.position_ned_m(1.0), [2.0, 3.0, -4.5])
    np.testing.assert_allclose(track.position_ned_m(1.75), [0.75, 4.0, -5.6875])
    assert track.position_ned_m.x.tolist() == [0.0, 1.5, 2.0]
    assert gcs.prove(read.tracks).ok
    assert "left out" not in read.account[0]
    turned = gcs.read_tracks([written(tmp_path, f"{PIECE[:-1]}1\n")])
    assert turned.account[0].endswith("left out: yaw")


def test_a_gap_between_two_pieces_is_told(tmp_path: Path) -> None:
    read = gcs.read_tracks([written(tmp_path, f"{PIECE}\n{NEXT.replace('0.75', '0.70')}\n")])
    (step,) = gcs.prove(read.tracks).failures
    assert (step.name, step.t_s, step.vehicles) == ("step of the place at a joint", 1.5, ("cf1",))
    assert step.seen == pytest.approx(0.05)


def test_setpoints_of_skein_are_within_their_plan(repo_root: Path) -> None:
    folder = repo_root / "missions" / "simulation1"
    read = gcs.read_tracks(sorted((folder / "expected").glob("*.setpoints")))
    assert [track.name for track in read.tracks] == ["1", "2", "3", "4", "5", "6"]
    report = gcs.prove(read.tracks, None, gcs.load_scenario(folder))
    assert report.ok, report
    assert {"separation", "clearance above the ground", "greatest height"} <= {c.name for c in report.checks}


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("t,x,y,z\n0,1,2,3\n1,1,2\n", 3, "3 columns, not 4"),
        ("t,x,y,z\n0,1,2,3\n1,1,nan,3\n", 3, "y must be a finite number, got 'nan'"),
        ("t,x,y,z\n0,1,2,3\n\n1,1,up,3\n", 4, "got 'up'"),
        ("t,x,y,z\n0,1,2,3\n1,1,1,3\n1,1,1,3\n", 4, "the time of cf1 goes from 1 s to 1 s"),
        ("t,x,y,z\n0,1,2,3\n", 2, "one sample only"),
        ("t,x,y\n0,1,2\n", 1, "a place in three axes"),
        ("x,y,z\n0,1,2\n", 1, "the time"),
        ("t,lat,lon,alt\n0,47,8,3\n", 1, "a place in three axes"),
        ("t,x,y,z,vx\n0,1,2,3,0\n", 1, "velocity is not given in all three"),
        ("t,x,y,z,up\n0,1,2,3,0\n", 1, "two columns hold the place"),
        ("t,x,y,down\n0,1,2,3\n", 1, "stand beside"),
        ("t,x [ft],y,z\n0,1,2,3\n", 1, "is in 'ft'"),
        ("id,t,x,y,z\n1,0,1,2,3\n1,1,1,2,3\n#2,0,1,2,3\n#2,1,1,2,3\n", 4, "begins with a hash"),
        (f"{PIECE}\n1,2,3\n", 2, "3 columns, not 33"),
        (f"{HEADER}\n{PIECE}\n-{PIECE}\n", 3, "duration is -1.5 s"),
        (f"{PIECE}\n{PIECE.replace('0.5', 'inf')}\n", 2, "column 21 must be a finite number"),
    ],
)
def test_a_malformed_file_is_refused_by_its_line(tmp_path: Path, text: str, line: int, words: str) -> None:
    with pytest.raises(FileFormatError) as refused:
        gcs.read_tracks([written(tmp_path, text)], frame="ned")
    assert f"cf1.csv, line {line}: " in refused.value.message
    assert words in refused.value.message
    assert refused.value.hint


@pytest.mark.parametrize("text", ["", "\n", "t,x,y,z\n", HEADER, "# Skein setpoints\nt_s\n", "\0\1", "1;2", "\ud800"])
def test_what_holds_no_track_is_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / "cf1.csv"
    file.write_bytes(text.encode("utf-8", errors="surrogatepass"))
    with pytest.raises(FileFormatError, match=r"cf1\.csv"):
        gcs.read_tracks([file], frame="ned")


def test_vehicles_whose_long_names_begin_alike_are_two(tmp_path: Path) -> None:
    rows = [f"{'long' * 20}{vehicle},{t},{10 * vehicle},0,0" for t, vehicle in ((0, 1), (1, 2), (2, 1), (3, 2))]
    read = gcs.read_tracks([written(tmp_path, "\n".join(["id,t,x,y,z", *rows, "# the end"]))], frame="ned")
    assert len(read.tracks) == 2


def test_x_y_z_without_a_frame_and_vehicles_twice_are_refused(tmp_path: Path) -> None:
    file = written(tmp_path, "t,x,y,z\n0,1,2,3\n1,2,2,3\n")
    with pytest.raises(FileFormatError, match="do not say their frame"):
        gcs.read_tracks([file])
    with pytest.raises(FileFormatError, match="another track cf1"):
        gcs.read_tracks([file, file], frame="enu")
    with pytest.raises(UsageError, match="frame xyz"):
        gcs.read_tracks([file], frame="xyz")


@pytest.mark.parametrize("seed", range(40))
def test_a_damaged_file_is_read_or_refused(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    text = bytearray(
        f"{HEADER}\n{PIECE}\n{NEXT}\n" if seed % 2 else "t,x,y,z,vx,vy,vz\n0,1,2,3,0,0,0\n1,2,2,3,0,0,0\n", "utf-8"
    )
    for _ in range(int(rng.integers(1, 6))):
        text[int(rng.integers(len(text)))] = int(rng.integers(256))
    file = tmp_path / "cf1.csv"
    file.write_bytes(text)
    try:
        gcs.prove(gcs.read_tracks([file], frame="ned").tracks, gcs.TrackLimits(1.0))
    except GcsError as refused:
        assert refused.message
