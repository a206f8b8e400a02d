"""A flight whose formation and shapes come from sheets: its vehicles, its shapes, and a change to each in turn.

Shapes are figures that stand where their sheets put them, or are taken along a straight way.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from gcs.errors import counted
from gcs.scenario.schema.formation_table import START_SHAPE
from gcs.scenario.schema.scenario import Performance
from gcs.scenario.sources.flight_margins import BETTER_SENSORS, GNSS_APART_M, ground_phases_s, type_limits
from gcs.scenario.sources.flight_sheets import AIR_M, Sheet
from gcs.scenario.sources.template import FirstFlight
from gcs.scenario.validation.spacing import nearest_pair
from gcs.types import Array

_SPEED_MPS, _ACCEL_MPS2 = 3.0, 0.8  # of a vehicle in a change
_ROOM_FOR_LANES = 4.0  # times the least time of the longest path: vehicles that cross fly in altitude lanes
_HOLD_S = 10.0  # each shape stays so long
_SEPARATION_M, _CROSSING = 5.0, 0.6  # unless asked for; vehicles that cross pass nearer than they stand
_ROOM_M = (50.0, 50.0, 20.0)  # beside and above the flight
_SHORTEST_LEG_M = 0.15  # of a route; 0.1 m are allowed
_LEADER_SHARE, _LEADER_ENDS_S = 0.5, 6.0  # of its limits of speed, to the next figure; for both ends at rest


@dataclass(frozen=True)
class SheetFlight:
    """A flight that starts in the places of a sheet, and takes the shape of each further sheet.

    Without a way (`distance_m` 0) each stands in the places of its sheet, and the flight ends where it began.
    """

    is_drawn: ClassVar[bool] = False
    positions: Sheet
    shapes: tuple[Sheet, ...]
    course_deg: float
    distance_m: float
    height_m: float
    end_deg: tuple[float, float] | None = None
    separation_m: float | None = None  # to keep at all times; None: the usual one
    changes_s: tuple[float, ...] | None = None  # how long each change takes; None: an estimate with ample room
    limits: Performance = field(default_factory=type_limits)  # of the vehicles

    def quicker(self) -> None:
        """Changes of shape are as fast as they can be planned."""

    def fitting(self, longest_s: float) -> str:
        """What to give in its place, where a battery is enough for `longest_s` from take-off to touch-down."""
        way = "" if self.is_show else " or a shorter --distance"
        return f"give fewer --shapes, a lower --height{way}: {longest_s:.0f} s are enough for those"

    @property
    def least_m(self) -> float:
        """The least distance of two vehicles on the ground and in any shape, as it is written."""
        pads_m = self.positions.offsets_m * [1.0, 1.0, 0.0]
        pairs = [nearest_pair(places) for places in (pads_m, *(sheet.offsets_m for sheet in self.shapes))]
        return min(math.inf if pair is None else pair.distance_m for pair in pairs)

    @property
    def is_close(self) -> bool:
        """Whether vehicles stand too near for ordinary GNSS."""
        return self.least_m < GNSS_APART_M

    @property
    def is_show(self) -> bool:
        """Whether each shape stands in the places of its sheet: there is no way along which it could be taken."""
        return bool(self.shapes) and self.distance_m == 0.0 and self.end_deg is None

    @property
    def lift_m(self) -> float:
        """What is added to the heights of the figures: the flight's height, where a sheet has places on the ground."""
        lowest_m = min((float(sheet.places_m[:, 2].min()) for sheet in self.shapes), default=0.0)
        return self.height_m if lowest_m < AIR_M else 0.0

    @cached_property
    def figures_m(self) -> tuple[Array, ...]:
        """The places (V, 3) of each figure, north, east and up from the origin, in the order of the vehicles.

        Each vehicle takes the place that makes the sum of all squared ways least. Of places sqrt(2) times a distance
        apart, no two vehicles come nearer than that distance then, and the leader can only have such a place here: the
        planner assigns the places of all others, and by their ways as seen from the leader that is the same choice.
        """
        lift_m = np.array([0.0, 0.0, self.lift_m])
        before_m, figures_m = self._start_m, []
        for sheet in self.shapes:
            places_m = (sheet.places_m + lift_m).round(3) + 0.0
            before_m = places_m[linear_sum_assignment(cdist(before_m, places_m, "sqeuclidean"))[1]]
            figures_m.append(before_m)
        return tuple(figures_m)

    @property
    def _start_m(self) -> Array:
        """The places (V, 3) over the pads."""
        leader_m = np.array([*self.positions.places_m[0, :2], self.height_m]).round(3) + 0.0
        return np.asarray(leader_m + self.positions.offsets_m)

    @cached_property
    def _lead(self) -> int:
        """The row of the leader: in a show the first that flies to every figure, as no leg of a route has no length."""
        if not self.is_show:
            return 0
        stands_m = np.stack([self._start_m, *self.figures_m, self._start_m])
        flies = np.linalg.norm(np.diff(stands_m, axis=0), axis=2).min(axis=0) > _SHORTEST_LEG_M
        return int(flies.argmax())

    @property
    def _offsets_m(self) -> Array:
        """The places (V, 3) over the pads, from the leader."""
        return np.asarray(self.positions.offsets_m - self.positions.offsets_m[self._lead])

    @property
    def _shapes_m(self) -> list[Array]:
        """The offsets (V, 3) of each shape from its leader."""
        if self.is_show:
            return [(places_m - places_m[self._lead]).round(3) + 0.0 for places_m in self.figures_m]
        return [sheet.offsets_m for sheet in self.shapes]

    def keys(self) -> dict[str, str]:
        """What stands in the template for each @KEY@; FORMATION is the table [formation]."""
        way = self.course_deg, self.distance_m, self.height_m, self.end_deg
        straight = FirstFlight(1, "line", 10.0, *way, limits=self.limits).keys()
        course = math.radians(self.course_deg)
        leader_m = self._start_m[self._lead]
        way_m = np.round(self.distance_m * np.array([math.cos(course), math.sin(course), 0.0]), 2)
        end_m = leader_m + way_m
        if self.is_show:
            flown_m = np.concatenate([self._start_m, *self.figures_m])
        else:
            shapes_m = [self._offsets_m, *self._shapes_m]
            flown_m = np.concatenate([place + shape for place in (leader_m, end_m) for shape in shapes_m])
        room_m = np.array(_ROOM_M)
        low = 10.0 * np.floor((np.minimum(flown_m.min(axis=0), 0.0) - room_m) / 10.0)
        high = 10.0 * np.ceil((np.maximum(flown_m.max(axis=0), 0.0) + room_m) / 10.0)
        lowest_m = float(flown_m[:, 2].min())
        highest_m = self.height_m + float(self.positions.offsets_m[:, 2].max())
        flight_s, formation = self._formation(leader_m)
        yaw = straight["ATTITUDE"]
        end = [f"position_m = {_numbers(end_m)}"]
        if self.end_deg is not None:
            end = [f"position_deg = {list(self.end_deg)}", f"height_m = {self.height_m!r}"]
        takeoff_s, _ = ground_phases_s(self.limits, highest_m)
        more = f"\nground_phases = {{ takeoff_s = {takeoff_s} }}"
        if self.is_close:
            more += f"\n{BETTER_SENSORS}"
        names = ", ".join([START_SHAPE, *(sheet.name for sheet in self.shapes)])
        return straight | {
            "TITLE": f"{counted(len(self.positions.sysids), 'quadrotor')}, shapes {names}",
            "FLIGHT": repr(flight_s if self.is_show else self._along_s(flight_s, float(straight["FLIGHT"]))),
            "START": f"start = {{ position_m = {_numbers(leader_m)}{yaw} }}  ",
            "END": ('end = "start"' if self.is_show else f"end = {{ {', '.join(end)}{yaw} }}") + more,
            "BOX_NORTH": _numbers([low[0], high[0]]),
            "BOX_EAST": _numbers([low[1], high[1]]),
            "BOX_HEIGHT": _numbers([0.0, max(40.0, high[2])]),
            "CLEARANCE": repr(max(0.1, min(5.0, round(lowest_m / 2.0, 1)))),
            "SEPARATION": repr(self._separation_m()),
            "FORMATION": formation,
        }

    def _along_s(self, shown_s: float, way_s: float) -> float:
        return max(shown_s, way_s + 5.0 * math.ceil(sum(self.changes_s or ()) / 5.0))

    @property
    def usual_separation_m(self) -> float:
        """The separation where none is asked for."""
        return min(_SEPARATION_M, _CROSSING * self.least_m)

    def _separation_m(self) -> float:
        """The separation to write: never more than the sheets have."""
        asked_m = self.usual_separation_m if self.separation_m is None else self.separation_m
        return math.floor(1000.0 * min(asked_m, self.least_m) + 1e-6) / 1000.0

    def _formation(self, leader_m: Array) -> tuple[float, str]:
        """The flight's duration, s, and the table [formation]."""
        ids = self.positions.sysids
        which = "that flies to every figure" if self._lead else f"vehicle of {self.positions.file.name}"
        leader = f"leader = {ids[self._lead]}                    # the first {which}"
        lines = ["[formation]", leader]
        if self.shapes:
            lines += [f"change_speed_mps = {_SPEED_MPS}", f"change_accel_mps2 = {_ACCEL_MPS2}"]
        lines += ["vehicle = ["]
        for sysid, offset_m in zip(ids, self._offsets_m, strict=True):
            lines.append(f"  {{ sysid = {sysid}, position_m = {_numbers(leader_m + offset_m)} }},")
        lines.append("]")
        targets = [(sheet.name, offsets_m) for sheet, offsets_m in zip(self.shapes, self._shapes_m, strict=True)]
        for name, offsets_m in targets:
            lines += ["", "[[formation.shape]]", f'name = "{name}"', "offsets_m = [  # north, east, up"]
            lines += [f"  {_numbers(offset_m)}," for offset_m in offsets_m]
            lines.append("]")
        durations_s = (float(math.ceil(seconds)) for seconds in self.changes_s or ())
        if targets:
            lines += ["", '# To turn a shape: kind = "rotate", angle_deg = 72.0, at_s between the times below.']
            targets.append((START_SHAPE, self._offsets_m))
        places_m = [leader_m, *(places[self._lead] for places in self.figures_m), leader_m]
        t_s, before_m = 0.0 if self.is_show else _HOLD_S, self._offsets_m
        route: list[str] = []
        for number, (name, offsets_m) in enumerate(targets):
            lines += ["", "[[formation.change]]", 'kind = "reshape"', f'to = "{name}"', f"at_s = {t_s}"]
            t_s, before_m = t_s + next(durations_s, _change_s(before_m, offsets_m)), offsets_m
            if self.is_show:
                t_s += self._leader_s(places_m[number + 1] - places_m[number])
                place = f"position_m = {_numbers(places_m[number + 1])}"
                route += ["", "[[route]]", f'name = "{name}"', place, f"at_s = {t_s}", f"hold_s = {_HOLD_S}"]
            t_s += _HOLD_S
        if self.is_show:  # the last of these places is the end
            t_s -= _HOLD_S
            note = (
                "# Where the leader is in each figure. hold_s: how long the figure stands; at_s: when it is complete."
            )
            lines += ["", note, *route[1:-6]]
        return t_s, "\n".join(lines) + "\n"

    def _leader_s(self, way_m: Array) -> float:
        """Time for the leader's way to its place in the next figure, s."""
        mps = _LEADER_SHARE * np.array(self.limits.speed_ned_mps)
        return float(math.ceil(np.max(np.abs(way_m) / mps) + _LEADER_ENDS_S)) if way_m.any() else 0.0


def _change_s(before_m: Array, after_m: Array) -> float:
    """Time for a change, with room for paths round each other, s."""
    distances_m = cdist(before_m, after_m)
    longest_m = float(distances_m[linear_sum_assignment(distances_m**2)].max())
    return 5.0 * math.ceil(_ROOM_FOR_LANES * (longest_m / _SPEED_MPS + _SPEED_MPS / _ACCEL_MPS2) / 5.0)


def _numbers(values: Array | list[float]) -> str:
    return str([round(float(value), 3) for value in values])
