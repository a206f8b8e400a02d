"""A stranger says all that a vehicle could say, as every vehicle, on the port it is heard at: nothing changes."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.cli.main import run
from tests.fleets import CLOCK
from tests.hostile.attacker import Attacker
from tests.hostile.conftest import MakeVehicles, all_down
from tests.hostile.ground import fly_arguments
from tests.virtual_clock import Every

LAND, DISARMED, LOW = 9, False, 3


@pytest.mark.parametrize(
    "autopilot", [pytest.param("ardupilot", marks=pytest.mark.slow), pytest.param("px4", marks=pytest.mark.long)]
)
def test_lies_from_another_port_change_nothing(
    still_vehicles: MakeVehicles, hop_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], autopilot: str
) -> None:
    world, port = still_vehicles(autopilot)
    with Attacker(port) as stranger:

        def lie() -> None:
            if world.airframes.truth[0, 0] < 1.0:
                return  # it does not fly its plan yet
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

        with Every(CLOCK, 0.2, lie):
            code = run(list(map(str, fly_arguments(hop_file, port, tmp_path))))
        assert stranger.sent > 500
    said = "".join(capsys.readouterr())
    assert code == 0, said
    assert "Crash" not in said
    assert all_down(world)
    assert abs(world.airframes.truth[0, :2] - [60.0, 20.0]).max() < 1.0
