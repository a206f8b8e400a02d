"""Uploads to whole fleets over real sockets: all or nothing, on both autopilots, and the commands around them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from gcs.autopilots.parameter_names import with_new_names
from gcs.autopilots.traits import Autopilot
from gcs.cli.main import run as gcs
from gcs.errors import FlightError, PeerError
from gcs.flight.setup.build_loads import build_loads, missions_only
from gcs.link.protocols.mission.read_back import compare_missions
from gcs.link.protocols.mission.strategy import SentAs, Transfer
from gcs.link.session.linked_fleet import LinkedFleet as Ground
from gcs.link.session.load_before import give_back, read_before
from gcs.link.session.upload_fleet import UploadFailed, upload_fleet
from gcs.link.session.vehicle_load import VehicleLoad
from gcs.mavlink import MavCommand, MissionType
from gcs.mission.formats.any_mission import load_missions
from gcs.plan.trajectory.plan import Plan
from sim_bridge.fleet import Fleet
from sim_bridge.personality import by_name
from tests.fleets import in_their_time

ARDUPILOT = Autopilot.ARDUPILOT
BOTH = pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
PARAMETER = {"ardupilot": "RTL_ALT", "px4": "RTL_RETURN_ALT"}
STORED = {**PARAMETER, "ardupilot-4.7": "RTL_ALT_M"}


@pytest.fixture
def fleet_of(hop: Plan, make_fleet: Callable[..., Fleet]) -> Callable[..., tuple[Fleet, str]]:
    def make(autopilot: str, **options: object) -> tuple[Fleet, str]:
        fleet = make_fleet(hop.scenario, autopilot=autopilot, one_port=True, **options)
        return fleet, f"udpout:{fleet.places[1][0].address}"

    return make


def number(autopilot: str) -> int:
    return int(by_name(autopilot).autopilot)


def loads_for(plan: Plan, autopilot: str, *, timed: bool = False) -> tuple[VehicleLoad, ...]:
    return build_loads(plan, dict.fromkeys(plan.sysids, number(autopilot)), timed=timed)


def held_by(fleet: Fleet, sysid: int, kind: MissionType = MissionType.MISSION) -> tuple[object, ...]:
    shelf = fleet._world.vehicles[sysid - 1].store
    first = int(kind is MissionType.MISSION and shelf._traits.home_is_item_0)
    return shelf.items(kind)[first:]


def parameter(fleet: Fleet, sysid: int, name: str) -> float:
    return fleet._world.vehicles[sysid - 1]._params[name]


@pytest.mark.parametrize(
    "autopilot", ["ardupilot", *(pytest.param(x, marks=pytest.mark.slow) for x in ("px4", "ardupilot-4.7"))]
)
def test_everything_for_everybody_at_once_and_parameters_back(
    hop: Plan, fleet_of: Callable[..., tuple[Fleet, str]], autopilot: str
) -> None:
    fleet, link = fleet_of(autopilot, faults=["all:loss=0.05", "all:duplicate=0.05"])
    loads, name = loads_for(hop, autopilot), STORED[autopilot]

    async def scene() -> None:
        async with Ground(link).open() as ground:
            sessions = await ground.vehicles(hop.sysids, 10.0)
            before = {sysid: parameter(fleet, sysid, name) for sysid in sessions}
            old = await read_before(sessions, loads)
            held = await upload_fleet(sessions, loads, hop.hash)
            assert set(held.digests) == set(sessions)
            assert len(set(held.digests.values())) == len(sessions)
            assert set(held.sent_as) == set(sessions)
            if number(autopilot) != ARDUPILOT:
                assert set(held.sent_as.values()) == {SentAs(Transfer.ITEMS, "PX4 takes no files")}
            for load in loads:
                mission = compare_missions(load.mission.items, held_by(fleet, load.sysid), autopilot=number(autopilot))
                assert mission == []
                for kind, items in load.extras:
                    assert compare_missions(items, held_by(fleet, load.sysid, kind), autopilot=ARDUPILOT) == []
                wanted = dict(with_new_names(number(autopilot), load.parameters))[name]
                assert parameter(fleet, load.sysid, name) == pytest.approx(wanted)
                assert name in {change.after.name for change in held.changes if change.sysid == load.sysid}
            held.require(hop.hash, hop.sysids)
            with pytest.raises(FlightError, match="of this plan: all"):
                held.require("another plan", hop.sysids)
            with pytest.raises(FlightError, match="of this plan: 99"):
                held.require(hop.hash, [1, 99])
            assert await give_back(sessions, old) == ()
            assert {sysid: parameter(fleet, sysid, name) for sysid in sessions} == before

    in_their_time(scene())


@BOTH
def test_what_was_on_board_comes_back_and_a_killed_vehicle_is_named_with_all_that_it_lacks(
    hop: Plan, fleet_of: Callable[..., tuple[Fleet, str]], autopilot: str
) -> None:
    fleet, link = fleet_of(autopilot)
    loads = loads_for(hop, autopilot)
    other = loads[1]  # as if vehicle 1 had flown the place of vehicle 2
    kinds = (MissionType.MISSION, MissionType.FENCE, MissionType.RALLY)
    switch = "FENCE_ENABLE" if autopilot == "ardupilot" else None

    async def scene() -> None:
        async with Ground(link).open() as ground:
            sessions = await ground.vehicles(hop.sysids, 10.0)
            await sessions[1].upload_mission(replace(other.mission, items=other.mission.items[:7]))
            await sessions[1].upload_items(other.rally or (), MissionType.RALLY)
            was = {kind: held_by(fleet, 1, kind) for kind in kinds}
            assert len(was[MissionType.MISSION]) == 7
            said: list[str] = []
            old = await read_before(sessions, loads, said.append)
            fence = ", FENCE_ENABLE 0" if switch else ""
            assert str(old[0]) == f"mission of 7 items, no fence, {len(other.rally or ())} rally points{fence}".replace(
                "1 rally points", "1 rally point"
            )
            assert said[0] == "vehicle 1: read its mission of 7 items"
            await upload_fleet(sessions, loads, hop.hash)
            assert (await read_before(sessions, loads))[0].same == {*kinds}
            fleet.fault("2:die@start:0")
            await fleet.until(lambda: sessions[2].heartbeat_age_s() > 5.0)
            (sentence,) = await give_back(sessions, old)
            for kind, items in was.items():
                assert compare_missions(items, held_by(fleet, 1, kind), autopilot=number(autopilot)) == []
            assert held_by(fleet, 3) == ()
            assert sentence.startswith("vehicle 2 did not get back ")
            assert "no mission, no fence, no rally points (its last heartbeat is 5 s old)" in sentence
            for change in old[1].changes:
                assert f"{change.before.name} {change.before.value:g} (now {change.after.value:g})" in sentence
            if switch:
                assert (parameter(fleet, 1, switch), parameter(fleet, 2, switch)) == (0.0, 1.0)

    in_their_time(scene())


@BOTH
def test_one_refusal_ends_it_for_all_and_everything_is_taken_back(
    hop: Plan, fleet_of: Callable[..., tuple[Fleet, str]], autopilot: str
) -> None:
    fleet, link = fleet_of(autopilot)
    loads = loads_for(hop, autopilot)
    items = list(loads[2].mission.items)
    items[5] = replace(items[5], command=9999)
    bad = replace(loads[2], mission=replace(loads[2].mission, items=tuple(items)))

    async def scene() -> None:
        async with Ground(link).open() as ground:
            sessions = await ground.vehicles(hop.sysids, 10.0)
            with pytest.raises(UploadFailed) as caught:
                await upload_fleet(sessions, (*loads[:2], bad), hop.hash)
            failed = caught.value
            assert failed.sysid == 3
            item = 5 + int(autopilot == "ardupilot")
            assert f"no vehicle may start, because of vehicle 3: vehicle 3 refused the mission at item {item}" in str(
                failed
            )
            assert "command not supported" in str(failed)
            assert set(failed.states) == set(hop.sysids)
            assert all("cleared" in state for state in failed.states.values())
            for sysid in hop.sysids:
                for kind in (MissionType.MISSION, MissionType.FENCE, MissionType.RALLY):
                    assert held_by(fleet, sysid, kind) == ()

    in_their_time(scene())


@pytest.mark.slow
def test_a_dead_vehicle_ends_it_for_all_and_is_said_to_be_unknown(
    hop: Plan, fleet_of: Callable[..., tuple[Fleet, str]]
) -> None:
    fleet, link = fleet_of("ardupilot")
    loads = missions_only(load.mission for load in loads_for(hop, "ardupilot"))

    async def scene() -> None:
        async with Ground(link).open() as ground:
            sessions = await ground.vehicles(hop.sysids, 10.0)
            fleet.fault("2:die@start:0")
            with pytest.raises(UploadFailed, match="because of vehicle 2: vehicle 2 stopped answering") as caught:
                await upload_fleet(sessions, loads, hop.hash)
            assert "may be a mix of old and new" in caught.value.states[2]
            assert caught.value.states[1] == "mission cleared"
            assert held_by(fleet, 1) == ()

    in_their_time(scene())


@pytest.mark.slow
def test_an_armed_vehicle_and_an_unknown_parameter_stop_it_before_anything_is_sent(
    hop: Plan, fleet_of: Callable[..., tuple[Fleet, str]]
) -> None:
    fleet, link = fleet_of("ardupilot")
    loads = loads_for(hop, "ardupilot")
    strange = replace(loads[0], parameters=(("NO_SUCH_THING", 1),))

    async def scene() -> None:
        async with Ground(link).open() as ground:
            sessions = await ground.vehicles(hop.sysids, 10.0)
            with pytest.raises(PeerError, match="vehicle 1 does not answer for parameter NO_SUCH_THING"):
                await upload_fleet(sessions, (strange, *loads[1:]), hop.hash)
            await fleet.until(lambda: fleet.t_s > 6.0)
            await sessions[3].command(MavCommand.DO_SET_MODE, 1.0, 4.0)
            await sessions[3].command(MavCommand.COMPONENT_ARM_DISARM, 1.0)
            await sessions[3].wait_for(lambda m: sessions[3].armed, 5.0, "arming")
            with pytest.raises(PeerError, match="vehicle 3 is armed"):
                await upload_fleet(sessions, loads, hop.hash)
            assert held_by(fleet, 1) == ()

    in_their_time(scene())


@pytest.mark.slow
def test_the_commands(
    hop: Plan,
    fleet_of: Callable[..., tuple[Fleet, str]],
    hop_skein: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    autopilot = "ardupilot"
    fleet, link = fleet_of(autopilot)
    name = PARAMETER[autopilot]
    old = parameter(fleet, 1, name)

    def call(*arguments: object) -> tuple[int, dict[str, object]]:
        code = gcs([*map(str, arguments), "--link", link, "--json"])
        return code, json.loads(capsys.readouterr().out)

    code, told = call("diff", hop_skein, "--untimed")
    assert code == 11
    assert len(told["differences"]) == 3
    code, told = call("upload", hop_skein, "--untimed", "--dry-run")
    assert code == 0
    assert told["uploaded"] is False
    assert {p["vehicle"] for p in told["parameters"]} == set(hop.sysids)
    assert told["before"][0] == {
        "vehicle": 1, "mission": 0, "fence": 0, "rally": 0, "as_planned": [], "fence_enabled": False
    }  # fmt: skip
    assert held_by(fleet, 1) == ()
    code, told = call("upload", hop_skein, "--untimed", "--to", tmp_path / "records")
    assert code == 0
    assert len(told["digests"]) == 3
    assert told["missions"] == [
        {"vehicle": sysid, "sent_as": "file", "why": "it reports MAVLink FTP"} for sysid in hop.sysids
    ]
    assert parameter(fleet, 1, name) != old
    code, compared = call("diff", hop_skein, "--untimed")
    assert code == 0, compared
    code, compared = call("diff", hop_skein)
    assert code == 11, "speeds are corrected"
    code, _ = call("download", "--to", tmp_path / "held", "--listen", 1.5)
    assert code == 0
    files = load_missions(sorted((tmp_path / "held").glob("*.plan")))
    loads = loads_for(hop, autopilot)
    assert [
        compare_missions(load.mission.items, f.items, autopilot=ARDUPILOT) for load, f in zip(loads, files, strict=True)
    ] == [[]] * 3
    assert all(f.geofence.polygons and f.rally for f in files)
    code, _ = call("restore", told["record"])
    assert code == 0
    assert parameter(fleet, 1, name) == old
    assert held_by(fleet, 1) == ()
    code, compared = call("diff", hop_skein, "--untimed")
    assert code == 11, "an upload would set parameters again"
    assert any(line.startswith(f"parameter {name} required ") for line in compared["differences"]["1"])
    (tmp_path / "not.json").write_text("{}")
    code, told = call("restore", tmp_path / "not.json")
    assert code == 6
