"""Collisions hidden between the samples of files of every format: the proof of what was read finds them."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import gcs
from gcs.mission.formats.tables.setpoint_table import StreamFile, write_setpoints
from gcs.mission.formats.vehicle_curve import cubic
from gcs.mission.model import SetpointStream
from gcs.types import Array
from tests.unit.mission.proving.test_prove import check_of, near_pass, smallest_m

NAMES = ("1", "2", "3")
Written = Callable[[Path, Array, Array, Array], list[Path]]  # folder, times, places and velocities (V, N, 3)


def samples(folder: Path, t_s: Array, *motion: Array) -> list[Path]:
    columns = ["north", "east", "down", "vn", "ve", "vd"][: 3 * len(motion)]
    lines = [",".join(["t", "vehicle", *columns])]
    for row, name in enumerate(NAMES):
        for number, at_s in enumerate(t_s.tolist()):
            values = [repr(value) for part in motion for value in part[row, number].tolist()]
            lines.append(",".join([repr(at_s), name, *values]))
    file = folder / "fleet.csv"
    file.write_text("\n".join(lines))
    return [file]


def lines_between(folder: Path, t_s: Array, places: Array, _: Array) -> list[Path]:
    return samples(folder, t_s, places)


def pieces(folder: Path, t_s: Array, places: Array, velocities: Array) -> list[Path]:
    length_s, files = np.diff(t_s), []
    for row, name in enumerate(NAMES):
        c = cubic(length_s, places[row], velocities[row])[..., [1, 0, 2]] * [1.0, 1.0, -1.0]  # (4, N, east north up)
        table = np.zeros((len(length_s), 33))
        table[:, 0] = length_s
        for axis in range(3):
            table[:, 1 + 8 * axis : 5 + 8 * axis] = c[..., axis].T
        files.append(folder / f"{name}.csv")
        np.savetxt(files[-1], table, delimiter=",", fmt="%.17g")
    return files


def show(folder: Path, t_s: Array, places: Array, velocities: Array) -> list[Path]:
    third_s, drones = np.diff(t_s)[:, None] / 3.0, []
    for row, name in enumerate(NAMES):
        place, velocity = places[row] * [1.0, -1.0, -1.0], velocities[row] * [1.0, -1.0, -1.0]
        inner = np.stack([place[:-1] + third_s * velocity[:-1], place[1:] - third_s * velocity[1:]], axis=1)
        curves = [[], *inner.tolist()]
        points = [[at, where, curve] for at, where, curve in zip(t_s.tolist(), place.tolist(), curves, strict=True)]
        drones.append({"settings": {"name": name, "trajectory": {"version": 1, "points": points}}})
    file = folder / "show.skyc"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("show.json", json.dumps({"version": 1, "swarm": {"drones": drones}}))
    return [file]


def setpoints(folder: Path, t_s: Array, places: Array, velocities: Array) -> list[Path]:
    still = np.zeros_like(places)
    stream = SetpointStream((1, 2, 3), t_s, places, velocities, still, still[..., 0])
    file = folder / "fleet.setpoints"
    file.write_bytes(write_setpoints(StreamFile(stream)))
    return [file]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("write", [lines_between, samples, pieces, show, setpoints])
def test_a_collision_between_the_samples_of_a_file_is_found(tmp_path: Path, write: Written, seed: int) -> None:
    """Of 1 mm to 10 cm for 1 to 40 ms."""
    rng = np.random.default_rng(seed)
    limit_m, beyond_m = rng.uniform(0.3, 1.5), 10.0 ** rng.uniform(-3.0, -1.0)
    t_s, places_m = near_pass(rng, limit_m, beyond_m, rng.uniform(1e-3, 40e-3))
    assert smallest_m(t_s, places_m, t_s).min() > limit_m  # no sample shows it
    # What all do together does not change their distances.
    velocities = rng.normal(0.0, 3.0, (len(t_s), 3)) + np.gradient(places_m - places_m[0], t_s, axis=1)
    read = gcs.read_tracks(write(tmp_path, t_s, places_m, velocities))
    found = check_of(gcs.prove(read.tracks, gcs.TrackLimits(limit_m)), "separation")
    assert (found.verdict, set(found.vehicles)) == ("violated", {"1", "3"})
    assert limit_m - beyond_m - 1e-5 <= found.seen < limit_m - 0.8e-3
    assert smallest_m(t_s, places_m, np.array([found.t_s]))[0] == pytest.approx(found.seen, abs=1e-5)
    just = gcs.prove(read.tracks, gcs.TrackLimits(limit_m - beyond_m - 1.5e-3))
    assert check_of(just, "separation").verdict == "proved"
