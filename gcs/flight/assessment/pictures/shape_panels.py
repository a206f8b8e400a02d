"""The shapes of a plan, one panel each, all at one scale: from above, or upright ones from the side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gcs.flight.assessment.pictures.figure_file import NAMED, colours, head
from gcs.flight.assessment.pictures.label_places import Labels
from gcs.physics.quadrotor import Array
from gcs.plan.trajectory.plan import Plan

_BESIDE_IN, _AROUND_IN, _TALLEST_IN = 0.7, 1.05, 3.4  # axis beside a panel; axis and title below and above it
_PANELS = 6  # at most
_ROOM, _LEAST_ROOM_M = 1.16, 2.0
_UPRIGHT = 0.3  # height over width: flatter shapes are seen from above
_LARGE_PT, _SMALL_PT = 8.0, 4.0
_AXES_DEG = {0: "north", 90: "east"}


@dataclass(frozen=True)
class ShownShape:
    """A shape in the plane in which it is the largest: places (V, 2) from its middle, to the right and up, m."""

    name: str
    t_s: float
    right_up_m: Array
    labels: tuple[str, str]


def shapes_of(plan: Plan) -> tuple[ShownShape, ...]:
    """Return the shape at the start and after each change, or amid one that undoes itself; none where it is rigid."""
    ends = [("start", 0.0)]
    for move in plan.moves:
        t_s = 0.5 * (move.start_s + move.end_s) if move.trigger == "auto" else min(move.end_s, plan.flight_s)
        ends.append((move.name.replace('"', ""), t_s))
    if len(ends) == 1 or len(plan.sysids) == 1:
        return ()
    ends = sorted(ends, key=lambda end: end[1])
    shown = ends if len(ends) <= _PANELS else [*ends[: _PANELS - 1], ends[-1]]
    return tuple(seen(name, t_s, plan.offsets(np.array([t_s]))[:, 0]) for name, t_s in shown)


def seen(name: str, t_s: float, offsets_ned_m: Array) -> ShownShape:
    """Return a shape (V, 3) from above; from the side where it is higher than deep, and not flat."""
    level, up_m = offsets_ned_m[:, :2] - offsets_ned_m[:, :2].mean(axis=0), -offsets_ned_m[:, 2]
    along, across = np.linalg.svd(level)[2]
    along = along * (-1.0 if along[int(np.abs(along).argmax())] < 0.0 else 1.0)  # north or east is to the right
    right_m = level @ along
    height_m = float(np.ptp(up_m))
    if height_m > max(_UPRIGHT * float(np.ptp(right_m)), float(np.ptp(level @ across))):
        towards_deg = round(float(np.degrees(np.arctan2(along[1], along[0])))) % 360
        places, labels = np.stack([right_m, up_m], axis=1), (_AXES_DEG.get(towards_deg, f"{towards_deg}°"), "up")
    else:
        places, labels = level[:, ::-1], ("east", "north")
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    return ShownShape(name, t_s, places - middle, labels)


def row_height_in(shapes: tuple[ShownShape, ...], width_in: float) -> float:
    """Return the height of a row of panels of that width."""
    return min(width_in / len(shapes) - _BESIDE_IN + _AROUND_IN, _TALLEST_IN)


def draw_shapes(panels: Any, sysids: tuple[int, ...], shapes: tuple[ShownShape, ...], width_in: float) -> None:
    """Draw each shape in its panel; `width_in` is the width of one, for the titles."""
    reach_m = max(_ROOM * max(float(np.abs(shape.right_up_m).max()) for shape in shapes), _LEAST_ROOM_M)
    size_pt = _LARGE_PT if len(sysids) <= NAMED else _SMALL_PT
    for axes, shape in zip(panels, shapes, strict=True):
        for colour, place in zip(colours(sysids), shape.right_up_m, strict=True):
            axes.plot(*place, "o", ms=size_pt, color=colour, zorder=5)
        right, up = shape.labels
        axes.set(xlim=(-reach_m, reach_m), ylim=(-reach_m, reach_m), aspect="equal", xlabel=f"{right}, m")
        axes.set_ylabel(f"{up}, m")
        axes.grid(alpha=0.3)
        view = "from above" if up == "north" else "from the side"
        head(axes, f"{shape.name}\nt = {shape.t_s:.0f} s, {view}", width_in, 9.0)


def label_shapes(panels: Any, sysids: tuple[int, ...], shapes: tuple[ShownShape, ...], labels: Labels) -> None:
    """Write the numbers of vehicles where there is room. The layout is settled by then."""
    for axes, shape in zip(panels, shapes, strict=True):
        labels.avoid_points(axes, shape.right_up_m)
        for sysid, (right_m, up_m) in zip(sysids, shape.right_up_m.tolist(), strict=True):
            if len(sysids) <= NAMED:
                labels.place(axes, str(sysid), (right_m, up_m))
