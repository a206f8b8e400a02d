"""How fast, and how surely, do missions reach vehicles over bad links? Item by item, as one file, and by MAVSDK.

./tools/run python tools/bench_upload.py [--uploads 200] [--items 100] [--autopilot ardupilot]
./tools/run python tools/bench_upload.py --uploads 0 --race 0.05:0 0.05:0.2 [--laps 3] [--autopilot px4]

The table on a fake clock delivers to the emulated stores of both autopilots, `--uploads` times per cell of round trip
and loss (in both directions, with 2 % duplicates and 2 % of all messages overtaken by 0.1 s). Seconds are simulated.
"sent" is until the upload is over, "held" until it was read back equal. The floor is one round trip per item. Only
ArduPilot takes files.

The race has six vehicles at once, and one alone, over real sockets, in real time, in cells ROUND_TRIP_S:LOSS; medians
of `--laps` with a seed each. "echo" is the round trip as TIMESYNC had it before, "of floor" is `sent` over one of those
per item, "of one" over the same client's single vehicle, "of MAVSDK" over MAVSDK's in the same cell, if all of that
arrived.
"""

from __future__ import annotations

import argparse
import json
import socket
import statistics
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from gcs.autopilots.traits import Autopilot
from gcs.link.mission_protocol.strategy import Transfer
from tools.upload.air import Air, Weather, mission_of

ROUND_TRIPS_S = (0.0, 0.05, 0.2)
LOSSES = (0.0, 0.05, 0.2, 0.4)


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


def show(rows: list[dict[str, Any]], uploads: int, items: int) -> None:
    """The cells as a table, one line for each way of transfer."""
    columns = ("autopilot", "round trip", "loss", "as", "sent", "of floor", "held", "messages", "errors", "wrong")
    table = Table(*columns, title=f"{uploads} uploads of {items} items per cell, fake clock")
    for row in rows:
        table.add_row(
            row["autopilot"],
            f"{1e3 * row['round_trip_s']:.0f} ms",
            f"{row['loss']:.0%}",
            row["transfer"],
            f"{row['sent_s']:.2f} s",
            "" if row["of_floor"] is None else f"{row['of_floor']:.2f}",
            f"{row['held_s']:.2f} s",
            f"{row['messages']:.0f}",
            f"{row['errors']}",
            f"{row['wrong']}",
        )
    _print(table)


def middle(laps: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Medians of one client's laps in one cell; failures and wrong beliefs of all of them together."""
    first = laps[0]
    row = {key: first[key] for key in ("round_trip_s", "loss", "client", "vehicles")}
    for key in ("echo_s", "sent_s", "verified_s", "messages"):
        row[key] = statistics.median(lap[key] for lap in laps) if first[key] is not None else None
    return {**row, "failures": sum(lap["failures"] for lap in laps), "wrong": sum(lap["wrong"] for lap in laps)}


def compared(rows: Sequence[dict[str, Any]], items: int) -> list[dict[str, Any]]:
    """The rows of one cell, each as a share of the floor, of its single vehicle, and of MAVSDK; None where none is."""
    told = []
    for row in rows:
        echo_s = row["echo_s"]
        ones = [r for r in rows if r["client"] == row["client"] and r["vehicles"] == 1 < row["vehicles"]]
        theirs = [r for r in rows if r["client"] == "MAVSDK" != row["client"] and r["vehicles"] == row["vehicles"]]
        both = {"of_one": ones, "of_mavsdk": [r for r in theirs if not r["failures"]]}
        ratios = {key: row["sent_s"] / other[0]["sent_s"] if other else None for key, other in both.items()}
        told.append({**row, "of_floor": row["sent_s"] / (echo_s * (items + 1)) if echo_s else None, **ratios})
    return told


def run_race(autopilot: Autopilot, cells: list[str], items: int, mischief: float, laps: int) -> list[dict[str, Any]]:
    """Six vehicles at once, by all clients."""
    from tools.upload.race import race  # noqa: PLC0415 (MAVSDK takes a while to load)

    every: list[dict[str, Any]] = []
    columns = ("round trip", "loss", "client", "vehicles", "echo", "sent", "held", "of floor", "of one", "of MAVSDK")
    table = Table(
        *columns,
        "messages",
        "failed",
        "wrong",
        title=f"{autopilot.name}, medians of {laps}, {items} items, real sockets",
    )
    for text in cells:
        round_trip_s, loss = map(float, text.split(":"))
        weather = Weather(round_trip_s, loss, mischief, mischief)
        found: dict[tuple[str, int], list[dict[str, Any]]] = {}
        for seed in range(1, laps + 1):
            for lap in race(autopilot, weather, items, _free_port(), seed):
                row = {"round_trip_s": round_trip_s, "loss": loss, **vars(lap)}
                found.setdefault((lap.client, lap.vehicles), []).append(row)
        for row in compared([middle(rows) for rows in found.values()], items):
            every.append({"autopilot": autopilot.name, **row})
            held = "" if row["verified_s"] is None else f"{row['verified_s']:.1f} s"
            ratios = ["" if row[k] is None else f"{row[k]:.2f}" for k in ("of_floor", "of_one", "of_mavsdk")]
            messages = "" if row["messages"] is None else f"{row['messages']:.0f}"
            cellname = (f"{1e3 * round_trip_s:.0f} ms", f"{loss:.0%}", row["client"], f"{row['vehicles']}")
            echo = "" if row["echo_s"] is None else f"{1e3 * row['echo_s']:.0f} ms"
            seconds = (echo, f"{row['sent_s']:.2f} s", held)
            table.add_row(*cellname, *seconds, *ratios, messages, f"{row['failures']}", f"{row['wrong']}")
    _print(table)
    return every


def _print(table: Table) -> None:
    Console(width=max(Console().width, 132)).print(table)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--uploads", type=int, default=200)
    parser.add_argument("--items", type=int, default=100)
    parser.add_argument("--mischief", type=float, default=0.02, help="share doubled, and overtaken, in the race")
    parser.add_argument("--race", nargs="*", default=[], metavar="ROUND_TRIP_S:LOSS")
    parser.add_argument("--laps", type=int, default=1, help="of each cell of the race")
    parser.add_argument("--autopilot", choices=("ardupilot", "px4"), default=None)
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    autopilots = [Autopilot.named(chosen.autopilot)] if chosen.autopilot else list(Autopilot)
    rows = [
        cell(autopilot, Weather(round_trip_s, loss), chosen.uploads, chosen.items, transfer)
        for autopilot in autopilots
        for round_trip_s in ROUND_TRIPS_S
        for loss in LOSSES
        for transfer in ways(autopilot)
        if chosen.uploads
    ]
    if rows:
        show(rows, chosen.uploads, chosen.items)
    laps = [
        lap
        for autopilot in autopilots
        if chosen.race
        for lap in run_race(autopilot, chosen.race, chosen.items, chosen.mischief, chosen.laps)
    ]
    if chosen.json is not None:
        chosen.json.write_text(json.dumps({"cells": rows, "race": laps}, indent=2) + "\n")


def ways(autopilot: Autopilot) -> tuple[Transfer, ...]:
    """How a mission may reach it."""
    return (Transfer.ITEMS, Transfer.FILE) if autopilot is Autopilot.ARDUPILOT else (Transfer.ITEMS,)


if __name__ == "__main__":
    main()
