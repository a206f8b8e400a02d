"""Output that fails in every way a stream can: nothing is raised, and the exit code is right."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import IO

import pytest

from gcs.cli.shared.console import Screen
from gcs.cli.shared.safe_stdout import QUEUED_MAX, SafeStream

GCS = [sys.executable, "-c", "import sys; from gcs.cli.main import run; sys.exit(run())"]


def closed_pipe() -> IO[str]:
    read, write = os.pipe()
    os.close(read)
    return os.fdopen(write, "w")


def closed_stream() -> IO[str]:
    stream = io.StringIO()
    stream.close()
    return stream


def full_disk() -> IO[str]:
    return Path("/dev/full").open("w")


@pytest.mark.parametrize("open_it", [closed_pipe, full_disk, closed_stream])
def test_a_stream_that_fails_raises_nothing(open_it: Callable[[], IO[str]]) -> None:
    safe = SafeStream(open_it())
    for _ in range(3):
        assert safe.write("flying\n") == 7
        safe.flush()
    assert isinstance(safe.lost, OSError | ValueError)
    assert not safe.isatty()
    safe.end()


def test_without_a_stream_there_is_nothing_to_lose() -> None:
    safe = SafeStream(None)
    safe.write("flying\n")
    safe.flush()
    safe.end()
    assert safe.lost is None


def test_a_character_the_encoding_lacks_is_escaped() -> None:
    raw = io.BytesIO()
    safe = SafeStream(io.TextIOWrapper(raw, encoding="ascii"))
    safe.write("0 – 1\n")
    safe.flush()
    assert raw.getvalue() == b"0 \\u2013 1\n"


def test_a_terminal_that_stands_still_keeps_no_caller_waiting() -> None:
    read, write = os.pipe()
    safe = SafeStream(os.fdopen(write, "w"))
    lines = 2 * QUEUED_MAX // 100
    got = bytearray()

    def come_back() -> None:
        while data := os.read(read, 65_536):
            got.extend(data)

    with safe.without_waiting():
        for _ in range(lines):
            safe.write("x" * 99 + "\n")  # a direct write would wait after 64 kB
        assert isinstance(safe.lost, BlockingIOError)  # memory is bounded
        reader = threading.Thread(target=come_back)
        reader.start()
    safe.write("landed\n")
    safe.end()
    os.close(write)
    reader.join()
    os.close(read)
    assert got.endswith(b"x\nlanded\n")
    assert QUEUED_MAX - 200 <= len(got) < 100 * lines


def test_json_stays_valid_in_an_encoding_without_its_characters(monkeypatch: pytest.MonkeyPatch) -> None:
    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding="ascii"))
    Screen(json=True).result({"name": "ü", "file": "caf\udce9"})
    assert json.loads(raw.getvalue()) == {"ok": True, "name": "ü", "file": "caf\udce9"}


def gcs(*arguments: str, stdout: IO[str] | int) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run([*GCS, *arguments], stdout=stdout, stderr=subprocess.PIPE, check=False)


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("show", "no/such", "--json"), 3),
        (("nonsense", "--json"), 2),
        (("--help",), 1),
    ],
    ids=str,
)
def test_a_reader_that_has_gone_leaves_the_exit_code_and_no_traceback(arguments: tuple[str, ...], code: int) -> None:
    pipe = closed_pipe()
    done = gcs(*arguments, stdout=pipe)
    assert done.returncode == code
    assert b"Traceback" not in done.stderr
    assert b"Exception" not in done.stderr


def test_a_full_disk_behind_the_output_is_said() -> None:
    with Path("/dev/full").open("w") as full:
        done = gcs("schema", stdout=full)
    assert done.returncode == 1
    assert done.stderr == b"error: the output was not written whole: [Errno 28] No space left on device\n"


def test_closed_descriptors_are_no_error(tmp_path: Path) -> None:
    plan = tmp_path / "first"
    line = [*GCS, "new", str(plan)]
    done = subprocess.run(["sh", "-c", 'exec "$@" <&- >&- 2>&-', "sh", *line], check=False)
    assert done.returncode == 0
    assert "wrote" not in (plan / "scenario.toml").read_text()


def test_a_log_shows_each_line_as_it_is_said(tmp_path: Path) -> None:
    """A pipe or file behind the output gets lines, not blocks: a flight of minutes is followed by `tee`."""
    program = "from gcs.cli.shared.safe_stdout import install; import time; install(); print(1); time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"1\n"
        process.kill()
