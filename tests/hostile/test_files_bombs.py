"""Files made by somebody who wishes it ill: tracks that were changed, and small files that unpack to gigabytes.

A reader is given one gigabyte of address space, in a process of its own. It refuses the file within that.
"""

from __future__ import annotations

import base64
import hashlib
import io
import json
import random
import shutil
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs.cli.main import run
from gcs.errors import FileFormatError, VerificationError
from gcs.plan.plan_file import ARRAYS, load_plan, read_plan
from gcs.plan.trajectory.plan import Plan

GIB = 1024**3
LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, ({limit}, {limit}))
from gcs.cli.main import run
sys.exit(run(sys.argv[1:]))
"""
LIMIT = 4 * GIB  # of addresses: the libraries alone take two


def resealed(path: Path, meta_changes: dict[str, Any] | None = None, **changes: Any) -> None:
    """The plan file with other arrays or keys, and a new checksum over them, as its writer would make it."""
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files if name != "checksum"}
    meta = json.loads(arrays["meta"].tobytes()) | (meta_changes or {})
    arrays |= {"meta": np.frombuffer(json.dumps(meta).encode(), dtype=np.uint8), **changes}
    digest = hashlib.sha256()
    for name in sorted(arrays):
        digest.update(name.encode() + np.ascontiguousarray(arrays[name]).tobytes())
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays, checksum=np.frombuffer(digest.digest(), dtype=np.uint8))
    path.write_bytes(buffer.getvalue())


@pytest.fixture
def forged(hop_file: Path, hop: Plan, tmp_path: Path) -> Path:
    """The plan with its second vehicle 0.25 m beside the first, a new checksum, and its old verdict."""
    path = tmp_path / "forged.skein"
    path.write_bytes(hop_file.read_bytes())
    tables = hop.shape.basis_ned_m.copy()
    tables[:, 1] = tables[:, 0]
    tables[0, 1, 0] += 0.25
    resealed(path, shape_tables_ned_m=tables)
    return path


def test_a_plan_with_changed_tracks_and_a_new_checksum_reaches_no_file_and_no_vehicle(
    forged: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, stored = read_plan(forged)
    assert stored.ok
    out = tmp_path / "out"
    for line in (
        ["export", str(forged), "--to", str(out)],
        ["upload", str(forged), "--link", "udpin:127.0.0.1:0"],
        ["diff", str(forged), "--link", "udpin:127.0.0.1:0"],
        ["fly", str(forged), "--sim", "--to", str(tmp_path / "flights")],
        ["verify", str(forged)],
    ):
        assert run(line) == 5, line
        said = capsys.readouterr()
        assert "the plan failed verification: separation" in said.err
        assert "its stored verdict is 'verified', but it fails verification now" in said.out
    assert not out.exists()
    assert not (tmp_path / "flights").exists()
    assert run(["show", str(forged), "--json"]) == 0
    said = capsys.readouterr()
    assert "verified" in json.loads(said.out)
    assert "NO" in json.loads(said.out)["verified"]
    assert "its stored verdict" in said.err


def test_the_api_believes_no_stored_verdict_either(forged: Path, tmp_path: Path) -> None:
    import gcs

    with pytest.warns(UserWarning, match="its stored verdict is 'verified'"):
        plan, report = gcs.load_plan(forged)
    assert not report.ok
    stored: Any = read_plan(forged)[1]
    for attempt in (
        lambda: gcs.export(plan, tmp_path / "out"),
        lambda: gcs.export(plan, tmp_path / "out", report=stored),
        lambda: gcs.fly(plan, to=tmp_path),
    ):
        with pytest.raises(VerificationError):
            attempt()
    assert list(tmp_path.iterdir()) == [forged]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"phases": [{"name": "landing", "start_s": -25.0, "end_s": 60.0}]}, "phases"),
        ({"phases": []}, "phases"),
        ({"begin_state": [0.0] * 12}, "phases"),
        ({"begin_state": [float("nan")] * 12}, "12 finite"),
        ({"objective": "cheap"}, "not a plan"),
        ({"timings_s": 3}, "not a plan"),
        ({"report": {}}, "not a plan"),
    ],
)
def test_a_plan_that_contradicts_its_scenario_is_refused(
    hop_file: Path, tmp_path: Path, change: dict[str, Any], reason: str
) -> None:
    """Phases of other names or times would evade the checks of their names."""
    path = tmp_path / "other.skein"
    path.write_bytes(hop_file.read_bytes())
    resealed(path, change)
    with pytest.raises(FileFormatError, match=reason):
        load_plan(path)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        pytest.param(name, value, marks=() if number % 4 == row % 4 else pytest.mark.slow)
        for row, name in enumerate(("joints_s", "state", "control", "shape_joints_s", "shape_functions"))
        for number, value in enumerate((np.nan, np.inf, -np.inf, 1e308))
    ],
)
def test_a_plan_with_a_number_that_is_none_is_refused(
    hop_file: Path, tmp_path: Path, name: str, value: float, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "nan.skein"
    path.write_bytes(hop_file.read_bytes())
    with np.load(path) as archive:
        values = archive[name]
    values.flat[values.size // 2] = value
    resealed(path, **{name: values})
    assert run(["export", str(path), "--to", str(tmp_path / "out"), "--json"]) in (5, 6)
    assert json.loads(capsys.readouterr().out)["error"]["kind"] in ("FileFormatError", "VerificationError")


def zeros(size: int) -> Any:
    """Chunks of so many zeros."""
    chunk = bytes(1 << 20)
    for _ in range(size // len(chunk)):
        yield chunk


def bomb(path: Path, name: str, head: bytes, size: int) -> Path:
    """An archive with one member of `head` and zeros, packed a thousand times smaller."""
    archive = zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1)
    with archive, archive.open(name, "w", force_zip64=True) as file:
        file.write(head)
        for chunk in zeros(size):
            file.write(chunk)
    return path


def npy_head(shape: tuple[int, ...], dtype: str = "<f8") -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(buffer, {"descr": dtype, "fortran_order": False, "shape": shape})
    return buffer.getvalue()


def limited(*arguments: str) -> subprocess.CompletedProcess[str]:
    """The command in a process that has little memory."""
    return subprocess.run(
        [sys.executable, "-c", LIMITED.format(limit=LIMIT), *arguments],
        capture_output=True,
        text=True,
        timeout=600.0,
        check=False,
        env=None,
    )


def test_two_megabytes_of_packed_zeros_are_no_plan(tmp_path: Path) -> None:
    path = tmp_path / "bomb.skein"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, kind in ARRAYS.items():
            archive.writestr(f"{name}.npy", npy_head((0,) * kind.dimensions, kind.dtype))
    claimed(path, "meta.npy", 2 * GIB)
    done = limited("show", str(path))
    assert done.returncode == 6, done.stderr
    assert "unpacks to 2048 MiB; the limit is 32" in done.stderr


def test_parquet_of_many_rows_that_packs_well_is_refused() -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    from gcs.mission.formats.tables.setpoints_parquet import read_setpoints_parquet

    buffer = io.BytesIO()
    pq.write_table(pa.table({"t_s": np.zeros(5_000_000)}), buffer, compression="zstd")
    assert len(buffer.getvalue()) < 100_000
    with pytest.raises(FileFormatError, match=r"5,000,000 rows; the limit is 4,000,000"):
        read_setpoints_parquet(buffer.getvalue(), "rows.parquet")


def claimed(path: Path, name: str, size: int) -> None:
    """Make the directory of an archive say that a member unpacks to `size`, as that of a real bomb does."""
    data = bytearray(path.read_bytes())
    at = data.rindex(name.encode()) - 46
    assert data[at : at + 4] == b"PK\x01\x02"
    data[at + 24 : at + 28] = size.to_bytes(4, "little")
    path.write_bytes(bytes(data))


@pytest.mark.long
def test_an_archive_that_unpacks_to_gigabytes_is_refused_at_once(tmp_path: Path) -> None:
    path = bomb(tmp_path / "bomb.skein", "state.npy", npy_head((GIB // 4 // 12, 1, 12)), 2 * GIB)
    assert path.stat().st_size < 10_000_000
    assert limited("show", str(path)).returncode == 6


def test_an_array_whose_header_promises_more_than_is_there_is_refused(hop_file: Path, tmp_path: Path) -> None:
    path = tmp_path / "header.skein"
    with zipfile.ZipFile(hop_file) as old, zipfile.ZipFile(path, "w") as new:
        for info in old.infolist():
            data = old.read(info)
            new.writestr(info.filename, npy_head((2**30, 1, 12)) if info.filename == "state.npy" else data)
    with pytest.raises(FileFormatError, match=r"needs 9\.83e\+04 MiB, and 0 bytes are there"):
        read_plan(path)


def test_an_archive_of_many_members_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "many.skein"
    with zipfile.ZipFile(path, "w") as archive:
        for n in range(3000):
            archive.writestr(f"{n}.npy", b"")
    with pytest.raises(FileFormatError, match="announces 3000 members; the limit is 64"):
        read_plan(path)


def test_an_array_of_python_objects_is_not_unpickled(hop_file: Path, tmp_path: Path) -> None:
    path = tmp_path / "objects.skein"
    path.write_bytes(hop_file.read_bytes())
    resealed(path, state=np.zeros((6, 3, 12), dtype=np.float32))
    with pytest.raises(FileFormatError, match="state is float32 with 3 dimensions, not float64"):
        read_plan(path)


def test_relief_that_unpacks_to_gigabytes_is_refused(tmp_path: Path, hop: Plan) -> None:
    from gcs.scenario.schema.heightmap import Relief

    heights = base64.b64encode(zlib.compress(bytes(100_000_000), 9)).decode()
    polynomial = (0.0,) * 10
    known: dict[str, Any] = {
        "centre_m": (0.0, 0.0),
        "reach_m": 1.0,
        "row": polynomial,
        "column": polynomial,
        "spacing_m": 1.0,
        "north_m": (0.0, 1.0),
        "east_m": (0.0, 1.0),
        "heights": heights,
    }
    with pytest.raises(ValueError, match="more than 40,000 bytes"):
        Relief(rows=100, columns=100, **known)
    with pytest.raises(ValueError, match="the limit is 4,000,000"):
        Relief(rows=100_000, columns=100_000, **known)


@pytest.mark.parametrize(
    ("name", "text", "command", "code"),
    [
        ("a.toml", "a = " + "[" * 5000, "show", 3),
        ("b.toml", "a = " + "9" * 5000, "show", 3),
        ("c.toml", ".".join("a" * 200_000) + " = 1", "show", 3),
        ("d.toml", "#" * 2_000_000, "show", 3),
        ("e.json", "[" * 100_000, "show", 3),
        ("f.json", "[1]", "show", 3),
        ("g.json", '{"a": NaN}', "show", 3),
        ("h.json", "9" * 5000, "show", 3),
        ("i.plan", "[" * 100_000, "check", 6),
        ("j.plan", "[" + "1," * 2_000_000 + "1]", "check", 6),
        ("k.plan", '{"fileType": "Plan", "version": 1, "mission": {"items": [' + "1," * 50_000 + "1]}}", "check", 6),
        ("l.waypoints", "QGC WPL 110\n" + "1\t" * 100_000, "check", 6),
        ("m.plan", " " * 17_000_000, "check", 6),
        ("n.json", '{"format": "skein-upload", "parameters": [{"type": 1e400}]}', "restore", 6),
        ("o.tlog", "\xfe" * 2_000_000, "replay", 6),
        ("p.tlog", "\0" * 20_000_000, "replay", 6),
    ],
)
def test_text_made_to_take_memory_or_time_is_refused(
    tmp_path: Path, name: str, text: str, command: str, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    path.write_bytes(text.encode("latin-1"))
    assert run([command, str(path)]) == code
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert len(said) < 2000


def test_a_drawing_of_billions_of_laughs_or_of_gigabytes_is_refused(tmp_path: Path) -> None:
    from gcs.mission.drawings.route_formats import read_drawing

    laughs = "".join(f'<!ENTITY l{n} "{f"&l{n - 1};" * 10}">' for n in range(1, 20))
    path = tmp_path / "laughs.kml"
    path.write_text(f"<!DOCTYPE x [{laughs}]><x>&l19;</x>")
    with pytest.raises(FileFormatError, match="document type or entities"):
        read_drawing(path)
    path = tmp_path / "bomb.kmz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.kml", "<x/>")
    claimed(path, "doc.kml", 2 * GIB)
    with pytest.raises(FileFormatError, match="unpacks to 2048 MiB; the limit is 64"):
        read_drawing(path)


def test_true_states_are_checked_before_they_are_read(tmp_path: Path) -> None:
    from gcs.flight.assessment.judge import load_truth

    path = tmp_path / "truth.npz"
    np.savez_compressed(path, t_s=np.zeros(3))
    with pytest.raises(FileFormatError, match="is packed"):
        load_truth(path)
    np.savez(path, t_s=np.zeros(3), other=np.zeros(3))
    with pytest.raises(FileFormatError, match="unknown member 'other"):
        load_truth(path)


def test_a_raster_of_one_enormous_block_is_refused(tmp_path: Path) -> None:
    import rasterio
    from rasterio.transform import from_origin

    from gcs.frames import Origin
    from gcs.scenario.environment.dem import DemError, read_dem
    from gcs.scenario.schema.heightmap import Region

    path = tmp_path / "huge.tif"
    profile = {"driver": "GTiff", "height": 60_000, "width": 60_000, "count": 1, "dtype": "float64", "crs": "EPSG:4326"}
    with rasterio.open(
        path,
        "w",
        **profile,
        transform=from_origin(8.0, 47.5, 1e-5, 1e-5),
        tiled=True,
        blockxsize=16_384,
        blockysize=16_384,
        compress="deflate",
        sparse_ok=True,
    ):
        pass
    assert path.stat().st_size < 1_000_000
    with pytest.raises(DemError, match=r"blocks of 16,384 times 16,384 pixels, 2048 MiB each; the limit is 256 MiB"):
        read_dem(path, Origin(47.2, 8.3, 400.0), Region((-10.0, 10.0), (-10.0, 10.0)))


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_mutated_files_never_reach_a_bug(
    hop_file: Path, tmp_path: Path, repo_root: Path, seed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    mutations(hop_file, tmp_path, repo_root, seed, 5, capsys)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(2, 12))
def test_many_mutated_files_never_reach_a_bug(
    hop_file: Path, tmp_path: Path, repo_root: Path, seed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    mutations(hop_file, tmp_path, repo_root, seed, 150, capsys)


def mutations(
    hop_file: Path, folder: Path, repo_root: Path, seed: int, rounds: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every kind of file, changed at random places, given to a command that reads it."""
    expected = repo_root / "missions" / "simulation1" / "expected"
    good = {
        "a.plan": (expected / "uav1.plan", ["check"]),
        "b.waypoints": (expected / "uav1.waypoints", ["check"]),
        "c.toml": (repo_root / "missions" / "ridge" / "scenario.toml", ["show"]),
        "d.skein": (hop_file, ["verify"]),
        "ridge.tif": (repo_root / "missions" / "ridge" / "ridge.tif", ["show", "c.toml"]),
    }
    dice = random.Random(seed)
    for _ in range(rounds):
        for name, (source, command) in good.items():
            path = folder / name
            path.write_bytes(mutated(source.read_bytes(), dice))
            line = [*command, str(path)] if len(command) == 1 else [command[0], str(folder / command[1])]
            if len(command) > 1:
                (folder / command[1]).write_bytes((repo_root / "missions/ridge/scenario.toml").read_bytes())
            code = run([*line, "--json"])
            said = capsys.readouterr()
            assert code in (0, 2, 3, 5, 6, 11), (seed, name, said.out[:500])
            json.loads(said.out)


def mutated(data: bytes, dice: random.Random) -> bytes:
    """The data with bytes flipped, cut, inserted, swapped, or numbers made larger."""
    changed = bytearray(data)
    for _ in range(dice.randint(1, 4)):
        at = dice.randrange(len(changed))
        match dice.randrange(6):
            case 0:
                changed[at] ^= 1 << dice.randrange(8)
            case 1:
                del changed[at : at + dice.randint(1, 50)]
            case 2:
                changed[at:at] = dice.randbytes(dice.randint(1, 20))
            case 3:
                other = dice.randrange(len(changed))
                changed[at], changed[other] = changed[other], changed[at]
            case 4:
                digits = [n for n, byte in enumerate(changed) if 48 <= byte <= 57]
                changed[dice.choice(digits or [at])] = dice.choice(b"0123456789-.e")
            case _:
                value = dice.choice((b"nan", b"-1", b"1e308", b"1e400", b"999999999999", b"null", b"{}", b'"x"'))
                changed[at : at + 3] = value
        if not changed:
            return b""
    return bytes(changed)


def test_attach_resumes_no_changed_plan_and_still_brings_its_vehicles_down(
    forged: Path, hop: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from gcs.cli.flights.attach_view import AttachRequest, _plan_of
    from gcs.cli.shared.console import Screen
    from gcs.errors import FlightError
    from gcs.flight.execution.resume import Resume
    from gcs.flight.recording.flight_state import read_flight_state

    folder = tmp_path / "flight"
    folder.mkdir()
    link = "udpin:127.0.0.1:14550"
    state = {"format": "skein-flight-1", "mission": "hop", "plan_hash": read_plan(forged)[0].hash, "links": [link]}
    state |= {"systems": {}, "mode": "stream", "follow": False, "step": "flying", "t0_unix_s": 1e9, "pid": 4}
    (folder / "flight.json").write_text(json.dumps(state))
    shutil.copy(forged, folder / "plan.skein")

    def plan_to(what: Resume) -> Plan:
        return _plan_of(AttachRequest(folder, what, (), None, Screen()), read_flight_state(folder), [link])

    with pytest.raises(VerificationError, match="separation"):
        plan_to(Resume.RESUME)
    assert plan_to(Resume.RETURN).sysids == hop.sysids
    assert "WARNING: the plan failed verification" in capsys.readouterr().out
    assert plan_to(Resume.LAND).sysids == hop.sysids
    (folder / "flight.json").write_text(json.dumps(state | {"plan_hash": hop.hash}))
    assert plan_to(Resume.LAND).sysids == hop.sysids
    assert "is not the plan of this flight" in capsys.readouterr().out
    with pytest.raises(FlightError, match="is not the plan of this flight"):
        plan_to(Resume.RESUME)
    (folder / "plan.skein").write_bytes(b"damaged")
    with pytest.raises(FileFormatError) as caught:
        plan_to(Resume.LAND)
    assert f"gcs tell land --link {link}" in caught.value.hint
