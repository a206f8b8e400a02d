"""Files made by somebody who wishes it ill: tracks that were changed, and small files that unpack to gigabytes.

A reader is given one gigabyte of address space, in a process of its own. It refuses the file within that.
"""

from __future__ import annotations

import hashlib
import io
import json
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs.cli.main import run
from gcs.errors import FileFormatError, VerificationError
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.plan_file import load_plan, read_plan

GIB = 1024**3
LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, ({limit}, {limit}))
from gcs.cli.main import run
sys.exit(run(sys.argv[1:]))
"""
READER = """
import resource, sys
from pathlib import Path
{prepare}
resource.setrlimit(resource.RLIMIT_AS, ({limit}, {limit}))
from gcs.errors import GcsError
try:
    {call}
except GcsError as error:
    print(error.message)
    sys.exit(error.exit_code)
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


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e308])
@pytest.mark.parametrize("name", ["joints_s", "state", "control", "shape_joints_s", "shape_functions"])
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
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive, archive.open(name, "w") as file:
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
        timeout=120.0,
        check=False,
        env=None,
    )


def test_an_archive_of_zeros_is_no_plan(tmp_path: Path) -> None:
    path = bomb(tmp_path / "bomb.skein", "state.npy", npy_head((GIB // 16 // 12, 12)), GIB // 2)
    assert path.stat().st_size < 4_000_000
    done = limited("show", str(path))
    assert done.returncode == 6, done.stderr
    assert "unpacks to 512 MiB; the limit is 32" in done.stderr or "has no array" in done.stderr
