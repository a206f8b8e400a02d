"""pymavlink's mavutil, in a script of its own, flies an emulated vehicle."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from sim_bridge import Fleet
from sim_bridge.fleet import plain_scenario
from tests.clients.test_mavproxy import read, rows, written
from tests.fleets import free_port

SYSID = 2


@pytest.mark.parametrize(
    ("autopilot", "link"),
    [
        ("ardupilot", "udp"),
        pytest.param("px4", "tcp", marks=pytest.mark.slow),
        pytest.param("ardupilot", "tcp", marks=pytest.mark.slow),
        pytest.param("px4", "udp", marks=pytest.mark.slow),
    ],
)
def test_a_script_with_mavutil_flies_a_mission(tmp_path: Path, autopilot: str, link: str) -> None:
    port, home_first = free_port(), autopilot == "ardupilot"
    path = written(tmp_path / "mission.waypoints", rows(plain_scenario(1), home_first))
    links = [f"udpout:127.0.0.1:{port}" if link == "udp" else "tcpin:0"]
    with Fleet(vehicles=SYSID, autopilot=autopilot, links=links, speedup=8.0) as fleet:
        where = f"udpin:127.0.0.1:{port}" if link == "udp" else "tcp:{}:{}".format(*fleet.address(SYSID))
        script = Path(__file__).with_name("fly_with_mavutil.py")
        done = subprocess.run(
            [sys.executable, script, where, str(SYSID), path], capture_output=True, text=True, timeout=400, check=False
        )
        assert done.returncode == 0, done.stderr + done.stdout
        told = json.loads(done.stdout.splitlines()[-1])
        assert fleet.state(SYSID).landed
        assert not fleet.state(SYSID).armed
    assert told["autopilot"] == (3 if home_first else 12)
    assert told["param"] == (450.0 if home_first else 4.5)
    sent = [row[2:4] + row[4:11] for row in read(path)]
    assert [row[:2] for row in told["back"]] == [row[:2] for row in sent]
    for back, row in zip(told["back"][home_first:], sent[home_first:], strict=True):
        assert back[2:] == pytest.approx(row[2:], abs=1e-6)
    first, last = (2, 4) if home_first else (1, 3)
    assert told["reached"] == sorted(told["reached"])
    assert last in told["reached"]
    assert {first, first + 1} & set(told["reached"])  # as recorded: under the number of the speed that follows it
    assert told["modes"][-1] == ("AUTO" if home_first else "MISSION")
