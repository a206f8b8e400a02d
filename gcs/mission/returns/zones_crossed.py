"""No-fly zones that straight returns (RTL) cross, from any instant of the plan.

All tracks of an interval of start times lie in the hull of the places where they may begin and of their end. Intervals
are halved where a hull meets a zone, down to `_SHORTEST_S`; what is left counts as crossing.
"""

from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from gcs.autopilots.traits import FleetFirmware
from gcs.mission.returns.fence_areas import swept_area
from gcs.mission.returns.rtl_cases import Crossing, ReturnTo, return_ends
from gcs.mission.returns.start_cells import StartCells, plan_intervals, start_cells
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.no_fly import Zone, outline, zone_names, zones
from gcs.types import Array

_LONGEST_S, _SHORTEST_S = 1.0, 0.02
_CORNERS = np.array([(-1, -1), (-1, 1), (1, 1), (1, -1)])

Mask = NDArray[np.bool_]


def zones_crossed(plan: Plan, firmware: FleetFirmware, rally_ned_m: Array) -> Iterator[Crossing]:
    """The intervals of start times outside which no return of a vehicle crosses a no-fly zone."""
    ends_m = return_ends(plan, firmware, rally_ned_m).ned_m[..., :2]
    for to_rally in (False, True):
        for name, zone in zip(zone_names(plan.scenario), zones(plan.scenario), strict=True):
            begin_s, end_s = plan_intervals(plan, _LONGEST_S)
            settled: list[tuple[float, float, Mask]] = []
            while len(begin_s):
                cells = start_cells(plan, begin_s, end_s)
                meets, crosses = _met(plan, zone, cells, ends_m if to_rally else ends_m[:, :1])
                known = (meets == crosses).all(axis=0) | (end_s - begin_s <= _SHORTEST_S)
                some = np.flatnonzero(known & meets.any(axis=0))
                settled += [(float(begin_s[n]), float(end_s[n]), meets[:, n]) for n in some.tolist()]
                middle_s, left = cells.middle_s, ~known
                begin_s = np.concatenate([begin_s[left], middle_s[left]])
                end_s = np.concatenate([middle_s[left], end_s[left]])
            settled.sort(key=lambda span: span[:2])
            to = ReturnTo.either(to_rally=to_rally)
            while settled:
                from_s, to_s, rows = settled.pop(0)
                while settled and settled[0][0] <= to_s + 1e-9:
                    _, to_s, more = settled.pop(0)
                    rows = rows | more
                sysids = tuple(sysid for sysid, row in zip(plan.sysids, rows.tolist(), strict=True) if row)
                yield Crossing(name.number, to, from_s, to_s, sysids, name.keep_in)


def _met(plan: Plan, zone: Zone, cells: StartCells, ends_m: Array) -> tuple[Mask, Mask]:
    """Whether (V, N) a return of a cell may cross the zone; and whether its middle one crosses much of it."""
    places, levels_m = cells.fleet
    away_m = np.linalg.norm(places[:, :, None, :2] - ends_m[:, None], axis=-1)
    may = away_m - away_m.min(axis=-1, keepdims=True) <= 2.0 * levels_m[..., None]
    tolerance_m = plan.scenario.mission.tolerance_m
    still = None if zone.moves else outline(zone).buffer(-tolerance_m)
    meets, crosses = np.zeros(levels_m.shape, dtype=bool), np.ones(levels_m.shape, dtype=bool)
    if still is not None:
        shapely.prepare(still)
    vehicle, cell, end = np.nonzero(may)
    place, reach_m = places[vehicle, cell, :2], levels_m[vehicle, cell]
    corners = place[:, None] + reach_m[:, None, None] * _CORNERS
    to = ends_m[vehicle, end]
    hulls = shapely.convex_hull(shapely.multipoints(np.concatenate([corners, to[:, None]], axis=1)))
    middle = shapely.linestrings(np.stack([place, to], axis=1))
    if still is not None:
        met = shapely.intersects(still, hulls)
        deep = np.zeros(len(met), dtype=bool)
        # Far inside, an interval need not be halved: it counts as crossing anyway.
        near = np.flatnonzero(met)
        deep[near] = shapely.length(shapely.intersection(middle[near], still)) > 4.0 * reach_m[near]
    else:
        areas = np.array(
            [swept_area(zone, -tolerance_m, a, b) for a, b in zip(cells.begin_s, cells.end_s, strict=True)]
        )
        met = shapely.intersects(areas[cell], hulls)
        deep = met.copy()
    np.logical_or.at(meets, (vehicle, cell), met)
    np.logical_and.at(crosses, (vehicle, cell), deep)
    return meets, crosses
