"""The pictures of a flight: in 3D over terrain (Fig. 8), as a map (Fig. 9), and panels of the formation (Fig. 11)."""

from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gcs.flight.plots.figure_file import NAMED, Labels, colours, head, save, settle
from gcs.flight.plots.flight_map import FlightMap
from gcs.flight.plots.map_layers import map_size_in
from gcs.flight.plots.shape_view import dot_pt, view_of
from gcs.flight.plots.tracks_view import draw_tracks
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array

_SHOWN = 6  # formations at most
_PANEL_IN, _SIDE_IN, _TOP_IN = 2.9, 0.8, 0.95
_ROOM, _LEAST_ROOM_M = 0.16, 0.6
_SHAPE = (0.5, 1.5)  # height over width of a panel
_AROUND_S = 1.0  # over which the course is taken
_STILL_MPS = 0.2
_ARROW_PT = 40.0


def draw_all(plan: Plan, t_s: Array, tracks_ned_m: Array, folder: Path) -> list[Path]:
    """Write tracks.png, map.png and formation.png of tracks (V, N, 3) flown at plan times (N,); return their paths."""
    scenario, sysids = plan.scenario, plan.sysids
    planned = plan.states(np.clip(t_s, plan.t_start_s, np.nextafter(plan.t_end_s, plan.t_start_s)))[..., POSITION]
    pictures = {
        "tracks.png": draw_tracks(scenario, sysids, t_s, tracks_ned_m, plan.moves),
        "map.png": draw_map(scenario, sysids, t_s, tracks_ned_m, planned),
        "formation.png": draw_formation(scenario, sysids, t_s, tracks_ned_m, shown_s(plan)),
    }
    for name, figure in pictures.items():
        save(figure, folder / name)
    return [folder / name for name in pictures]


def shown_s(plan: Plan) -> tuple[float, ...]:
    """Return the instants at which the formation is shown: begin, end, and the ends of changes between them."""
    ends_s = [move.end_s for move in plan.moves if 0.0 < move.end_s < plan.flight_s][: _SHOWN - 2]
    return (0.0, *ends_s, plan.flight_s) if ends_s else ()


def draw_map(
    scenario: Scenario, sysids: tuple[int, ...], t_s: Array, tracks_ned_m: Array, planned_ned_m: Array | None = None
) -> Figure:
    """Return the map of tracks (V, N, 3) at plan times (N,), and of what was planned beneath them."""
    chart = FlightMap(scenario, sysids, t_s, tracks_ned_m, planned_ned_m)
    width_in, height_in = map_size_in(scenario, chart.area)
    figure, axes = plt.subplots(figsize=(width_in, height_in), layout="constrained")
    chart.draw(axes)
    head(
        axes, f"{scenario.name}: {'map' if planned_ned_m is None else 'flown (coloured) and planned (grey)'}", width_in
    )
    settle(figure)
    chart.label(axes, Labels(figure))
    return figure


def draw_formation(
    scenario: Scenario, sysids: tuple[int, ...], t_s: Array, tracks_ned_m: Array, instants_s: tuple[float, ...] = ()
) -> Figure:
    """Return the formation of tracks (V, N, 3) at plan times (N,): at given instants, else at four of the flight."""
    instants_s = instants_s or tuple(share * scenario.time.flight_s for share in (0.0, 1 / 3, 2 / 3, 1.0))
    at = [int(np.argmin(np.abs(t_s - instant))) for instant in instants_s]
    leader = tracks_ned_m[sysids.index(scenario.formation.leader)]
    offsets = [tracks_ned_m[:, n] - leader[n] for n in at]
    views = [view_of(beside) for beside in offsets]
    places = [view.flat(beside) for view, beside in zip(views, offsets, strict=True)]
    low, high = _frame(np.stack(places))
    height_in = _PANEL_IN * float((high - low)[1] / (high - low)[0])
    size = (len(at) * _PANEL_IN + _SIDE_IN, height_in + _TOP_IN)
    figure, panels = plt.subplots(
        1, len(at), figsize=size, sharex=True, sharey=True, squeeze=False, layout="constrained"
    )
    sides = any(view.is_side for view in views)
    for axes, n, beside, view in zip(panels[0], at, places, views, strict=True):
        for colour, place in zip(colours(sysids), beside, strict=True):
            axes.plot(*place, "o", ms=dot_pt(len(sysids), 8.0), color=colour, zorder=5)
        right, up = view.labels
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel=f"{right} of leader, m")
        course = _draw_course(axes, t_s, leader, n, arrow=not view.is_side)
        head(axes, f"t = {round(float(t_s[n]))} s{f', {view.words}' if sides else ''}\n{course}", _PANEL_IN, 10.0)
        axes.grid(alpha=0.3)
        if sides or axes is panels[0][0]:
            axes.set_ylabel(f"{up} of leader, m" if not view.is_side else "above the leader, m")
    settle(figure)
    labels = Labels(figure)
    for axes, beside in zip(panels[0], places, strict=True):
        labels.avoid_points(axes, beside)
        labels.avoid_arrows(axes)
        for sysid, place in zip(sysids, beside, strict=True) if len(sysids) <= NAMED else ():
            labels.place(axes, str(sysid), (float(place[0]), float(place[1])), needed=True)
    return figure


def _frame(places: Array) -> tuple[Array, Array]:
    """The least and the greatest of both axes (2,) of places (T, V, 2), with room, in a shape that can be read."""
    low, high = places.min(axis=(0, 1)), places.max(axis=(0, 1))
    room_m = max(_ROOM * float(np.max(high - low)), _LEAST_ROOM_M)
    size = high - low + 2.0 * room_m
    wanted = np.array([max(size[0], size[1] / _SHAPE[1]), max(size[1], size[0] * _SHAPE[0])])
    middle = 0.5 * (low + high)
    return middle - 0.5 * wanted, middle + 0.5 * wanted


def _draw_course(axes: Axes, t_s: Array, leader_ned_m: Array, at: int, *, arrow: bool) -> str:
    """Draw an arrow along the leader's course, where the view has one; return course and speed in words."""
    around = np.flatnonzero(np.abs(t_s - t_s[at]) <= _AROUND_S)
    first, last = around[0], around[-1]
    moved = (leader_ned_m[last] - leader_ned_m[first])[:2]
    speed_mps = float(np.linalg.norm(moved)) / max(float(t_s[last] - t_s[first]), 1e-9)
    if not speed_mps > _STILL_MPS:
        return "hovers"
    along = _ARROW_PT * moved[::-1] / float(np.linalg.norm(moved))
    if arrow:
        look = {"arrowstyle": "<|-", "color": "black", "lw": 1.3, "shrinkA": 0.0, "shrinkB": 5.0}
        axes.annotate("", (0.0, 0.0), xytext=tuple(along), textcoords="offset points", arrowprops=look, zorder=4)
    course_deg = round(float(np.degrees(np.arctan2(moved[1], moved[0])))) % 360
    return f"course {course_deg}°, {speed_mps:.1f} m/s"
