"""The same uploads by our own machines and by MAVSDK, on both emulated autopilots."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.cli import main
from gcs.errors import UsageError
from gcs.flight.execution.single_vehicle import control_of
from gcs.flight.setup.build_loads import build_loads
from gcs.link.session.connection import BACKENDS, Connection
from gcs.link.session.load_before import give_back, read_before
from gcs.link.session.mavsdk_vehicle import mavsdk_url
from gcs.link.session.upload_fleet import UploadFailed, preview, upload_fleet
from gcs.link.session.vehicle_api import Loadable, Setpoint
from gcs.link.session.vehicle_load import read_onboard
from gcs.plan.trajectory.plan import Plan
from sim_bridge.fleet import Fleet
from tests.fleets import free_port, in_their_time

EACH = pytest.mark.parametrize("backend", BACKENDS)
MAVSDK_SLOW = pytest.mark.parametrize("backend", ["skein", pytest.param("mavsdk", marks=pytest.mark.slow)])
OURS = [("skein", "ardupilot"), ("skein", "px4")]
PX4_TOO = pytest.mark.parametrize("autopilot", ["ardupilot", pytest.param("px4", marks=pytest.mark.slow)])
SYSIDS = (1, 2)


@pytest.fixture
def make(backend: str, request: pytest.FixtureRequest) -> Callable[..., Fleet]:
    """A function that makes fleets: in virtual time for our own machines; MAVSDK has threads and a clock of its own."""
    made: Callable[..., Fleet] = request.getfixturevalue("make_fleet" if backend == "skein" else "make_threaded_fleet")
    return made


def run(backend: str, scene: Coroutine[Any, Any, None]) -> None:
    if backend == "skein":
        in_their_time(scene)
    else:
        asyncio.run(asyncio.wait_for(scene, 90.0))


@asynccontextmanager
async def vehicles(make: Callable[..., Fleet], backend: str, autopilot: str) -> AsyncIterator[dict[int, Loadable]]:
    port = free_port()
    make(vehicles=2, autopilot=autopilot, links=(f"udpout:127.0.0.1:{port}",))
    async with Connection((f"udpin:127.0.0.1:{port}",)).open_backend(backend) as fleet:
        yield dict(await fleet.vehicles(SYSIDS, 20.0))


def loads_for(plan: Plan, autopilot: str):
    every = build_loads(plan, dict.fromkeys(plan.sysids, int(Autopilot.named(autopilot))), timed=False)
    short = []
    for load in every[:2]:
        items, times = load.mission.items[:12], load.mission.arrival_s[:12]
        short.append(replace(load, mission=replace(load.mission, items=items, arrival_s=times)))
    return tuple(short)


@pytest.mark.parametrize(
    ("backend", "autopilot"), [*OURS, ("mavsdk", "px4"), pytest.param("mavsdk", "ardupilot", marks=pytest.mark.slow)]
)
def test_everything_is_loaded_read_and_put_back(
    hop: Plan, make: Callable[..., Fleet], backend: str, autopilot: str
) -> None:
    loads = loads_for(hop, autopilot)

    async def scene() -> None:
        async with vehicles(make, backend, autopilot) as found:
            before = await preview(found, loads)
            assert before
            old = await read_before(found, loads)
            held = await upload_fleet(found, loads, hop.hash)
            held.require(hop.hash, SYSIDS)
            assert held.changes == before
            for load in loads:
                assert (await read_onboard(found[load.sysid])).differences(load) == []
            assert await preview(found, loads) == ()
            missing = await give_back(found, old)
            assert missing == () or backend == "mavsdk", "MAVSDK clears missions alone on PX4"
            assert await preview(found, loads) == before
            assert (await read_onboard(found[1])).mission == ()

    run(backend, scene())


@pytest.mark.parametrize(
    ("backend", "autopilot"), [*OURS, ("mavsdk", "ardupilot"), pytest.param("mavsdk", "px4", marks=pytest.mark.slow)]
)
def test_one_bad_item_leaves_nobody_with_a_mission(
    hop: Plan, make: Callable[..., Fleet], backend: str, autopilot: str
) -> None:
    first, second = loads_for(hop, autopilot)
    items = list(second.mission.items)
    items[3] = replace(items[3], command=9999)
    second = replace(second, mission=replace(second.mission, items=tuple(items)))

    async def scene() -> None:
        async with vehicles(make, backend, autopilot) as found:
            with pytest.raises(UploadFailed, match="because of vehicle 2: ") as caught:
                await upload_fleet(found, (first, second), hop.hash)
            assert all("cleared" in state for state in caught.value.states.values()), str(caught.value)
            for vehicle in found.values():
                held = await read_onboard(vehicle)
                assert held.mission == held.fence == held.rally == ()

    run(backend, scene())


@EACH
@PX4_TOO
def test_vehicles_are_listed(
    make: Callable[..., Fleet], capsys: pytest.CaptureFixture[str], backend: str, autopilot: str
) -> None:
    port = free_port()
    fleet = make(vehicles=2, autopilot=autopilot, links=(f"udpout:127.0.0.1:{port}",), speedup=10.0)
    fleet.wait_until(lambda: fleet.t_s > 6.0)
    link = f"udpin:127.0.0.1:{port}"
    assert main.run(["vehicles", "--link", link, "--listen", "1", "--backend", backend, "--json"]) == 0
    first, second = json.loads(capsys.readouterr().out)["vehicles"]
    assert (first["system"], second["system"]) == (1, 2)
    assert first["autopilot"] == {"ardupilot": "ArduCopter", "px4": "PX4"}[autopilot]
    assert first["version"].startswith({"ardupilot": "4.5.6", "px4": "1.17.0-alpha"}[autopilot])
    assert first["uid"] != second["uid"]
    assert (first["armed"], first["prearm_ok"], first["estimate_ok"]) == (False, True, True)
    assert set(first["ailing"]) <= {"radio control"}
    assert 0.9 < first["battery_share"] <= 1.0
    assert 10.0 < first["battery_V"] < 18.0
    for place in ("home", "position"):
        assert abs(first[place]["lat_deg"] + 35.363262) < 1e-3
        assert abs(first[place]["alt_amsl_m"] - 584.0) < 5.0


@MAVSDK_SLOW
@PX4_TOO
def test_a_vehicle_takes_off_follows_and_lands(make: Callable[..., Fleet], backend: str, autopilot: str) -> None:
    port = free_port()
    fleet = make(vehicles=2, autopilot=autopilot, links=(f"udpout:127.0.0.1:{port}",), speedup=8.0, seed=2)

    async def scene() -> None:
        await fleet.until(lambda: fleet.t_s > 6.0)
        pad = fleet.state(1).position_ned_m
        async with Connection((f"udpin:127.0.0.1:{port}",)).open_backend(backend) as ground:
            vehicle = (await ground.vehicles((1, 2), 20.0))[1]
            hands = control_of(vehicle)
            try:
                await hands.arm()
                assert fleet.state(1).armed
                await hands.take_off(4.0)
                await fleet.until(lambda: pad[2] - fleet.state(1).position_ned_m[2] > 3.7)
                await fleet.until(lambda: abs(fleet.state(1).velocity_ned_mps).max() < 0.1)
                await hands.follow(Setpoint((3.0, 1.0, -5.0)))
                await fleet.until(lambda: abs(fleet.state(1).position_ned_m - pad - (3.0, 1.0, -5.0)).max() < 0.3)
                await hands.follow(Setpoint((3.0, 2.0, -5.0), yaw_ned_rad=0.5))
                await fleet.until(lambda: abs(fleet.state(1).position_ned_m - pad - (3.0, 2.0, -5.0)).max() < 0.3)
                await fleet.until(lambda: abs(fleet.state(1).roll_pitch_yaw_rad[2] - 0.5) < 0.1)
                await hands.hold()
                then = fleet.t_s
                await fleet.until(lambda: fleet.t_s > then + 2.0)
                assert abs(fleet.state(1).velocity_ned_mps).max() < 0.2
                await hands.land()
                await fleet.until(lambda: not fleet.state(1).armed)
                assert fleet.state(1).landed
                assert not fleet.state(2).armed
            finally:
                await hands.close()

    run(backend, scene())


@MAVSDK_SLOW
def test_those_in_the_air_are_told(
    make: Callable[..., Fleet], capsys: pytest.CaptureFixture[str], backend: str
) -> None:
    port = free_port()
    fleet = make(vehicles=2, links=(f"udpout:127.0.0.1:{port}",), speedup=10.0, seed=2)
    link = f"udpin:127.0.0.1:{port}"

    async def up() -> None:
        await fleet.until(lambda: fleet.t_s > 6.0)
        async with Connection((link,)).open() as ground:
            hands = control_of((await ground.vehicles((1, 2), 20.0))[1])
            await hands.arm()
            await hands.take_off(8.0)
            await fleet.until(lambda: fleet.state(1).flying)

    run(backend, up())
    assert main.run(["tell", "hold", "--link", link, "--backend", backend, "--listen", "1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["vehicles"] == {"1": "holds", "2": "is not armed, no command sent"}
    assert main.run(["tell", "land", "--link", link, "--backend", backend, "--vehicles", "1"]) == 0
    assert "vehicle 1: lands" in capsys.readouterr().out
    fleet.wait_until(lambda: not fleet.state(1).armed)
    assert fleet.state(1).landed


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("dance", "--link", "udpin:127.0.0.1:0"), "with --link give one of hold, land, return"),
        (("land",), "there is no flight under way"),
        (("land", "--link", "udpin:127.0.0.1:0", "--vehicles", "1,x"), "--vehicles 1,x: not system ids"),
    ],
)
def test_what_cannot_be_told_is_refused(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], words: str
) -> None:
    assert main.run(["tell", *arguments]) == 2
    assert words in capsys.readouterr().err


def test_links_have_mavsdks_names_and_keys_are_refused() -> None:
    assert mavsdk_url("udpin:127.0.0.1:14550") == "udpin://127.0.0.1:14550"
    assert mavsdk_url("tcp:10.0.0.5:5760") == "tcpout://10.0.0.5:5760"
    assert mavsdk_url("/dev/ttyUSB0:57600") == "serial:///dev/ttyUSB0:57600"

    async def opened(backend: str, key: bytes | None) -> None:
        async with Connection(("udpin:127.0.0.1:0",), key=key).open_backend(backend):
            pass

    with pytest.raises(UsageError, match="MAVSDK cannot sign"):
        asyncio.run(opened("mavsdk", bytes(range(32))))
    with pytest.raises(UsageError, match="--backend nonsense is not known"):
        asyncio.run(opened("nonsense", None))
