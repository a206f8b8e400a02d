"""Benchmark of uploads over bad links: item by item, as one file, and by MAVSDK.

./tools/run python tools/bench_upload.py [--uploads 200] [--items 100] [--autopilot ardupilot]
./tools/run python tools/bench_upload.py --uploads 0 --race 0.05:0 0.05:0.2 [--autopilot px4]

The table on a fake clock delivers to the emulated stores of both autopilots, `--uploads` times per cell of round trip
and loss (in both directions, with 2 % duplicates and 2 % of all messages overtaken by 0.1 s). Seconds are simulated.
"sent" is until the upload is over, "held" until it was read back equal. The floor is one round trip per item. Only
ArduPilot takes files.

The race has six vehicles at once, and one alone, over real sockets, in real time, in cells ROUND_TRIP_S:LOSS, by both
backends; a third number is the share of doubled and of overtaken messages instead of 2 %. Seconds are until all
missions are read back.
"""

import asyncio
import json
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from gcs.autopilots.traits import Autopilot
from gcs.errors import GcsError
from gcs.link.protocols.mission.strategy import Transfer
from gcs.link.session.connection import Connection
from gcs.mission.model import MissionItem
from tests.air import Air, Weather, mission_of
from tools.bench.frame import ROOT, finish, free_port, options, show

ROUND_TRIPS_S = (0.0, 0.05, 0.2)
LOSSES = (0.0, 0.05, 0.2, 0.4)
SYSIDS = tuple(range(1, 7))
_FIND_S, _PATIENCE_S = 30.0, 150.0
WAYS = (("skein", Transfer.ITEMS), ("skein", Transfer.FILE), ("mavsdk", Transfer.ITEMS))


def cell(
    autopilot: Autopilot, weather: Weather, uploads: int, items: int, transfer: Transfer = Transfer.ITEMS
) -> dict[str, Any]:
    """So many deliveries, each with a seed of its own."""
    ended = [
        Air(autopilot, weather, seed).deliver(mission_of(items, seed), transfer=transfer) for seed in range(uploads)
    ]
    held = [e for e in ended if e.error is None]
    floor_s = weather.round_trip_s * (items + 1)
    sent_s = statistics.median(e.sent_s for e in ended)
    return {
        "autopilot": autopilot.name,
        "transfer": str(transfer),
        "round_trip_s": weather.round_trip_s,
        "loss": weather.loss,
        "sent_s": sent_s,
        "of_floor": sent_s / floor_s if floor_s else None,
        "held_s": statistics.median(e.total_s for e in ended),
        "messages": statistics.mean(e.messages_up + e.messages_down for e in ended),
        "errors": len(ended) - len(held),
        "wrong": sum(not e.held for e in held),
        "kinds": sorted({type(e.error).__name__ for e in ended if e.error is not None}),
    }


@contextmanager
def fleet(autopilot: Autopilot, weather: Weather, port: int) -> Iterator[None]:
    """Emulated vehicles in a process of their own, that call 127.0.0.1:`port`."""
    line = [sys.executable, "-m", "sim_bridge", "missions/simulation1", "--udp", f"127.0.0.1:{port}", "--until-eof"]
    line += ["--autopilot", autopilot.key]
    faults = {"loss": weather.loss, "duplicate": weather.duplicate, "reorder": weather.reorder}
    for name, value in {**faults, "delay": weather.round_trip_s / 2}.items():
        line += ["--fault", f"all:{name}={value}@start:0"] if value else []
    process = subprocess.Popen(line, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdin is not None and process.stdout is not None
    try:
        if not json.loads(process.stdout.readline())["ready"]:
            raise RuntimeError("the emulated fleet did not start")
        yield
    finally:
        process.stdin.close()
        process.wait(10.0)


async def lap(
    link: str, backend: str, transfer: Transfer, items: Sequence[MissionItem], sysids: Sequence[int]
) -> dict[str, Any]:
    """One client's uploads at once: seconds until all are read back equal, and how many failed."""
    async with Connection((link,), transfer=transfer).open_backend(backend) as ground:
        vehicles = await ground.vehicles(SYSIDS, _FIND_S)
        began_s = time.monotonic()

        async def fails(sysid: int) -> bool:
            try:
                await asyncio.wait_for(vehicles[sysid].upload_items(items), _PATIENCE_S)
            except (GcsError, TimeoutError) as error:
                print(f"{backend}, vehicle {sysid}: {error}", file=sys.stderr)
                return True
            return False

        failures = sum(await asyncio.gather(*map(fails, sysids)))
        return {"held_s": time.monotonic() - began_s, "failures": failures}


def race(autopilot: Autopilot, cells: list[str], count: int) -> list[dict[str, Any]]:
    """Both backends with six vehicles and with one, each with a fleet of its own that has the same faults."""
    rows = []
    for text in cells:
        round_trip_s, loss, *mischief = map(float, text.split(":"))
        for backend, transfer in WAYS:
            if transfer not in ways(autopilot):
                continue
            for sysids in (SYSIDS, SYSIDS[:1]):
                port = free_port()
                with fleet(autopilot, Weather(round_trip_s, loss, *mischief * 2), port):
                    found = asyncio.run(lap(f"udpin:127.0.0.1:{port}", backend, transfer, mission_of(count, 1), sysids))
                row = {"autopilot": autopilot.name, "client": backend, "transfer": str(transfer)}
                rows.append({**row, "round_trip_s": round_trip_s, "loss": loss, "vehicles": len(sysids), **found})
    return rows


def ways(autopilot: Autopilot) -> tuple[Transfer, ...]:
    """How a mission may reach it."""
    return (Transfer.ITEMS, Transfer.FILE) if autopilot is Autopilot.ARDUPILOT else (Transfer.ITEMS,)


def main() -> None:
    """Run what was asked for."""
    keys = [autopilot.key for autopilot in Autopilot]
    chosen = options(__doc__, uploads=200, items=100, race=[], autopilot=keys, json=None)
    autopilots = list(map(Autopilot.named, chosen.autopilot))
    cells = [
        cell(autopilot, Weather(round_trip_s, loss), chosen.uploads, chosen.items, transfer)
        for autopilot in autopilots
        for round_trip_s in ROUND_TRIPS_S
        for loss in LOSSES
        for transfer in ways(autopilot)
        if chosen.uploads
    ]
    show(f"{chosen.uploads} uploads of {chosen.items} items per cell, fake clock", cells)
    laps = [row for autopilot in autopilots for row in race(autopilot, chosen.race, chosen.items)]
    finish(f"{chosen.items} items over real sockets", laps, chosen.json, {"cells": cells, "race": laps})


if __name__ == "__main__":
    main()
