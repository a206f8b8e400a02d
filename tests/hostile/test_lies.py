"""A stranger says all that a vehicle could say, as every vehicle, on the port it is heard at: nothing changes."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from tests.hostile.attacker import Attacker
from tests.hostile.conftest import MakeVehicles, all_down
from tests.hostile.ground import Ground, fly_arguments

LAND, DISARMED, LOW = 9, False, 3


@pytest.mark.parametrize(
    "autopilot", [pytest.param("ardupilot", marks=pytest.mark.slow), pytest.param("px4", marks=pytest.mark.long)]
)
def test_lies_from_another_port_change_nothing(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path, autopilot: str
) -> None:
    world, port = vehicles(autopilot)
    with Attacker(port) as stranger, Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        ground.until("flying")
        while ground.running:
            for sysid in world.sysids:
                stranger.heartbeat(sysid, mode=LAND, armed=DISARMED)
                stranger.say(
                    "LOCAL_POSITION_NED", sysid, time_boot_ms=60_000, x=900.0, y=900.0, z=-1.0, vx=0.0, vy=0.0, vz=0.0
                )
                stranger.say("SYSTEM_TIME", sysid, time_unix_usec=2_000_000_000_000_000, time_boot_ms=4_000_000)
                stranger.say(
                    "COMMAND_ACK",
                    sysid,
                    command=176,
                    result=LOW,
                    progress=0,
                    result_param2=0,
                    target_system=255,
                    target_component=190,
                )
                stranger.say("STATUSTEXT", sysid, severity=0, text="Crash: Disarming", id=0, chunk_seq=0)
            time.sleep(0.02)
        done = ground.ended()
    assert done.code == 0, done.output
    assert "Crash" not in done.output
    assert all_down(world)
    assert abs(world.airframes.truth[0, :2] - [60.0, 20.0]).max() < 1.0
