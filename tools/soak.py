"""Soak test: a formation flies for hours, and memory and handles of both processes are sampled.

./tools/run python tools/soak.py TO --hours 10 [--speedup 1] [--vehicles 6] [--leg 7200] [--every 60] [--autopilot px4]

Emulated vehicles of `missions/field` without its no-fly zones fly legs of `--leg` seconds, slowly, with a large
battery. Each leg is one `gcs fly --link` and one `sim-bridge`, until the vehicles have flown `--hours`. TO gets
samples.csv (memory, files, threads and processor time of both, size of the log) and verdict.json. Memory grows if the
slope of its least-squares line is above the limit by two standard errors. A leg's first minutes do not count.
"""

import argparse
import csv
import json
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from scipy.stats import linregress

import gcs
from gcs.link.wire.frame_scanner import frame_length
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.validation.cross_table import check
from tools.bench.frame import ROOT, options
from tools.bench.memory import sample

GCS = str(Path(sys.executable).with_name("gcs"))
COLUMNS = ("leg", "wall_s", "flown_s", "process", "rss_mb", "files", "threads", "cpu_s", "log_mb")
SETTLED_SHARE = 0.15  # of a leg: imports, upload and take-off
LIMIT_MB_PER_H = 1.0  # of flight
LAND_S = 600.0
_FAILED_LEGS_MAX = 5  # a busy machine may end one


def long_scenario(vehicles: int, leg_s: float) -> Scenario:
    """`field` flown slowly, without no-fly zones, on a battery for ten hours."""
    data = gcs.load_scenario(ROOT / "missions" / "field").model_dump(mode="json")
    data["name"], data["no_fly"], data["time"]["flight_s"] = "soak", [], leg_s
    data["vehicle"]["power"] |= {"battery_Wh": 550.0, "rotor_radius_m": 0.17, "figure_of_merit": 0.7}
    data["mission"]["tolerance_m"] = 3.0  # ArduCopter stores 650 items
    data["formation"]["vehicle"] = data["formation"]["vehicle"][:vehicles]
    made = Scenario.model_validate(data)
    if mistakes := check(made):
        raise SystemExit("\n".join(map(str, mistakes)))
    return made


def slope(hours: Sequence[float], values: Sequence[float]) -> tuple[float, float]:
    """Return the least-squares slope of values per hour, and its standard error; NaN for fewer than three."""
    if len(set(hours)) < 3:
        return float("nan"), float("nan")
    line = linregress(hours, values)
    return float(line.slope), float(line.stderr)


def verdict(rows: Sequence[dict[str, Any]], leg: int, process: str) -> dict[str, Any]:
    """What one process did in one leg, without the leg's first minutes."""
    mine = [r for r in rows if r["leg"] == leg and r["process"] == process]
    begin_s = SETTLED_SHARE * max((r["wall_s"] for r in mine), default=0.0)
    settled = [r for r in mine if r["wall_s"] >= begin_s]
    hours = [r["flown_s"] / 3600.0 for r in settled]
    per_h, error = slope(hours, [r["rss_mb"] for r in settled])
    return {
        "leg": leg,
        "process": process,
        "samples": len(settled),
        "flown_h": round(max((r["flown_s"] for r in mine), default=0.0) / 3600.0, 3),
        "rss_mb": [settled[0]["rss_mb"], settled[-1]["rss_mb"]] if settled else [],
        "rss_mb_per_h": round(per_h, 3),
        "standard_error_mb_per_h": round(error, 3),
        "files": sorted({r["files"] for r in settled}),
        "threads": sorted({r["threads"] for r in settled}),
        "log_mb": mine[-1]["log_mb"] if mine else 0.0,
        "grows": bool(per_h - 2.0 * error > LIMIT_MB_PER_H),
    }


class LogSpan:
    """The time between the first and the last frame of a growing log, by the vehicles' clocks."""

    def __init__(self) -> None:
        self._at = 0  # of the first frame that was not whole yet
        self._first_us = self._last_us = 0

    def seconds(self, path: Path) -> float:
        """Read what was added since the last call."""
        with path.open("rb") as file:
            file.seek(self._at)
            data, at = file.read(), 0
        while at + 11 <= len(data):
            after = at + 8 + frame_length(data, at + 8)
            if after > len(data):
                break
            self._last_us = int.from_bytes(data[at : at + 8])
            self._first_us = self._first_us or self._last_us  # 0 until the vehicles' time is known
            at = after
        self._at += at
        return (self._last_us - self._first_us) / 1e6


class Leg:
    """One flight of one `gcs fly` and one `sim-bridge`."""

    def __init__(self, folder: Path, scenario: Path, plan: Path, options: argparse.Namespace) -> None:
        """Start both; raises SystemExit if the vehicles do not start."""
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self._span = LogSpan()
        address = f"127.0.0.1:{options.port}"
        bridge = [sys.executable, "-m", "sim_bridge", str(scenario), "--udp", address, "--until-eof"]
        bridge += ["--speedup", str(options.speedup), "--autopilot", options.autopilot]
        with (folder / "bridge.txt").open("wb") as log:
            self.bridge = subprocess.Popen(
                bridge, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, start_new_session=True
            )
        if self.bridge.stdout is None or not self.bridge.stdout.readline():
            raise SystemExit(f"sim-bridge did not start: {(folder / 'bridge.txt').read_text()}")
        fly = [GCS, "fly", str(plan), "--to", str(folder), "--yes-arm", "--link", f"udpin:{address}"]
        with (folder / "ground.txt").open("wb") as log:
            self.ground = subprocess.Popen(
                fly, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT, start_new_session=True
            )

    def log_mb(self) -> float:
        """The size of the flight's telemetry log."""
        return sum(path.stat().st_size for path in self.folder.rglob("*.tlog")) / 1e6

    def flown_s(self) -> float:
        """The span of that log by the vehicles' clocks, which may run slower than was ordered."""
        logs = sorted(self.folder.rglob("*.tlog"))
        return self._span.seconds(logs[0]) if logs else 0.0

    def samples(self) -> dict[str, dict[str, float]]:
        """Both processes as they stand, by name; one that has ended is missing."""
        found = {}
        for name, process in (("gcs", self.ground), ("sim-bridge", self.bridge)):
            with suppress(OSError):
                found[name] = sample(process.pid)
        return found

    def end(self) -> int:
        """Land, if it still flies, and return the exit status of `gcs fly`."""
        if self.ground.poll() is None:
            self.ground.send_signal(signal.SIGINT)
        status = _ended(self.ground, LAND_S)
        if self.bridge.stdin is not None:
            self.bridge.stdin.close()
        _ended(self.bridge, 30.0)
        return status


def _ended(process: subprocess.Popen[bytes], patience_s: float) -> int:
    with suppress(subprocess.TimeoutExpired):
        return process.wait(patience_s)
    process.kill()
    return process.wait()


def soak(options: argparse.Namespace) -> dict[str, Any]:
    """Fly until the hours are over; return the verdict, which every minute's sample renews on disk."""
    to: Path = options.to
    to.mkdir(parents=True, exist_ok=True)
    scenario, plan = to / "scenario.json", to / "soak.skein"
    scenario.write_text(long_scenario(options.vehicles, options.leg).model_dump_json(indent=2), encoding="utf-8")
    subprocess.run([GCS, "plan", scenario, "--to", plan], check=True)
    rows: list[dict[str, Any]] = []
    ended: list[int] = []
    flown_s, leg = 0.0, 0
    with (to / "samples.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        while flown_s < 3600.0 * options.hours and sum(status != 0 for status in ended) <= _FAILED_LEGS_MAX:
            leg += 1
            flight = Leg(to / f"leg{leg}", scenario, plan, options)
            began_s, before_s = time.monotonic(), flown_s
            try:
                while flight.ground.poll() is None and flown_s < 3600.0 * options.hours:
                    with suppress(subprocess.TimeoutExpired):
                        flight.ground.wait(options.every)
                    leg_s = flight.flown_s()
                    flown_s = before_s + leg_s
                    times = {"leg": leg, "wall_s": round(time.monotonic() - began_s, 1), "flown_s": round(leg_s, 1)}
                    for name, seen in flight.samples().items():
                        rows.append(times | {"process": name, **seen, "log_mb": round(flight.log_mb(), 3)})
                        table.writerow(rows[-1])
                    file.flush()
                    _judge(to, options, rows, ended)
            finally:
                ended.append(flight.end())
    return _judge(to, options, rows, ended)


def _judge(
    to: Path, options: argparse.Namespace, rows: Sequence[dict[str, Any]], ended: Sequence[int]
) -> dict[str, Any]:
    """Write the verdict so far."""
    legs = sorted({r["leg"] for r in rows})
    found = [verdict(rows, leg, process) for leg in legs for process in ("gcs", "sim-bridge")]
    result = {
        "speedup": options.speedup,
        "vehicles": options.vehicles,
        "flown_h": round(sum(v["flown_h"] for v in found if v["process"] == "gcs"), 3),
        "exit_statuses": list(ended),
        "legs": found,
        "grows": any(v["grows"] for v in found),
    }
    (to / "verdict.json").write_text(json.dumps(result, indent=2), encoding="utf-8")
    return result


def main() -> None:
    """Read the options and fly."""
    defaults = {"speedup": 1.0, "vehicles": 6, "leg": 7200.0, "every": 60.0, "port": 14650}
    asked = options(__doc__, "to", hours=10.0, **defaults, autopilot=("ardupilot", "px4"))
    result = soak(asked)
    print(json.dumps(result, indent=2))
    raise SystemExit(1 if result["grows"] or result["flown_h"] < asked.hours else 0)


if __name__ == "__main__":
    main()
