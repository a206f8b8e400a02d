"""Shows of Skybrush: the curves that are flown, what is left out, and what is refused by vehicle and point."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import BPoly

import gcs
from gcs.errors import FileFormatError

LINE = [[0, [0, 0, 0]], [2.0, [1, 0, 3], []]]


def show(trajectories: dict[str, Any], **more: Any) -> bytes:
    """An archive with these trajectories by the name of the vehicle; `more` replaces members by their path."""
    drones = [
        {"settings": {"name": name, "trajectory": {"$ref": f"./drones/{name.replace(' ', '%20')}/trajectory.json#"}}}
        for name in trajectories
    ]
    members: dict[str, Any] = {
        "show.json": {"version": 1, "swarm": {"drones": drones}},
        **{f"drones/{name}/trajectory.json": values for name, values in trajectories.items()},
        **more,
    }
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, value in members.items():
            if value is not None:
                archive.writestr(path, value if isinstance(value, bytes | str) else json.dumps(value))
    return data.getvalue()


def read(folder: Path, data: bytes, **more: Any) -> gcs.ReadTracks:
    file = folder / "parade.skyc"
    file.write_bytes(data)
    return gcs.read_tracks([file], **more)


@pytest.mark.parametrize("seed", range(5))
def test_curves_of_every_degree_are_those_of_bernstein(tmp_path: Path, seed: int) -> None:
    """Evaluated apart: every curve by scipy's Bernstein polynomials; north, west, up unless the caller says more."""
    rng = np.random.default_rng(seed)
    degrees = rng.choice([1, 2, 3, 5, 7], 6)
    t_s = np.concatenate([[0.0], np.cumsum(rng.uniform(0.3, 4.0, 6))])
    ends = rng.uniform(-50.0, 50.0, (7, 3))
    inner = [rng.uniform(-50.0, 50.0, (degree - 1, 3)) for degree in degrees]
    points = [[0.0, ends[0].tolist(), []]]
    points += [[t, end.tolist(), between.tolist()] for t, end, between in zip(t_s[1:], ends[1:], inner, strict=True)]
    made = read(tmp_path, show({"Drone 1": {"version": 1, "points": points}}))
    (track,) = made.tracks
    assert track.name == "Drone 1"
    for piece, between in enumerate(inner):
        at_s = np.linspace(t_s[piece], t_s[piece + 1], 7)[:-1]
        curve = BPoly(np.array([ends[piece], *between, ends[piece + 1]])[:, None], t_s[piece : piece + 2])
        np.testing.assert_allclose(track.position_ned_m(at_s), curve(at_s) * [1.0, -1.0, -1.0], atol=1e-9)
    other = read(tmp_path, show({"Drone 1": {"version": 1, "points": points}}), frame="enu").tracks[0]
    np.testing.assert_allclose(other.position_ned_m(1.0), track.position_ned_m(1.0)[[1, 0, 2]] * [-1.0, 1.0, 1.0])


def test_a_meeting_between_two_points_is_found(tmp_path: Path) -> None:
    """Two arcs that touch at 1 s; at their points the vehicles are 8 m apart and more."""
    up = [[0, [0, 0, 10], []], [2, [8, 0, 10], [[0, 8, 10], [8, 8, 10]]]]
    down = [[0, [0, 12, 10], []], [2, [8, 12, 10], [[0, 4, 10], [8, 4, 10]]]]
    made = read(tmp_path, show({"a": {"points": up}, "b": {"points": down}}))
    report = gcs.prove(made.tracks, gcs.TrackLimits(0.5))
    (near,) = report.failures
    assert near.name == "separation"
    assert near.seen < 0.01
    assert near.t_s == pytest.approx(1.0, abs=0.05)


def test_what_is_no_track_is_left_out_and_named(tmp_path: Path) -> None:
    points = [[0, [0, 0, 0, 10], []], [2, [1, 0, 3, 90], []]]
    data = show({"a": {"points": points}}, **{"cues.json": {"items": []}, "drones/a/lights.json": {"data": "B4wl"}})
    assert read(tmp_path, data).account[0].endswith("skyc, a; left out: cues, lights, yaw")


def test_vehicles_without_names_of_their_own_are_numbered(tmp_path: Path) -> None:
    drone = {"settings": {"name": "same", "trajectory": {"points": LINE}}}
    data = show({}, **{"show.json": {"swarm": {"drones": [drone, drone]}}})
    assert [track.name for track in read(tmp_path, data).tracks] == ["drone 1", "drone 2"]


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"PK\3\4 no archive", r"parade\.skyc: its content is no archive"),
        (show({}, **{"show.json": None, "a.json": {}}), r"holds no show\.json"),
        (show({}), r"no list swarm\.drones"),
        (show({"a": LINE}, **{"show.json": "{"}), r"show\.json"),
        (show({"a": None}), r"parade\.skyc, a: the archive has no drones/a/trajectory\.json"),
        (show({"a": {"points": LINE[:1]}}), "a: its trajectory has no two points"),
        (show({"a": {"points": [*LINE, [2.0, [0, 0, 0], []]]}}), "a, point 3: the time goes from 2 s to 2 s"),
        (show({"a": {"points": [*LINE, [3.0, [0, 0], []]]}}), "a, point 3: a time or a place"),
        (show({"a": {"points": [*LINE, [3.0, [0, 0, True], []]]}}), "a, point 3: a time or a place"),
        (show({"a": {"points": [*LINE, [3.0, [0, 0, 1], [[1, 2]]]]}}), "a, point 3: a time or a place"),
        (show({"a": {"points": [*LINE, [3.0, [0, 0, 1], [[0, 0, 0]] * 15]]}}), "a, point 3: its control points"),
        (show({"a": {"points": [*LINE, 7]}}), "a, point 3: it is not"),
        (show({"a": {"points": LINE, "takeoffTime": 2}, "b": {"points": LINE}}), "different takeoffTime"),
        (show({"a": {"points": LINE, "takeoffTime": [2]}}), "a, takeoffTime: a time or a place"),
        (show({"a": {"points": [*LINE, [3.0, [10**400, 0, 0], []]]}}), "a, point 3: a time or a place"),
    ],
)
def test_what_is_wrong_is_refused_with_its_place(tmp_path: Path, data: bytes, words: str) -> None:
    with pytest.raises(FileFormatError, match=words):
        read(tmp_path, data)


def test_an_archive_that_unpacks_to_gigabytes_is_refused(tmp_path: Path) -> None:
    bomb = show({"a": b"[" + b" " * (65 * 1024 * 1024) + b"]"})
    assert len(bomb) < 1_000_000
    with pytest.raises(FileFormatError, match="unpacks to 65 MiB; the limit is 64 MiB"):
        read(tmp_path, bomb)


@pytest.mark.parametrize("seed", range(30))
def test_a_damaged_show_is_read_or_refused(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    data = bytearray(show({"a": {"points": LINE}, "b": {"points": LINE}}))
    for _ in range(int(rng.integers(1, 6))):
        data[int(rng.integers(4, len(data)))] = int(rng.integers(256))
    try:
        read(tmp_path, bytes(data))
    except FileFormatError as error:
        assert "parade.skyc" in str(error)
