"""What do exports cost? Every format for 6 and for 1,000 vehicles, and what other programs take to read the missions.

./tools/run python tools/bench_export.py [--vehicles 6 1000] [--repeat 3] [--rate HZ] [--json FILE]

The flight of `bench_scale`: Simulation 1 over its seven mountains for a grid of so many vehicles. Seconds are medians
of whole exports of one format each, with all they share: placing waypoints, returns, and verification where missions
are written. Bytes are what is on disk. Beside them: reading the same `.plan` and `.waypoints` back with this program,
MAVSDK and pymavlink's mavwp. MAVSDK wants a vehicle before it reads: a heartbeat on a local port is one.
"""

from __future__ import annotations

import argparse
import json
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

os.environ["MAVLINK20"] = "1"

import mavsdk
from mavsdk.plugins.mission_raw import MissionRaw
from pymavlink import mavwp
from pymavlink.dialects.v20 import ardupilotmega
from rich.console import Console
from rich.table import Table

import gcs
from gcs.autopilots.traits import Autopilot
from gcs.mission.export.export import export
from gcs.mission.formats.any_mission import read_mission
from gcs.mission.formats.registry import FORMATS
from gcs.plan.trajectory.plan import Plan

ROOT = Path(__file__).resolve().parent.parent
RATE_HZ = 25.0


def measure(vehicles: int, rate_hz: float) -> dict[str, Any]:
    """One run in this process: seconds and bytes by format, seconds by reader."""
    plan = fleet_plan(vehicles)
    run: dict[str, Any] = {"vehicles": vehicles, "formats": {}, "readers": {}}
    with tempfile.TemporaryDirectory() as name:
        for form in FORMATS:
            run["formats"][form.name] = timed_export(plan, Path(name) / form.name, [form.name], rate_hz)
        run["formats"]["default"] = timed_export(plan, Path(name) / "default", None, rate_hz)
        run["readers"] = readers(Path(name) / "plan", Path(name) / "waypoints")
    return run


def fleet_plan(vehicles: int) -> Plan:
    """The plan to export."""
    if str(ROOT) not in sys.path:
        sys.path.insert(0, str(ROOT))
    from tools.bench_scale import scenario  # noqa: PLC0415 (found through the path above)

    return gcs.make_plan(scenario(vehicles))


def timed_export(plan: Plan, folder: Path, formats: list[str] | None, rate_hz: float) -> dict[str, float]:
    """Seconds of one export, and the bytes it left."""
    chosen = {} if formats is None else {"formats": formats}
    began = time.perf_counter()
    export(plan, folder, setpoint_rate_hz=rate_hz, **chosen)  # type: ignore[arg-type]
    seconds = time.perf_counter() - began
    return {"seconds": seconds, "bytes": float(sum(p.stat().st_size for p in folder.iterdir()))}


def readers(plans: Path, tables: Path) -> dict[str, float]:
    """Seconds each program takes to read all missions of a folder."""
    found = {
        "Skein .plan": seconds_for(plans, "plan", lambda p: read_mission(p.read_bytes(), p.name)),
        "Skein .waypoints": seconds_for(tables, "waypoints", lambda p: read_mission(p.read_bytes(), p.name)),
        "mavwp .waypoints": seconds_for(tables, "waypoints", lambda p: mavwp.MAVWPLoader().load(str(p))),
    }
    with importer() as reader:
        found["MAVSDK .plan"] = seconds_for(plans, "plan", lambda p: reader.import_qgroundcontrol_mission(str(p)))
        found["MAVSDK .waypoints"] = seconds_for(
            tables, "waypoints", lambda p: reader.import_mission_planner_mission(str(p))
        )
    return found


def seconds_for(folder: Path, suffix: str, read: Callable[[Path], object]) -> float:
    """Read every file of a folder once."""
    paths = sorted(folder.glob(f"*.{suffix}"))
    began = time.perf_counter()
    for path in paths:
        read(path)
    return time.perf_counter() - began


@contextmanager
def importer() -> Iterator[MissionRaw]:
    """MAVSDK's reader, connected to a heartbeat."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    sdk = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
    enough = threading.Event()

    def beat() -> None:
        link = ardupilotmega.MAVLink(None, srcSystem=1, srcComponent=1)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            while not enough.wait(0.1):
                message = link.heartbeat_encode(2, int(Autopilot.ARDUPILOT), 81, 0, 3)
                vehicle.sendto(message.pack(link), ("127.0.0.1", port))

    heart = threading.Thread(target=beat)
    try:
        sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        heart.start()
        while not (systems := [s for s in sdk.get_systems() if s.is_connected() and s.has_autopilot()]):
            enough.wait(0.05)
        yield MissionRaw(systems[0])
    finally:
        enough.set()
        heart.join()
        sdk.destroy()


def main() -> None:
    """Run, print, and write what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, nargs="+", default=[6, 1000])
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--rate", type=float, default=RATE_HZ, help="setpoints per second")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--one", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one is not None:
        print(json.dumps(measure(options.one, options.rate)))
        return
    runs = []
    for _ in range(options.repeat):
        for vehicles in options.vehicles:
            runs.append(_in_its_own_process(vehicles, options.rate))
            print(
                f"{vehicles:5d} vehicles: default export {runs[-1]['formats']['default']['seconds']:.1f} s", flush=True
            )
    medians = [_median([run for run in runs if run["vehicles"] == vehicles]) for vehicles in options.vehicles]
    show(medians)
    if options.json:
        options.json.write_text(json.dumps({"runs": runs, "medians": medians}, indent=1), encoding="utf-8")


def show(medians: list[dict[str, Any]]) -> None:
    """Two tables, a pair of columns for every size."""
    console = Console(width=110)
    table = Table(
        title=f"one format exported, medians; setpoints and histories at {RATE_HZ:g} Hz unless asked otherwise"
    )
    readers_table = Table(title="reading all missions")
    table.add_column("format")
    readers_table.add_column("reader")
    for run in medians:
        table.add_column(f"{run['vehicles']} vehicles", justify="right")
        table.add_column("on disk", justify="right")
        readers_table.add_column(f"{run['vehicles']} vehicles", justify="right")
        readers_table.add_column("each", justify="right")
    for name in medians[0]["formats"]:
        cells = [run["formats"][name] for run in medians]
        table.add_row(name, *(text for c in cells for text in (f"{c['seconds']:.2f} s", f"{c['bytes'] / 1e6:.2f} MB")))
    for name in medians[0]["readers"]:
        pairs = [(run["readers"][name], run["vehicles"]) for run in medians]
        readers_table.add_row(name, *(text for s, n in pairs for text in (f"{s:.3f} s", f"{s / n * 1e3:.2f} ms")))
    console.print(table)
    console.print(readers_table)


def _in_its_own_process(vehicles: int, rate_hz: float) -> dict[str, Any]:
    command = [sys.executable, __file__, "--one", str(vehicles), "--rate", str(rate_hz)]
    done = subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT)
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


def _median(runs: list[dict[str, Any]]) -> dict[str, Any]:
    first = runs[0]
    return {
        "vehicles": first["vehicles"],
        "formats": {
            name: {key: statistics.median(run["formats"][name][key] for run in runs) for key in cells}
            for name, cells in first["formats"].items()
        },
        "readers": {name: statistics.median(run["readers"][name] for run in runs) for name in first["readers"]},
    }


if __name__ == "__main__":
    main()
