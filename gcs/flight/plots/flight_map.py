"""The map of a flight, north up: ground, zones, the plan beneath the flown tracks, course, time marks, wind."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.path import Path as Shape
from matplotlib.transforms import Affine2D

from gcs.flight.plots import map_layers
from gcs.flight.plots.figure_file import BESIDE, NAMED, Labels, Look, colours
from gcs.flight.scene.ground_area import Area, area_of
from gcs.scenario.schema.scenario import Scenario
from gcs.types import Array

PLANNED: Look = {"color": "0.72", "lw": 3.5, "zorder": 1.9}
_STEPS_S = (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1200.0, 1800.0, 3600.0)
_MARKS = 8  # at most
_APART = 0.04  # of the map: closer marks share a place
_MOVING_M = 0.5  # less between two marks is a hover


@dataclass(frozen=True)
class FlightMap:
    """Tracks of vehicles over one time base."""

    scenario: Scenario | None  # None: a recording without a plan
    sysids: tuple[int, ...]
    t_s: Array  # (N,)
    tracks_ned_m: Array  # (V, N, 3), NaN where unknown
    planned_ned_m: Array | None = None  # (V, M, 3)
    ends: tuple[str, str] = ("take-off", "landing")

    @property
    def area(self) -> Area:
        """What the map covers."""
        return area_of(self.scenario, self.tracks_ned_m)

    @property
    def leader(self) -> int:
        """Row of the vehicle that carries the time marks; the first with positions where the leader has none."""
        known = np.asarray(np.isfinite(self.tracks_ned_m[..., 0]).any(axis=1))
        leader = self.scenario.formation.leader if self.scenario is not None else None
        row = self.sysids.index(leader) if leader in self.sysids else 0
        return row if known[row] else int(np.argmax(known))

    def draw(self, axes: Axes) -> None:
        """Draw all but the labels, with the legend to the right."""
        low, high = area = self.area
        handles: list[Artist] = [*vehicle_entries(self.sysids)]
        if self.scenario is not None:
            map_layers.draw_ground(axes, self.scenario, area)
            map_layers.draw_zones(axes, self.scenario, self._span_s)
        if self.planned_ned_m is not None:
            handles.append(Line2D([], [], **PLANNED, label="planned"))
            for track in self.planned_ned_m:
                axes.plot(track[:, 1], track[:, 0], **PLANNED)
        for colour, track in zip(colours(self.sysids), self.tracks_ned_m, strict=True):
            axes.plot(track[:, 1], track[:, 0], color=colour, lw=1.2)
        handles += self._draw_ends(axes) + self._draw_course(axes)
        handles += map_layers.draw_route(axes, self.scenario) if self.scenario is not None else []
        axes.set(xlabel="east, m", ylabel="north, m", aspect="equal", xlim=(low[1], high[1]), ylim=(low[0], high[0]))
        if self.scenario is not None:
            handles += map_layers.layer_entries(axes, self.scenario)
        axes.legend(handles=handles, **BESIDE)

    def label(self, axes: Axes, labels: Labels) -> None:
        """Write times at the marks and beside moving zones. The layout is settled by then."""
        times_s, places = self.marks()
        labels.avoid_points(axes, places[:, 1::-1])
        if self.scenario is not None:
            map_layers.label_route(axes, labels, self.scenario)
        for t_s, place in zip(times_s, places, strict=True):
            labels.place(axes, f"{t_s:.0f} s", (float(place[1]), float(place[0])))
        if self.scenario is not None:
            map_layers.label_zones(axes, labels, self.scenario, self._span_s)

    @property
    def _span_s(self) -> tuple[float, float]:
        return float(self.t_s[0]), float(self.t_s[-1])

    def _draw_ends(self, axes: Axes) -> list[Line2D]:
        known = [track[np.isfinite(track[:, 0])] for track in self.tracks_ned_m]
        ends = np.stack([track[[0, -1], 1::-1] for track in known if len(track)])
        look: Look = {"ls": "", "mfc": "black", "mec": "white", "mew": 0.5, "zorder": 5}
        begin = axes.plot(*ends[:, 0].T, marker="^", ms=6, label=self.ends[0], **look)
        return [*begin, *axes.plot(*ends[:, 1].T, marker="s", ms=5, label=self.ends[1], **look)]

    def _draw_course(self, axes: Axes) -> list[Line2D]:
        """Marks on the leader's track at round times, and an arrow between two of them where it moves."""
        times_s, places = self.marks()
        track = self.tracks_ned_m[self.leader, :, 1::-1]
        look: Look = {"ls": "", "mec": "black", "mew": 0.6, "zorder": 6}
        for begin_s, end_s in pairwise(times_s):
            at = int(np.searchsorted(self.t_s, 0.5 * (begin_s + end_s)))
            step = track[min(at + 1, len(track) - 1)] - track[at - 1]
            during = (self.t_s >= begin_s) & (self.t_s <= end_s)
            if np.isfinite(step).all() and np.linalg.norm(np.ptp(track[during], axis=0)) > _MOVING_M and step.any():
                course_deg = float(np.degrees(np.arctan2(step[0], step[1])))
                axes.plot(*track[at], marker=dart(course_deg), ms=9, mfc="gold", **look)
        axes.plot(*places[:, 1::-1].T, marker="o", ms=4.5, mfc="white", **look)
        leader = f"vehicle {self.sysids[self.leader]}"
        return [
            Line2D([], [], marker="o", ms=4.5, mfc="white", label=f"{leader} every {self._step_s:g} s", **look),
            Line2D([], [], marker=dart(0.0), ms=9, mfc="gold", label="course", **look),
        ]

    @property
    def _step_s(self) -> float:
        span_s = self._span_s[1] - self._span_s[0]
        return next((step for step in _STEPS_S if span_s / step <= _MARKS), _STEPS_S[-1])

    def marks(self) -> tuple[Array, Array]:
        """Round times (M,), and where the leader is then (M, 3), NED; of a hover the time nearest to 0."""
        first_s, last_s = self._span_s
        step_s = self._step_s
        times_s = np.arange(np.ceil(first_s / step_s), np.floor(last_s / step_s) + 1) * step_s + 0.0
        at = np.clip(np.searchsorted(self.t_s, times_s), 0, len(self.t_s) - 1)
        places = self.tracks_ned_m[self.leader, at]
        known = np.isfinite(places[:, 0])
        times_s, places = times_s[known], places[known]
        low, high = self.area
        apart_m = max(_APART * float(np.max(high - low)), _MOVING_M)
        kept: list[int] = []
        for n, place in enumerate(places):
            if not kept or np.linalg.norm((place - places[kept[-1]])[:2]) > apart_m:
                kept.append(n)
            elif abs(times_s[n]) < abs(times_s[kept[-1]]):
                kept[-1] = n
        return times_s[kept], places[kept]


def dart(course_deg: float) -> Shape:
    """Return a marker that points along a course."""
    return map_layers.DART.transformed(Affine2D().rotate_deg(-course_deg))


def vehicle_entries(sysids: tuple[int, ...], **look: Any) -> list[Line2D]:
    """Return vehicles for a legend: each by its number, or how many there are."""
    if len(sysids) > NAMED:
        return [Line2D([], [], color="0.4", label=f"{len(sysids)} vehicles", **look)]
    kinds = zip(colours(sysids), sysids, strict=True)
    return [Line2D([], [], color=colour, label=f"vehicle {sysid}", **look) for colour, sysid in kinds]
