"""Missions as one file through real sockets, and item by item where that does not go."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import pytest

from gcs.autopilots.protocol_timers import FtpTimers, MissionTimers, ProtocolTimers
from gcs.autopilots.traits import Autopilot
from gcs.cli.main import run as gcs
from gcs.errors import PeerError
from gcs.link.protocols.ftp.payload import FtpError, FtpOpcode, FtpPayload, FtpRefused
from gcs.link.protocols.mission.file_upload import FileUpload
from gcs.link.protocols.mission.read_back import compare_missions
from gcs.link.protocols.mission.strategy import Transfer
from gcs.link.protocols.mission.verified_upload import VerifiedUpload
from gcs.link.session.linked_fleet import LinkedFleet as Ground
from sim_bridge import Fleet
from sim_bridge.protocol.ftp_server import _nak
from tests.air import mission_of
from tests.fleets import in_their_time

ITEMS = mission_of(60, seed=3)
ITEM, FILE = 73, 110
SYSIDS = (1, 2)
MakeFleet = Callable[..., Fleet]


IMPATIENT = ProtocolTimers(mission=MissionTimers(give_up_s=2.0), ftp=FtpTimers(give_up_s=2.0))


def emulated(make_fleet: MakeFleet, autopilot: str = "ardupilot", *faults: str) -> tuple[Fleet, str]:
    fleet = make_fleet(vehicles=2, autopilot=autopilot, one_port=True, faults=list(faults))
    return fleet, f"udpout:{fleet.places[1][0].address}"


async def upload(
    link: str, transfer: Transfer, timers: ProtocolTimers | None = None
) -> tuple[list[object], Counter[int]]:
    """Both vehicles get ITEMS; what ended well, and frames in and out by message number."""
    seen: Counter[int] = Counter()
    async with Ground(
        link, on_frame=lambda _, frame: seen.update([frame[7]]), timers=timers, transfer=transfer
    ).open() as ground:
        sessions = await ground.vehicles(SYSIDS, 10.0)
        return list(await asyncio.gather(*(session.upload_items(ITEMS) for session in sessions.values()))), seen


def held(fleet: Fleet, sysid: int) -> bool:
    shelf = fleet._world.vehicles[sysid - 1].store
    return compare_missions(ITEMS[1:], shelf.items()[1:], autopilot=Autopilot.ARDUPILOT) == []


def test_a_wrong_checksum_sends_nothing_twice(make_fleet: MakeFleet) -> None:
    """The read-back, compared item by item, is the proof: one file there, one burst back."""
    fleet, link = emulated(make_fleet, "ardupilot", "all:wrong-crc")

    async def scene() -> None:
        machines, seen = await upload(link, Transfer.AUTO)
        assert all(isinstance(machine, FileUpload) for machine in machines)
        assert all(machine._tries == 1 and machine._reads == 1 for machine in machines)
        assert not seen[ITEM]
        assert all(held(fleet, sysid) for sysid in SYSIDS)

    in_their_time(scene())


def test_files_on_a_link_that_loses_one_message_of_five(make_fleet: MakeFleet) -> None:
    fleet, link = emulated(make_fleet, "ardupilot", "all:loss=0.2", "all:duplicate=0.1", "all:reorder=0.1")

    async def scene() -> None:
        machines, seen = await upload(link, Transfer.AUTO)
        assert all(isinstance(machine, FileUpload) for machine in machines)
        assert seen[FILE] and not seen[ITEM]
        assert all(held(fleet, sysid) for sysid in SYSIDS)

    in_their_time(scene())


def test_item_by_item_where_that_is_asked_for(make_fleet: MakeFleet) -> None:
    fleet, link = emulated(make_fleet)

    async def scene() -> None:
        machines, seen = await upload(link, Transfer.ITEMS)
        assert all(isinstance(machine, VerifiedUpload) for machine in machines)
        assert seen[ITEM] and not seen[FILE]
        assert all(held(fleet, sysid) for sysid in SYSIDS)

    in_their_time(scene())


def test_item_by_item_where_the_vehicle_does_not_answer_about_files(make_fleet: MakeFleet) -> None:
    fleet, link = emulated(make_fleet)
    fleet._world.vehicles[0].files = None

    async def scene() -> None:
        machines, _ = await upload(link, Transfer.AUTO, IMPATIENT)
        assert [type(machine) for machine in machines] == [VerifiedUpload, FileUpload]
        assert all(held(fleet, sysid) for sysid in SYSIDS)

    in_their_time(scene())


def test_px4_is_not_asked_and_does_not_take_them(make_fleet: MakeFleet) -> None:
    _, link = emulated(make_fleet, "px4")

    async def scene() -> None:
        machines, seen = await upload(link, Transfer.AUTO)
        assert all(isinstance(machine, VerifiedUpload) for machine in machines)
        assert not seen[FILE]
        with pytest.raises(PeerError, match="takes no missions as files"):
            await upload(link, Transfer.FILE)

    in_their_time(scene())


def test_a_refused_file_is_told_or_gone_around(make_fleet: MakeFleet) -> None:
    fleet, link = emulated(make_fleet)
    files = fleet._world.vehicles[0].files
    assert files is not None
    honest = files._opened
    protected = _nak(FtpPayload(0, 0, FtpOpcode.CREATE_FILE), FtpError.FILE_PROTECTED)

    def opened(request: FtpPayload, now_s: float) -> FtpPayload:
        if request.opcode != FtpOpcode.CREATE_FILE:
            return honest(request, now_s)
        return replace(protected, seq=request.seq + 1, session=request.session)

    files._opened = opened  # type: ignore[method-assign]

    async def scene() -> None:
        with pytest.raises(FtpRefused, match="FILE_PROTECTED"):
            await upload(link, Transfer.FILE)
        machines, _ = await upload(link, Transfer.AUTO)
        assert [type(machine) for machine in machines] == [VerifiedUpload, FileUpload]
        assert all(held(fleet, sysid) for sysid in SYSIDS)

    in_their_time(scene())


def test_a_restart_in_the_middle_of_a_file_loses_the_file_and_nothing_else(make_fleet: MakeFleet) -> None:
    fleet, link = emulated(make_fleet, "ardupilot", "1:reboot@upload:20")
    before = tuple(fleet._world.vehicles)

    async def scene() -> None:
        await upload(link, Transfer.AUTO)
        assert [now is then for now, then in zip(fleet._world.vehicles, before, strict=True)] == [False, True]
        assert all(held(fleet, sysid) for sysid in SYSIDS)

    in_their_time(scene())


def test_the_option(capsys: pytest.CaptureFixture[str]) -> None:
    assert gcs(["upload", "missions/simulation1", "--transfer", "pigeon"]) == 2
    assert "give one of auto, items, file" in capsys.readouterr().err
    assert gcs(["fly", "missions/simulation1", "--link", "udpin:127.0.0.1:0", "--transfer", "pigeon"]) == 2
