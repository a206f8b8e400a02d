"""The separation that straight returns (RTL) keep, at whatever instant of the plan all vehicles are ordered to return.

All pairs of a small fleet are bounded over intervals of start times; `proved_fleet` does it for larger ones.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.autopilots.traits import FleetFirmware
from gcs.mission.failsafe.every_start.pair_search import LONGEST_S, PairItems, PairSearch, ProvedSeparation
from gcs.mission.failsafe.every_start.start_cells import plan_intervals
from gcs.mission.failsafe.rtl_cases import return_ends
from gcs.mission.failsafe.rtl_motion import ReturnSpeeds
from gcs.physics.quadrotor import Array

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan


def proved_separation(
    plan: Plan,
    firmware: FleetFirmware,
    speeds: ReturnSpeeds,
    altitudes_m: Array,
    rally_ned_m: Array,
    required_m: float,
    seen_m: float,
) -> ProvedSeparation:
    """The proved separation of returns at these altitudes (V,); `seen_m` is a distance that is known to occur."""
    found = PairSearch(plan, return_ends(plan, firmware, rally_ned_m), speeds, altitudes_m, required_m, seen_m)
    begin_s, end_s = plan_intervals(plan, LONGEST_S)
    first, second = np.triu_indices(len(altitudes_m), 1)
    cells, pairs = len(begin_s), len(first)
    items = PairItems(np.repeat(begin_s, pairs), np.repeat(end_s, pairs), np.tile(first, cells), np.tile(second, cells))
    for to_rally in (False, True):
        found.settle(items, to_rally=to_rally)
    return found.proof
