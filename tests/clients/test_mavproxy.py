"""MAVProxy, as somebody types into it, flies a mission with an emulated vehicle."""

from __future__ import annotations

import os
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from gcs.scenario.schema.scenario import Scenario
from sim_bridge import Fleet
from sim_bridge.fleet import plain_scenario
from tests.fleets import free_port

PATIENCE_S = 120.0
SYSID = 3
READY_S = 8.0
MODULES = "wp,misc,arm,mode,cmdlong,param"


class Typist:
    """Types commands and reads the screen."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process = process
        self._screen = ""
        self._seen = 0
        self._news = threading.Condition()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        while chunk := os.read(self._process.stdout.fileno(), 65536):
            with self._news:
                self._screen += chunk.decode(errors="replace")
                self._news.notify_all()

    def type(self, command: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(f"{command}\n".encode())
        self._process.stdin.flush()

    def wait(self, *words: str, patience_s: float = PATIENCE_S) -> None:
        """Until these have been on the screen, in this order, since the last wait."""
        for word in words:
            with self._news:
                came = self._news.wait_for(lambda word=word: word in self._screen[self._seen :], patience_s)
                assert came, f"no {word!r} on the screen, but:\n{self._screen[self._seen :]}"
                self._seen = self._screen.index(word, self._seen) + len(word)


@contextmanager
def station(command: list[str], port: int, folder: Path) -> Iterator[Typist]:
    line = [*command, f"--master=udp:127.0.0.1:{port}", f"--target-system={SYSID}", f"--state-basedir={folder}"]
    process = subprocess.Popen(
        [*line, f"--default-modules={MODULES}"],
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, "HOME": str(folder), "PYTHONUNBUFFERED": "1"},
    )
    try:
        yield Typist(process)
    finally:
        process.kill()  # asked to end, it would wait for its keyboard
        process.wait()


def rows(scenario: Scenario, home_first: bool) -> list[list[object]]:
    """A mission as autopilots read it back: take-off, two legs of which one is timed, landing."""
    lat, lon, alt = scenario.origin.lat_deg, scenario.origin.lon_deg, scenario.origin.alt_amsl_m
    relative, nowhere, abort = (3, 0, 1) if home_first else (6, 2, 0)  # each reads back in its own frames
    items: list[tuple[int, int, tuple[float, ...], float, float, float]] = [
        (relative, 22, (0, 0, 0, 0), lat, lon, 5.0),
        (relative, 16, (0, 0, 0, 0), lat + 1e-4, lon, 6.0),
        (nowhere, 178, (1, 3, -1, 0), 0.0, 0.0, 0.0),
        (relative, 16, (2, 0, 0, 0), lat + 1e-4, lon + 1e-4, 7.0),
        (relative, 21, (0, 0, 0, abort), lat, lon, 0.0),
    ]
    if home_first:
        items.insert(0, (0, 16, (0, 0, 0, 0), lat, lon, alt))
    return [
        [seq, 0, frame, command, *map(float, params), round(x, 7), round(y, 7), z, 1]
        for seq, (frame, command, params, x, y, z) in enumerate(items)
    ]


def written(path: Path, table: list[list[object]]) -> Path:
    path.write_text("\n".join(["QGC WPL 110", *("\t".join(map(str, row)) for row in table)]) + "\n")
    return path


def read(path: Path) -> list[list[float]]:
    lines = path.read_text().splitlines()
    assert lines[0] == "QGC WPL 110"
    return [[float(word) for word in line.split("\t")] for line in lines[1:]]


@pytest.mark.parametrize(
    "autopilot", [pytest.param("ardupilot", marks=pytest.mark.slow), pytest.param("px4", marks=pytest.mark.long)]
)
def test_mavproxy_loads_lists_and_flies_a_mission(mavproxy: list[str], tmp_path: Path, autopilot: str) -> None:
    port, home_first = free_port(), autopilot == "ardupilot"
    sent = rows(plain_scenario(1), home_first)
    link = f"udpout:127.0.0.1:{port}"
    with (
        Fleet(vehicles=SYSID, autopilot=autopilot, links=[link], speedup=10.0) as fleet,
        station(mavproxy, port, tmp_path) as screen,
    ):
        screen.wait(f"Detected vehicle {SYSID}:1", "Received ", " parameters")
        screen.type(f"wp load {written(tmp_path / 'sent.txt', sent)}")
        screen.wait(f"Sent all {len(sent)} waypoints", "MISSION_ACK: TYPE_MISSION: ACCEPTED")
        screen.type("wp list")
        screen.wait(f"Saved {len(sent)} waypoints")
        screen.type(f"wp save {tmp_path / 'back.txt'}")
        screen.wait("Saved", "back.txt")
        back = read(tmp_path / "back.txt")
        assert [row[2:] for row in back[home_first:]] == [row[2:] for row in sent[home_first:]]
        fleet.wait_until(lambda: fleet.t_s > READY_S)
        if autopilot == "ardupilot":
            screen.type("mode guided")
            screen.wait("Mode GUIDED")
            screen.type("arm throttle")
            screen.wait("ARMED")
            screen.type("mode auto")
            screen.type("long MISSION_START 0 0 0 0 0 0 0")  # stands in for raising the throttle
            screen.wait("MISSION_START: ACCEPTED")
        else:
            screen.type("long DO_SET_MODE 1 4 4 0 0 0 0")  # its own `mode` knows ArduPilot only
            screen.wait("DO_SET_MODE: ACCEPTED")
            screen.type("arm throttle")
            screen.wait("ARMED")
        fleet.wait_until(lambda: fleet.state(SYSID).flying)
        screen.wait("DISARMED", patience_s=90.0)
        assert fleet.state(SYSID).landed
        assert not fleet.state(SYSID).armed
