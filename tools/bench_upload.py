"""How fast, and how surely, do missions reach vehicles over bad links? Ours beside MAVSDK's.

./tools/run python tools/bench_upload.py [--uploads 200] [--items 100] [--race 0.05:0 0.05:0.2] [--autopilot ardupilot]

The table on a fake clock delivers to the emulated stores of both autopilots, `--uploads` times per cell of round trip
and loss (in both directions, with 2 % duplicates and 2 % of all messages overtaken by 0.1 s). Seconds are simulated.
"sent" is until the upload is over, "held" until it was read back equal. The floor is one round trip per item.
The race has six vehicles at once over real sockets, in real time, in cells ROUND_TRIP_S:LOSS.
"""

from __future__ import annotations

import argparse
import json
import socket
import statistics
import sys
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from gcs.autopilot import Autopilot
from tools.upload.air import Air, Weather, mission_of

ROUND_TRIPS_S = (0.0, 0.05, 0.2)
LOSSES = (0.0, 0.05, 0.2, 0.4)


def cell(autopilot: Autopilot, weather: Weather, uploads: int, items: int) -> dict[str, Any]:
    """So many deliveries, each with a seed of its own."""
    ended = [Air(autopilot, weather, seed).deliver(mission_of(items, seed)) for seed in range(uploads)]
    held = [e for e in ended if e.error is None]
    floor_s = weather.round_trip_s * (items + 1)
    sent_s = statistics.median(e.sent_s for e in ended)
    return {
        "autopilot": autopilot.name,
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
    """The cells as a table."""
    columns = ("autopilot", "round trip", "loss", "sent", "of floor", "held", "messages", "errors", "wrong")
    table = Table(*columns, title=f"{uploads} uploads of {items} items per cell, fake clock")
    for row in rows:
        table.add_row(
            row["autopilot"],
            f"{1e3 * row['round_trip_s']:.0f} ms",
            f"{row['loss']:.0%}",
            f"{row['sent_s']:.2f} s",
            "" if row["of_floor"] is None else f"{row['of_floor']:.2f}",
            f"{row['held_s']:.2f} s",
            f"{row['messages']:.0f}",
            f"{row['errors']}",
            f"{row['wrong']}",
        )
    Console().print(table)


def run_race(autopilot: Autopilot, cells: list[str], items: int, mischief: float) -> list[dict[str, Any]]:
    """Six vehicles at once, by both clients."""
    from tools.upload.race import race  # noqa: PLC0415 (MAVSDK takes a while to load)

    rows = []
    table = Table("round trip", "loss", "client", "sent", "held", "messages", "failed", "wrong", title="six at once")
    for text in cells:
        round_trip_s, loss = map(float, text.split(":"))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            port = int(probe.getsockname()[1])
        for lap in race(autopilot, Weather(round_trip_s, loss, mischief, mischief), items, port, 1):
            rows.append({"round_trip_s": round_trip_s, "loss": loss, **vars(lap)})
            held = "" if lap.verified_s is None else f"{lap.verified_s:.1f} s"
            counts = ("" if lap.messages is None else str(lap.messages), str(lap.failures), str(lap.wrong))
            cellname = (f"{1e3 * round_trip_s:.0f} ms", f"{loss:.0%}", lap.client)
            table.add_row(*cellname, f"{lap.sent_s:.1f} s", held, *counts)
    Console().print(table)
    return rows


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--uploads", type=int, default=200)
    parser.add_argument("--items", type=int, default=100)
    parser.add_argument("--mischief", type=float, default=0.02, help="share doubled, and overtaken, in the race")
    parser.add_argument("--race", nargs="*", default=[], metavar="ROUND_TRIP_S:LOSS")
    parser.add_argument("--autopilot", choices=("ardupilot", "px4"), default=None)
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    autopilots = [Autopilot.named(chosen.autopilot)] if chosen.autopilot else list(Autopilot)
    rows = [
        cell(autopilot, Weather(round_trip_s, loss), chosen.uploads, chosen.items)
        for autopilot in autopilots
        for round_trip_s in ROUND_TRIPS_S
        for loss in LOSSES
        if chosen.uploads
    ]
    if rows:
        show(rows, chosen.uploads, chosen.items)
    laps = run_race(autopilots[0], chosen.race, chosen.items, chosen.mischief) if chosen.race else []
    if chosen.json is not None:
        chosen.json.write_text(json.dumps({"cells": rows, "race": laps}, indent=2) + "\n")


if __name__ == "__main__":
    main()
