"""Random lines that a person may type after `gcs new FOLDER`, with the sheets and drawings that they name."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from random import Random

from gcs.scenario.sources.template import SHAPES

_LAT_DEG, _LON_DEG = 47.4, 8.5
_NORTH_DEGPM = 1.0 / 111_320.0
_EAST_DEGPM = _NORTH_DEGPM / math.cos(math.radians(_LAT_DEG))


def options(kind: str, dice: Random) -> list[str]:
    """The options of one line; sheets and drawings are written into the current folder."""
    return list({"first": _first, "sheets": _sheets, "route": _route, "survey": _survey}[kind](dice))


def _some(dice: Random, chance: float, option: str, *values: object) -> Iterator[str]:
    if dice.random() < chance:
        yield from (option, str(dice.choice(values)))


def _first(dice: Random) -> Iterator[str]:
    yield from ("--count", str(dice.choice([1, 2, 3, 5, 7, 12, 20, 40])))  # with no option there is a no-fly zone
    yield from _some(dice, 0.7, "--shape", *SHAPES)
    yield from _some(dice, 0.6, "--spacing", 1, 1.5, 2, 3, 5, 8, 15, 30)
    yield from _some(dice, 0.6, "--height", 1, 3, 8, 15, 22.5, 40, 80, 120, 300, 600)
    if dice.random() < 0.2:
        ends = (deg + dice.uniform(-2e-3, 2e-3) for deg in (_LAT_DEG, _LON_DEG))
        yield from ("--at", f"{_LAT_DEG},{_LON_DEG}", "--end", ",".join(f"{deg:.5f}" for deg in ends))
        return
    yield from _some(dice, 0.5, "--course", "east", "30", "sw", "-100", "181.7")
    yield from _some(dice, 0.8, "--distance", 0, 1, 5, 40, 120, 400, 1000, 2000, 3000, 3300, 5000)
    yield from _some(dice, 0.3, "--at", *(f"{_LAT_DEG},{_LON_DEG},{alt_m}" for alt_m in (0, 800, 2500, 4500)))


def _sheets(dice: Random) -> Iterator[str]:
    count, step_m = dice.choice([2, 3, 4, 6, 9, 12]), dice.choice([2.0, 2.5, 3.0, 5.0, 8.0])
    across, height_m = math.ceil(math.sqrt(count)), dice.choice([10.0, 15.0, 25.0, 40.0, 60.0])
    grid = [divmod(number, across) for number in range(count)]
    _sheet("pads.csv", [(step_m * a, step_m * b, 0.0) for a, b in grid])
    yield from ("--positions", "pads.csv")
    for number in range(dice.choice([0, 1, 1, 2, 3])):
        apart_m = step_m * dice.choice([0.8, 1.0, 1.5, 2.5])
        kind = dice.choice(["ring", "line", "upright", "grid"])
        if kind == "ring":
            radius_m, turn = apart_m / (2.0 * math.sin(math.pi / count)), 2.0 * math.pi / count
            rows = [(radius_m * math.cos(turn * n), radius_m * math.sin(turn * n), height_m) for n in range(count)]
        elif kind == "line":
            rows = [(apart_m * n, 0.0, height_m) for n in range(count)]
        elif kind == "upright":
            rows = [(apart_m * b, 0.02 * a, height_m + apart_m * a) for a, b in grid]
        else:
            rows = [(apart_m * a, apart_m * b, height_m) for a, b in grid]
        if dice.random() < 0.5:
            dice.shuffle(rows)
        _sheet(f"shape{number}.csv", rows)
        yield from ("--shapes", f"shape{number}.csv")
    yield from _some(dice, 0.7, "--distance", 0, 1, 30, 100, 200, 600)
    yield from _some(dice, 0.4, "--spacing", 0.5 * step_m, 0.8 * step_m, step_m)
    yield from _some(dice, 0.3, "--height", 8, 20, 50, 100)
    yield from _some(dice, 0.3, "--course", "east", "30", "sw")


def _route(dice: Random) -> Iterator[str]:
    north_m = east_m = 0.0
    course, height_m = dice.uniform(0.0, 2.0 * math.pi), dice.choice([12, 20, 35, 80])
    rows = []
    for _ in range(dice.choice([2, 3, 4, 6, 8])):
        rows.append((*_degrees(north_m, east_m), height_m))
        course, length_m = course + dice.uniform(-1.8, 1.8), dice.choice([20, 40, 80, 150])
        north_m, east_m = north_m + length_m * math.cos(course), east_m + length_m * math.sin(course)
        height_m = max(12, height_m + dice.choice([0, 0, 0, -8, 8, 20]))
    if dice.random() < 0.3:
        rows.append(rows[0])
    speed_mps = dice.choice([None, 1.5, 3, 5, 8])
    lines = ["QGC WPL 110", _waypoint(0, 16, [0, 0, 0, 0, *rows[0][:2], 450.0])]
    if speed_mps is not None:
        lines.append(_waypoint(len(lines), 178, [1, speed_mps, -1, 0, 0, 0, 0]))
    lines += [_waypoint(len(lines) + n, 16, [dice.choice([0, 0, 5]), 0, 0, 0, *row]) for n, row in enumerate(rows)]
    Path("drawn.waypoints").write_text("\n".join(lines) + "\n", encoding="utf-8")
    yield from ("--route", "drawn.waypoints")
    yield from _some(dice, 0.7, "--count", 1, 2, 4, 6, 9)
    yield from _some(dice, 0.5, "--shape", *SHAPES)
    yield from _some(dice, 0.4, "--spacing", 1.5, 3, 6, 10)


def _survey(dice: Random) -> Iterator[str]:
    corners, turn = dice.choice([3, 4, 4, 5, 6]), dice.uniform(0.0, math.pi)
    half_m = dice.choice([15, 30, 50, 90]), dice.choice([20, 40, 75, 125])
    ring = []
    for number in range(corners):
        angle = 2.0 * math.pi * number / corners + dice.uniform(-0.3, 0.3)
        a, b = half_m[0] * math.cos(angle), half_m[1] * math.sin(angle)
        lat_deg, lon_deg = _degrees(a * math.cos(turn) - b * math.sin(turn), a * math.sin(turn) + b * math.cos(turn))
        ring.append([lon_deg, lat_deg])
    area = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
    Path("area.geojson").write_text(json.dumps({"type": "Feature", "properties": {}, "geometry": area}))
    yield from ("--survey", "area.geojson", "--swath", str(dice.choice([6, 8, 10, 15, 20, 30])))
    yield from _some(dice, 0.4, "--count", 1, 2, 3, 4, 8)
    yield from _some(dice, 0.4, "--speed", 1, 2, 3, 4.5)
    yield from _some(dice, 0.4, "--height", 10, 30, 60, 100)
    yield from _some(dice, 0.3, "--overlap", "0", "10%", "40%", "70%")
    yield from _some(dice, 0.3, "--angle", 0, 30, 77, 120)
    if dice.random() < 0.3:
        yield from ("--at", f"{_LAT_DEG + dice.uniform(-2e-3, 2e-3):.5f},{_LON_DEG:.5f},410")


def _sheet(name: str, rows: list[tuple[float, float, float]]) -> None:
    lines = [f"{n},{x:.3f},{y:.3f},{z:.2f}" for n, (x, y, z) in enumerate(rows, start=1)]
    Path(name).write_text("\n".join(["number,x,y,z", *lines]) + "\n", encoding="utf-8")


def _waypoint(number: int, command: int, numbers: list[float]) -> str:
    frame = 0 if number == 0 else 3
    return "\t".join(map(str, [number, int(number == 0), frame, command, *numbers, 1]))


def _degrees(north_m: float, east_m: float) -> tuple[float, float]:
    return round(_LAT_DEG + north_m * _NORTH_DEGPM, 7), round(_LON_DEG + east_m * _EAST_DEGPM, 7)
