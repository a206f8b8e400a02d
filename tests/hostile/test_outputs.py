"""Output that fails while vehicles are in the air: the flight goes on, and its exit code is that of the flight."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.hostile.conftest import MakeVehicles, all_down
from tests.hostile.ground import Ground, fly_arguments
from tests.kept import GCS

SLOW = pytest.mark.long
KEEPS_ON = 'trap "" HUP; exec "$@"'
AS_IT_IS = 'exec "$@"'


class Terminal:
    """A terminal of its own for one command, which can be closed, or stopped by Ctrl-S."""

    def __init__(self, *arguments: object, script: str = AS_IT_IS) -> None:
        self.master, slave = pty.openpty()
        line = ["setsid", "--ctty", "sh", "-c", script, "sh", *GCS, *map(str, arguments)]
        self.process = subprocess.Popen(
            line, stdin=slave, stdout=slave, stderr=slave, env={**os.environ, "TERM": "xterm"}
        )
        os.close(slave)
        self.shown = b""

    def until(self, text: bytes) -> None:
        while text not in self.shown:
            self.shown += os.read(self.master, 65_536)

    def close(self) -> None:
        os.close(self.master)


@SLOW
@pytest.mark.parametrize(
    ("script", "code"),
    [(KEEPS_ON, 0), (AS_IT_IS, 128 + signal.SIGHUP)],
    ids=["output fails", "and SIGHUP"],
)
def test_a_terminal_that_is_closed_in_flight(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path, script: str, code: int
) -> None:
    world, port = vehicles()
    terminal = Terminal(*fly_arguments(hop_file, port, tmp_path), script=script)
    terminal.until(b"flying")
    terminal.close()
    assert terminal.process.wait(600.0) == code
    assert all_down(world)
    (folder,) = tmp_path.iterdir()
    state = json.loads((folder / "flight.json").read_text())
    assert state["step"] == ("landed" if code == 0 else "flying")


@SLOW
def test_a_terminal_that_stands_still_does_not_stop_the_stream(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path
) -> None:
    """Ctrl-S, or a connection that stalls: nothing is read from the flight until it has landed."""
    world, port = vehicles()
    terminal = Terminal(*fly_arguments(hop_file, port, tmp_path))
    terminal.until(b"flying")
    try:
        while not all_down(world) and terminal.process.poll() is None:
            time.sleep(0.1)
        assert all_down(world)
        terminal.until(b"landed. Telemetry")
        assert terminal.process.wait(600.0) == 0
    finally:
        terminal.close()
    state = json.loads(next(tmp_path.glob("*/flight.json")).read_text())
    assert state["step"] == "landed"


@SLOW
@pytest.mark.parametrize("more", [(), ("--json",)])
def test_a_reader_that_leaves_in_flight(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path, more: tuple[str, ...]
) -> None:
    world, port = vehicles()
    read, write = os.pipe()
    with Ground(*fly_arguments(hop_file, port, tmp_path, *more), stdout=write, stderr=subprocess.PIPE) as ground:
        os.close(write)
        os.close(read)
        _, said = ground.process.communicate(timeout=600.0)
    assert ground.process.returncode == 0, said
    assert b"Traceback" not in said
    assert all_down(world)


@SLOW
@pytest.mark.parametrize("redirect", [">/dev/full", ">/dev/full 2>&1", ">&- 2>&-", "<&- >&- 2>&-"])
def test_an_output_that_takes_nothing(vehicles: MakeVehicles, hop_file: Path, tmp_path: Path, redirect: str) -> None:
    world, port = vehicles()
    by = ("sh", "-c", f'exec "$@" {redirect}', "sh")
    with Ground(*fly_arguments(hop_file, port, tmp_path), by=by) as ground:
        done = ground.ended()
    assert done.code == 0, done.output
    assert all_down(world)
    assert b"flying" not in next(tmp_path.glob("*/telemetry.tlog")).read_bytes()


@SLOW
def test_an_encoding_without_the_characters(vehicles: MakeVehicles, hop_file: Path, tmp_path: Path) -> None:
    world, port = vehicles()
    with Ground(*fly_arguments(hop_file, port, tmp_path), env={"PYTHONIOENCODING": "ascii"}) as ground:
        done = ground.ended()
    assert done.code == 0, done.output
    assert all_down(world)
