"""Every vehicle as it reports itself at one moment, for display: state, link, and the margins to zones and ground."""

import math
from collections.abc import Callable, Collection, Mapping
from functools import cached_property

import numpy as np

from gcs.autopilots.traits import mode_name
from gcs.flight.monitoring.monitor import Monitor
from gcs.flight.monitoring.progress import GROUND_REACH_M, FlightPart, Snapshot, VehicleNow
from gcs.link.session.vehicle_session import VehicleSession
from gcs.mission.returns.fence_areas import inclusion_corners, inside_m, planned_places_m
from gcs.scenario.environment.ground_distance import ground_distance_m
from gcs.scenario.environment.no_fly import nearest_zone_m, zones
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.values.navigation_error import judged_separation_m
from gcs.types import Array

_BATTERY = "SYS_STATUS"


class ReportedNow:
    """Reads the sessions and the monitor of a flight, and changes nothing."""

    def __init__(self, sessions: Mapping[int, VehicleSession], monitor: Monitor) -> None:
        """`sessions` by the plan's system ids."""
        self._sessions = sessions
        self._monitor = monitor

    @cached_property
    def _fence_corners_m(self) -> Array:
        return inclusion_corners(planned_places_m(self._monitor.plan))

    def vehicles(self, in_band: Callable[[int], bool | None] | None = None) -> tuple[VehicleNow, ...]:
        """Return all vehicles, in the plan's order. `in_band` tells it of a system id."""
        plan, errors_m = self._monitor.plan, self._monitor.errors_m
        places, t_s = self._places(plan.sysids), self._monitor.plan_time_s
        known = np.asarray(np.isfinite(places).all(axis=1))
        zone_m, above_m, fence_m = (np.full(len(places), np.nan) for _ in range(3))
        north, east, up = places[known].T
        now_s = np.array(plan.t_start_s if t_s is None else t_s)
        zone_m[known] = nearest_zone_m(zones(plan.scenario), now_s, north, east, up)
        above_m[known] = up - ground_height_m(plan.scenario.terrain, north, east)
        fence_m[known] = inside_m(self._fence_corners_m, places[known])
        found = []
        for row, sysid in enumerate(plan.sysids):
            session, view = self._sessions[sysid], self._monitor.views[sysid]
            loss, rates = session.quality.loss, view.velocity_ned_mps
            status = session.latest.get(_BATTERY)
            left = -1 if status is None else int(status.fields["battery_remaining"])
            found.append(
                VehicleNow(
                    sysid,
                    mode_name(session.autopilot, session.custom_mode) if session.heard else "",
                    session.armed,
                    float(places[row, 2]),
                    float(np.linalg.norm(rates)) if known[row] else math.nan,
                    float(left) if left >= 0 else math.nan,
                    session.silent_s(),
                    math.nan if loss is None else loss,
                    errors_m[sysid],
                    float(zone_m[row]) if zones(plan.scenario) else math.inf,
                    float(above_m[row]),
                    float(fence_m[row]),
                    plan.scenario.limits.height_m[1] - float(places[row, 2]),
                    (float(places[row, 0]), float(places[row, 1]), -float(places[row, 2])),
                    (float(rates[0]), float(rates[1]), float(rates[2])),
                    None if in_band is None else in_band(sysid),
                )
            )
        return tuple(found)

    def snapshot(self, phase: str, now_s: float | None, lacks: Mapping[int, str], *, is_done: bool) -> Snapshot:
        """Return the state of the flight. `phase` is in words, `lacks` are the missing readiness conditions."""
        monitor, plan = self._monitor, self._monitor.plan
        t_s = monitor.plan_time_s
        progress = 0.0 if t_s is None else (t_s - plan.t_start_s) / (plan.t_end_s - plan.t_start_s)
        nearest = monitor.nearest_now()
        return Snapshot(
            phase,
            1.0 if is_done else min(max(progress, 0.0), 1.0),
            t_s,
            monitor.errors_m,
            {sysid: s.silent_s() for sysid, s in self._sessions.items()},
            {sysid: s.armed for sysid, s in self._sessions.items()},
            math.nan if nearest is None else nearest.distance_m,
            monitor.formation_error_m(),
            "" if t_s is None else next((p.name for p in plan.phases if p.start_s <= t_s < p.end_s), ""),
            plan.t_end_s,
            now_s,
            nearest,
            judged_separation_m(plan.scenario),
            lacks,
        )

    def ground_margins_m(self, sysids: Collection[int]) -> dict[int, float]:
        """Return distances to the ground in any direction, up to `GROUND_REACH_M`; NaN before the first report."""
        places = self._places(sysids)
        found = np.full(len(places), np.nan)
        known = np.asarray(np.isfinite(places).all(axis=1))
        if known.any():
            north, east, up = places[known].T
            found[known] = ground_distance_m(self._monitor.plan.scenario.terrain, north, east, up, GROUND_REACH_M)
        return dict(zip(sysids, found.tolist(), strict=True))

    def _places(self, sysids: Collection[int]) -> Array:
        """Places (V, 3) north, east and up.

        Before T0 they are the pads and what the vehicles have moved: separations count from the same places.
        """
        views = [self._monitor.views[sysid] for sysid in sysids]
        standing = self._monitor.part is FlightPart.TAKEOFF
        places = [view.place_ned_m if standing else view.position_ned_m for view in views]
        return np.array(places).reshape(-1, 3) * (1.0, 1.0, -1.0)
