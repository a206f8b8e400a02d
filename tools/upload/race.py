"""Six uploads at once over real sockets to an emulated fleet behind bad links: ours, both ways, and MAVSDK's.

Knows: both clients, how to start a fleet with faults. Does not know: which cells to run, tables.
"""

from __future__ import annotations

import asyncio
import json
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import mavsdk
from mavsdk.plugins.mission_raw import MissionItem as RawItem
from mavsdk.plugins.mission_raw import MissionRaw

from gcs.autopilots.traits import Autopilot
from gcs.errors import GcsError
from gcs.link.mission_protocol.read_back import compare_missions
from gcs.link.mission_protocol.strategy import Transfer
from gcs.link.session.linked_fleet import FrameDirection
from gcs.link.session.linked_fleet import LinkedFleet as Ground
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.message import Message
from gcs.mission.model import MissionItem
from tools.upload.air import Weather, mission_of

ROOT = Path(__file__).resolve().parents[2]
SYSIDS = tuple(range(1, 7))
PATIENCE_S = 150.0  # for MAVSDK; ours has a timeout of its own
_FIND_S = 30.0
_ECHOES = 15


@dataclass(frozen=True)
class Lap:
    """One client's uploads: seconds until the last was sent, and until all were read back where that is done."""

    client: str
    vehicles: int  # at once
    echo_s: float | None  # the round trip as it was, measured before; None where the link loses answers
    sent_s: float
    verified_s: float | None
    messages: int | None  # up and down
    failures: int
    wrong: int  # believed to be held, and not


@contextmanager
def fleet(autopilot: Autopilot, weather: Weather, port: int, seed: int) -> Iterator[None]:
    """Emulated vehicles in a process of their own, that call 127.0.0.1:`port`."""
    one_way_s = weather.round_trip_s / 2
    faults = [f"all:loss={weather.loss}", f"all:duplicate={weather.duplicate}", f"all:reorder={weather.reorder}"]
    faults += [f"all:delay={one_way_s}"] if one_way_s else []
    line = [sys.executable, "-m", "sim_bridge", "missions/simulation1", "--udp", f"127.0.0.1:{port}", "--until-eof"]
    line += ["--autopilot", autopilot.key, "--seed", str(seed)]
    for fault in faults:
        line += ["--fault", f"{fault}@start:0"]
    process = subprocess.Popen(line, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    try:
        if process.stdout is None or not json.loads(process.stdout.readline())["ready"]:
            raise RuntimeError("the emulated fleet did not start")
        yield
    finally:
        if process.stdin is not None:
            process.stdin.close()
        process.wait(10.0)


def ours(port: int, items: Sequence[MissionItem], sysids: Sequence[int], transfer: Transfer, *, lossless: bool) -> Lap:
    """Deliveries at once, each read back and compared."""
    count = 0

    def note(direction: FrameDirection, frame: bytes) -> None:
        nonlocal count
        number = int.from_bytes(frame[7:10], "little")
        count += 38 <= number <= 51 or number in (73, 110)

    async def upload() -> Lap:
        nonlocal count
        async with Ground.open(f"udpin:127.0.0.1:{port}", on_frame=note, transfer=transfer) as ground:
            sessions = await ground.vehicles(SYSIDS, _FIND_S)
            echo_s = await _echo_s(sessions[sysids[0]]) if lossless else None
            began_s = time.monotonic()
            count = 0
            sent: list[float] = []

            async def one(sysid: int) -> bool:
                try:
                    machine = await sessions[sysid].upload_items(items)
                except GcsError as error:
                    print(f"ours, vehicle {sysid}: {error.message}", file=sys.stderr)
                    return False
                sent.append((machine.sending_ended_s or time.monotonic()) - began_s)  # the loop's clock is the same
                return True

            done = await asyncio.gather(*map(one, sysids))
            took_s = time.monotonic() - began_s
            client = f"ours, {'as a file' if transfer is Transfer.FILE else 'by items'}"
            return Lap(client, len(sysids), echo_s, max(sent, default=took_s), took_s, count, done.count(False), 0)

    return asyncio.run(upload())


def _is_echo(stamp: int, message: Message) -> bool:
    return message.name == "TIMESYNC" and bool(message.fields["ts1"] == stamp)


async def _echo_s(session: VehicleSession) -> float:
    """The median of some TIMESYNC round trips: emulated vehicles look at their links once a step."""
    took: list[float] = []
    for stamp in range(1, _ECHOES + 1):
        began_s = time.monotonic()
        answered = asyncio.ensure_future(session.wait_for(partial(_is_echo, stamp), 5.0, "its echo"))
        await asyncio.sleep(0)
        session.send(Message("TIMESYNC", {"tc1": 0, "ts1": stamp}))
        await answered
        took.append(time.monotonic() - began_s)
    return statistics.median(took)


def mavsdks(port: int, items: Sequence[MissionItem], sysids: Sequence[int]) -> Lap:
    """MAVSDK's uploads at once; what it believes is looked at afterwards, by our own read-back."""
    configuration = mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
    sdk = mavsdk.Mavsdk(configuration)
    believed: dict[int, float] = {}
    try:
        sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        end_s = time.monotonic() + _FIND_S
        systems: dict[int, mavsdk.System] = {}
        while len(systems) < len(SYSIDS) and time.monotonic() < end_s:
            systems |= {s.get_system_id(): s for s in sdk.get_systems() if s.is_connected() and s.has_autopilot()}
            time.sleep(0.05)
        began_s = time.monotonic()

        def one(sysid: int) -> None:
            try:
                MissionRaw(systems[sysid]).upload_mission([_raw(seq, item) for seq, item in enumerate(items)])
                believed[sysid] = time.monotonic() - began_s
            except Exception as error:  # whatever a foreign client raises is a failed upload
                print(f"MAVSDK, vehicle {sysid}: {str(error).split(';', maxsplit=1)[0]}", file=sys.stderr)

        threads = [threading.Thread(target=one, args=(sysid,), daemon=True) for sysid in systems if sysid in sysids]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(max(began_s + PATIENCE_S - time.monotonic(), 0.0))
        took_s = time.monotonic() - began_s
    finally:
        sdk.destroy()
    wrong = _wrongly_believed(port, items, sorted(believed))
    failures = len(sysids) - len(believed)
    sent_s = took_s if failures else max(believed.values())
    return Lap("MAVSDK", len(sysids), None, sent_s, None, None, failures, wrong)


def _wrongly_believed(port: int, items: Sequence[MissionItem], sysids: Sequence[int]) -> int:
    async def look() -> int:
        async with Ground.open(f"udpin:127.0.0.1:{port}") as ground:
            sessions = await ground.vehicles(sysids, _FIND_S)
            held = await asyncio.gather(*(s.download() for s in sessions.values()), return_exceptions=True)
            read = [(s, h) for s, h in zip(sessions.values(), held, strict=True) if not isinstance(h, BaseException)]
            return sum(compare_missions(items[1:], h[1:], autopilot=s.autopilot) != [] for s, h in read)

    return asyncio.run(look()) if sysids else 0


def _raw(seq: int, item: MissionItem) -> RawItem:
    params = (float(p) for p in item.params)
    place = (item.lat_degE7, item.lon_degE7, item.alt_m)
    return RawItem(seq, item.frame, item.command, int(seq == 0), 1, *params, *place, 0)


def race(autopilot: Autopilot, weather: Weather, count: int, port: int, seed: int) -> list[Lap]:
    """All clients with six vehicles, and ours with one alone, each with a fleet of its own that has the same faults."""
    files = (Transfer.FILE,) if autopilot is Autopilot.ARDUPILOT else ()
    clients: list[Callable[[int, Sequence[MissionItem]], Lap]] = [
        partial(ours, sysids=sysids, transfer=transfer, lossless=not weather.loss)
        for transfer in (Transfer.ITEMS, *files)
        for sysids in (SYSIDS, SYSIDS[:1])
    ]
    clients.append(partial(mavsdks, sysids=SYSIDS))
    laps = []
    for client in clients:
        with fleet(autopilot, weather, port, seed):
            laps.append(client(port, mission_of(count, seed)))
    return laps
