"""The live table of a flight: phase, clock and nearest pair above, then one line for each vehicle.

It fits 80 columns and the terminal's height; wider terminals get longer headings.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from rich.console import Group, RenderableType
from rich.text import Text

from gcs.flight.monitoring.progress import GROUND_REACH_M, InFlight, Snapshot, VehicleNow

AS_REPORTED = "The vehicles report all figures: the error of their navigation is in them."
_WIDE = 120  # columns from which the longer headings fit
_WIDEST = 160  # columns from which fence and ceiling have their own; else the nearest of all vehicles has a line
_BAR = (5, 30)  # least and most characters
_HEADINGS = 2  # lines above the rows
_SPARE = 1  # the line of the cursor
_SILENT_S = 2.0
_BAD = "bold red"
_KEPT = 12  # redraws for which a choice stands, so that it can be read
# The least is the worst; what is not known comes last.
_WORST_BY: tuple[Callable[[VehicleNow], float], ...] = (
    lambda v: -v.link_age_s,
    lambda v: v.zone_m,
    lambda v: v.above_ground_m,
    lambda v: -v.error_m,
    lambda v: v.battery_pct,
    lambda v: v.fence_m,
    lambda v: v.ceiling_m,
)


@dataclass(frozen=True)
class _Column:
    narrow: str  # one line or two
    wide: str
    cell: Callable[[VehicleNow, float], str]  # of a vehicle and its distance to the ground
    is_bad: Callable[[VehicleNow, float], bool] = lambda _vehicle, _ground_m: False
    is_text: bool = False
    from_width: int = 0


def _figure(value: float, decimals: int, unknown: str = "–") -> str:
    return f"{value:.{decimals}f}" if math.isfinite(value) else unknown


def metres(value_m: float) -> str:
    """A distance in at most seven characters: centimetres below 1 km, then metres."""
    return _figure(value_m, 2 if abs(value_m) < 999.995 else 0)


def _ground(ground_m: float) -> str:
    return f">{GROUND_REACH_M:.0f}" if ground_m >= GROUND_REACH_M else metres(ground_m)


_COLUMNS = (
    _Column("vehicle", "vehicle", lambda v, _: str(v.sysid)),
    _Column("armed", "armed", lambda v, _: "yes" if v.armed else "no", is_text=True),
    _Column("mode", "mode", lambda v, _: v.mode or "–", is_text=True),
    _Column("height\nm", "height\nm", lambda v, _: _figure(v.height_m, 1)),
    _Column("speed\nm/s", "speed\nm/s", lambda v, _: _figure(v.speed_mps, 1)),
    _Column("battery\n%", "battery\n%", lambda v, _: _figure(v.battery_pct, 0)),
    _Column(
        "heard\ns ago",
        "last heard\ns ago",
        lambda v, _: _figure(v.link_age_s, 1, "never"),
        lambda v, _: v.link_age_s > _SILENT_S,
    ),
    _Column("", "frames lost\n%", lambda v, _: _figure(100.0 * v.loss, 1), from_width=_WIDE),
    _Column("error\ntold, m", "position error\nas reported, m", lambda v, _: _figure(v.error_m, 2)),
    _Column(
        "zone\nm",
        "to no-fly zone\nm",
        lambda v, _: "none" if v.zone_m == math.inf else metres(v.zone_m),
        lambda v, _: v.zone_m < 0.0,
    ),
    _Column("ground\nm", "to ground\nm", lambda _, ground_m: _ground(ground_m), lambda _, g: g < 0.0),
    _Column("", "to fence\nm", lambda v, _: metres(v.fence_m), lambda v, _: v.fence_m < 0.0, from_width=_WIDEST),
    _Column("", "to ceiling\nm", lambda v, _: metres(v.ceiling_m), lambda v, _: v.ceiling_m < 0.0, from_width=_WIDEST),
)


_EDGES: tuple[tuple[str, Callable[[VehicleNow], float]], ...] = (
    ("fence", lambda v: v.fence_m),
    ("ceiling", lambda v: v.ceiling_m),
)


class FlightTable:
    """Draws a flight again and again; of a large fleet it keeps the same vehicles for a few seconds."""

    def __init__(self) -> None:
        self._shown = ShownVehicles()

    def draw(self, flight: InFlight, width: int, height: int) -> RenderableType:
        """Return the picture of a flight for a terminal of `width` columns and `height` lines."""
        snapshot, vehicles = flight.snapshot(), flight.vehicles_now()
        above = [*_status(snapshot, width), *_packed(_separations(snapshot), width)]
        below = [Text(AS_REPORTED, style="dim")]
        if width < _WIDEST:
            above += _packed(_edges(vehicles), width)
        room = height - len(above) - len(below) - _HEADINGS - _SPARE
        left_out = len(vehicles) > room
        shown = self._shown.choose(vehicles, max(room - left_out, 1))
        if left_out:
            below.insert(0, Text(f"{len(vehicles) - len(shown)} vehicles more; shown are the worst of each column."))
        ground_m = flight.ground_margins_m([v.sysid for v in shown])
        return Group(*above, *_table(shown, ground_m, width), *below)


def _status(snapshot: Snapshot, width: int) -> list[Text]:
    phase = f"{snapshot.phase}: {snapshot.plan_phase}" if snapshot.plan_phase else snapshot.phase
    parts = [phase]
    if snapshot.plan_time_s is not None:
        end = f" of {snapshot.plan_end_s:.0f} s" if math.isfinite(snapshot.plan_end_s) else ""
        parts.append(f"t = {snapshot.plan_time_s:.0f} s{end}")
    if snapshot.unix_s is not None:
        parts.append(f"{datetime.fromtimestamp(snapshot.unix_s, UTC):%H:%M:%S} UTC")
    done = f" {snapshot.progress:.0%}"
    least, most = _BAR
    length = min(max(width - len("   ".join((*parts, done))), least), most)
    parts.append(f"{'█' * round(length * snapshot.progress):░<{length}}{done}")
    return _packed([(part, "bold" if part is phase else "") for part in parts], width)


def _separations(snapshot: Snapshot) -> list[tuple[str, str]]:
    parts = []
    if (nearest := snapshot.nearest) is not None:
        limit_m = snapshot.separation_min_m
        limit = f" (limit {limit_m:.2f} m)" if math.isfinite(limit_m) else ""
        text = f"nearest: vehicles {nearest.pair[0]} and {nearest.pair[1]}, {nearest.distance_m:.2f} m{limit}"
        parts.append((text, _BAD if nearest.distance_m < limit_m else ""))
    if math.isfinite(snapshot.formation_error_m):
        parts.append((f"formation error {snapshot.formation_error_m:.2f} m", ""))
    return parts


def _edges(vehicles: Sequence[VehicleNow]) -> list[tuple[str, str]]:
    parts = []
    for name, margin in _EDGES:
        known = [v for v in vehicles if math.isfinite(margin(v))]
        if known:
            nearest = min(known, key=margin)
            text = f"{name}: {metres(margin(nearest))} m (vehicle {nearest.sysid})"
            parts.append((text, _BAD if margin(nearest) < 0.0 else ""))
    return parts


def _packed(parts: Sequence[tuple[str, str]], width: int) -> list[Text]:
    lines: list[Text] = []
    for text, style in parts:
        if not lines or len(lines[-1]) + 3 + len(text) > width:
            lines.append(Text(no_wrap=True))
        elif len(lines[-1]):
            lines[-1].append("   ")
        lines[-1].append(text, style)
    return lines


def _table(vehicles: Sequence[VehicleNow], ground_m: dict[int, float], width: int) -> list[Text]:
    """Two lines of headings and one for each vehicle. rich's own tables take several times as long to draw."""
    is_wide = width >= _WIDE
    lines: list[Text] = [Text(style="bold", no_wrap=True) for _ in range(_HEADINGS)]
    lines += [Text(no_wrap=True) for _ in vehicles]
    gap = "   " if is_wide else " "
    for column in _COLUMNS:
        if width < column.from_width:
            continue
        name, _, unit = (column.wide if is_wide else column.narrow).partition("\n")
        cells = [(name, ""), (unit, "")] if unit else [("", ""), (name, "")]
        for vehicle in vehicles:
            far_m = ground_m[vehicle.sysid]
            cells.append((column.cell(vehicle, far_m), _BAD if column.is_bad(vehicle, far_m) else ""))
        across = max(len(text) for text, _ in cells)
        for line, (text, style) in zip(lines, cells, strict=True):
            blank = " " * (across - len(text))
            before, after = ("", blank) if column.is_text else (blank, "")
            line.append(f"{gap if len(line) else ''}{before}").append(text, style).append(after)
    return lines


class ShownVehicles:
    """Chooses the rows, and keeps the choice for a few redraws."""

    def __init__(self) -> None:
        self._chosen: frozenset[int] = frozenset()
        self._left = 0

    def choose(self, vehicles: Sequence[VehicleNow], most: int) -> tuple[VehicleNow, ...]:
        """At most `most` vehicles in the given order: all, or the worst of each column in turn, kept for 12 redraws."""
        if len(vehicles) <= most:
            return tuple(vehicles)
        self._left -= 1
        if self._left <= 0 or len(self._chosen) != most:
            self._chosen, self._left = worst_of_each_column(vehicles, most), _KEPT
        return tuple(v for v in vehicles if v.sysid in self._chosen)


def worst_of_each_column(vehicles: Sequence[VehicleNow], most: int) -> frozenset[int]:
    """Return the system ids of `most` vehicles: the worst of each column, then the second of each, and so on."""
    orders = [sorted(vehicles, key=lambda v: (math.isnan(figure(v)), figure(v))) for figure in _WORST_BY]
    chosen: dict[int, None] = {}
    for rank in zip(*orders, strict=True):
        for vehicle in rank:
            if len(chosen) < most:
                chosen[vehicle.sysid] = None
    return frozenset(chosen)
