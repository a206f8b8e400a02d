"""`gcs vehicles` over real sockets: what it lists, and what it says when there is nobody."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable

import pytest

from gcs.cli.main import run
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message
from sim_bridge.fleet import Fleet
from tests.fleets import free_port


@pytest.mark.slow
@pytest.mark.parametrize(
    ("autopilot", "name", "version"), [("ardupilot", "ArduCopter", "4.5.6"), ("px4", "PX4", "1.17")]
)
def test_vehicles_are_listed(
    make_fleet: Callable[..., Fleet], capsys: pytest.CaptureFixture[str], autopilot: str, name: str, version: str
) -> None:
    fleet = make_fleet(vehicles=2, one_port=True, autopilot=autopilot, faults=["2:down.loss=0.3"])
    fleet.wait_until(lambda: fleet.t_s > 6.0)
    link = f"udpout:{fleet.places[1][0].address}"
    assert run(["vehicles", "--link", link, "--listen", "2", "--json"]) == 0
    told = capsys.readouterr()
    first, second = json.loads(told.out)["vehicles"]
    assert (first["system"], second["system"]) == (1, 2)
    assert first["autopilot"] == name
    assert first["version"].startswith(version)
    assert first["estimate_ok"] is True
    assert first["prearm_ok"] is True
    assert first["armed"] is False
    assert first["battery_share"] > 0.9
    assert abs(first["home"]["lat_deg"] + 35.363262) < 1e-3
    assert abs(first["home"]["alt_amsl_m"] - 584.0) < 5.0
    assert first["timesync"]["round_trip_s"] < 1.0
    assert first["loss"] < 0.05
    assert 0.05 < second["loss"] < 0.6
    assert first["uid"] != second["uid"]
    assert told.err == ""


def test_the_reasons_of_a_vehicle_that_is_not_ready_are_told(
    make_fleet: Callable[..., Fleet], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In AUTO without a mission; a terminal of 80 columns breaks no word."""
    monkeypatch.setenv("COLUMNS", "80")
    fleet = make_fleet(vehicles=2, one_port=True, autopilot="ardupilot")
    fleet.wait_until(lambda: fleet.t_s > 6.0)
    host, port = fleet.places[1][0].address.split(":")
    auto = {"target_system": 2, "target_component": 1, "command": 176, "confirmation": 0}
    auto |= {f"param{n}": 0.0 for n in range(4, 8)} | {"param1": 1.0, "param2": 3.0, "param3": 0.0}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.sendto(Codec(255, 190).encode(Message("COMMAND_LONG", auto, 255, 190)), (host, int(port)))
        fleet.wait_until(lambda: fleet.t_s > 12.0)
    assert run(["vehicles", "--link", f"udpout:{host}:{port}", "--listen", "30"]) == 0
    told = capsys.readouterr().out
    assert max(len(line) for line in told.splitlines()) <= 80
    cells = [line.split("│") for line in told.splitlines() if line.startswith("│")]
    health = " ".join(row[4].strip() for row in cells)
    assert "ready not ready to arm in AUTO, reports: PreArm: Mode requires mission" in " ".join(health.split())


def test_nobody_there(capsys: pytest.CaptureFixture[str]) -> None:
    port = free_port()
    assert run(["vehicles", "--link", f"udpin:127.0.0.1:{port}", "--listen", "0.2"]) == 8
    assert f"no vehicle was heard at udpin:127.0.0.1:{port} within 0.2 s" in capsys.readouterr().err
