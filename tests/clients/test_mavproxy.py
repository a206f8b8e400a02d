"""MAVProxy, as somebody types into it, flies a mission with an emulated vehicle."""

from __future__ import annotations

import os
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from gcs.scenario.load import load_scenario
from gcs.scenario.model import Scenario
from sim_bridge.endpoints.spec import call
from sim_bridge.personality import by_name
from sim_bridge.world import WorldOptions
from tests.fleets import free_port, running_fleet

PATIENCE_S = 40.0
SYSID = 3
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
        process.terminate()
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def rows(scenario: Scenario, home_first: bool) -> list[list[object]]:
    """A mission as autopilots read it back: take-off, two legs of which one is timed, landing."""
    lat, lon, alt = scenario.origin.lat_deg, scenario.origin.lon_deg, scenario.origin.alt_amsl_m
    items: list[tuple[int, int, tuple[float, ...], float, float, float]] = [
        (3, 22, (0, 0, 0, 0), lat, lon, 5.0),
        (3, 16, (0, 0, 0, 0), lat + 1e-4, lon, 6.0),
        (0 if home_first else 2, 178, (1, 3, -1, 0), 0.0, 0.0, 0.0),
        (3, 16, (2, 0, 0, 0), lat + 1e-4, lon + 1e-4, 7.0),
        (3, 21, (0, 0, 0, 1), lat, lon, 0.0),
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


@pytest.fixture(scope="module")
def field(repo_root: Path) -> Scenario:
    return load_scenario(repo_root / "missions" / "field")


@pytest.mark.parametrize("autopilot", ["ardupilot"])
def test_mavproxy_loads_lists_and_flies_a_mission(
    mavproxy: list[str], field: Scenario, tmp_path: Path, autopilot: str
) -> None:
    port, home_first = free_port(), autopilot == "ardupilot"
    sent = rows(field, home_first)
    options = WorldOptions(links=(call(port),), speedup=8.0, personality=by_name(autopilot))
    with running_fleet(field, options) as fleet, station(mavproxy, port, tmp_path) as screen:
        screen.wait("Detected vehicle 6:1", "Received ", " parameters")
        screen.type(f"wp load {written(tmp_path / 'sent.txt', sent)}")
        screen.wait(f"Sent all {len(sent)} waypoints", "MISSION_ACK: TYPE_MISSION: ACCEPTED")
        screen.type("wp list")
        screen.wait(f"Saved {len(sent)} waypoints")
        screen.type(f"wp save {tmp_path / 'back.txt'}")
        screen.wait("Saved", "back.txt")
        back = read(tmp_path / "back.txt")
        assert [row[1:] for row in back[home_first:]] == [[float(v) for v in row[1:]] for row in sent[home_first:]]
        vehicle = fleet.vehicles[SYSID - 1]
        assert len(vehicle.autopilot.mission) == len(sent)
        end_s = time.monotonic() + PATIENCE_S
        while not vehicle.autopilot.ready:
            assert time.monotonic() < end_s
            time.sleep(0.05)
        if autopilot == "ardupilot":
            screen.type("mode guided")
            screen.wait("Mode GUIDED")
            screen.type("arm throttle")
            screen.wait("ARMED")
            screen.type("mode auto")
            screen.wait("Mode AUTO")
            screen.type("long MISSION_START 0 0 0 0 0 0 0")  # stands in for raising the throttle
            screen.wait("MISSION_START: ACCEPTED")
        else:
            screen.type("mode MISSION")
            screen.wait("Mode MISSION")
            screen.type("arm throttle")
            screen.wait("ARMED")
        screen.wait("DISARMED", patience_s=90.0)
        assert fleet.airframes.landed[SYSID - 1]
        assert not vehicle.autopilot.armed
