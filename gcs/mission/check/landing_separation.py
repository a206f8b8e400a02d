"""The separation in the landing phase of a plan, in which every vehicle descends at its own autopilot's speeds.

Streams and missions both end with the landing of the autopilot. All vehicles are ordered to land at one time. Two of
them may begin some seconds apart: the distance is the least of all such differences.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from gcs.autopilots.columns import LandingProfile
from gcs.autopilots.traits import Autopilot, titles
from gcs.errors import VerificationError
from gcs.mission.predicted.closest_approach import Closest
from gcs.physics.states import POSITION
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.navigation_error import judged_separation_m
from gcs.types import Array


@dataclass(frozen=True)
class LandingDescent:
    """A vertical descent that is ordered at time 0: heights (N,) above the origin's at times (N,), linear between."""

    over_m: tuple[float, float]  # north, east
    t_s: Array
    up_m: Array

    @classmethod
    def of(
        cls, profile: LandingProfile, over_m: tuple[float, float], from_m: float, ground_m: float, home_m: float
    ) -> LandingDescent:
        """Return the descent from `from_m` to the ground; all heights are above the origin's."""
        t_s, height_m = profile.knots(from_m - home_m, ground_m - home_m)
        return cls(over_m, t_s, height_m + home_m)

    def at(self, t_s: Array) -> Array:
        """Return the heights at times."""
        return np.asarray(np.interp(t_s, self.t_s, self.up_m))


def planned_descents(
    plan: Plan, autopilots: Sequence[Autopilot], parameters: Sequence[Mapping[str, float]]
) -> tuple[LandingDescent, ...]:
    """Return the descents of a plan's vehicles with these autopilots and parameters, in the plan's order."""
    over = plan.states(np.array([plan.phase(PhaseKind.LANDING).start_s]))[:, 0, POSITION]
    heights = -np.stack([over[:, 2], plan.landing_points_ned_m[:, 2], plan.pads_ned_m[:, 2]], axis=1)
    rows = zip(autopilots, parameters, plan.landing_points_ned_m.tolist(), heights.tolist(), strict=True)
    return tuple(
        LandingDescent.of(known.traits.landing.profile(given), (north, east), *heights_m)
        for known, given, (north, east, _), heights_m in rows
    )


def closest_in_descent(
    descents: Sequence[LandingDescent], within_m: float, apart_s: Sequence[float] | None = None
) -> Closest | None:
    """Return the nearest two vehicles until the last one is on the ground, with its time since the order.

    Pairs that stay farther apart than `within_m` may be left out. Of two vehicles the larger `apart_s` counts: one of
    them may be ordered to land that much before or after the other.
    """
    if len(descents) < 2:
        return None
    best: Closest | None = None
    slack_s = (0.0,) * len(descents) if apart_s is None else apart_s
    pairs = KDTree([descent.over_m for descent in descents]).query_pairs(within_m)
    for first, second in sorted(pairs):
        one, other = descents[first], descents[second]
        gap_m, t_s = _least_gap_m(one, other, max(slack_s[first], slack_s[second]))
        distance_m = float(np.hypot(np.hypot(*np.subtract(one.over_m, other.over_m)), gap_m))
        if best is None or distance_m < best.distance_m:
            best = Closest(distance_m, t_s, (first, second))
    return best


def refuse_close_landing(
    plan: Plan, autopilots: Sequence[Autopilot], parameters: Sequence[Mapping[str, float]], may_differ_s: float = 0.0
) -> None:
    """Raise `VerificationError` if two vehicles of a plan come too close while their autopilots land them.

    An order to land that is lost is repeated, and missions may differ in time, each by `may_differ_s` besides: all of
    it is allowed for.
    """
    required_m = judged_separation_m(plan.scenario)
    slack_s = 2.0 * may_differ_s
    apart_s = [max(known.traits.apart_s + slack_s, known.traits.link.timers.command.reply_s) for known in autopilots]
    closest = closest_in_descent(planned_descents(plan, autopilots, parameters), required_m, apart_s)
    if closest is None or closest.distance_m >= required_m:
        return
    first, second = closest.pair
    landing_s = plan.phase(PhaseKind.LANDING).start_s
    points = plan.landing_points_ned_m[[first, second], :2]
    beside_m = float(np.hypot(*(points[1] - points[0])))
    flown = titles((autopilots[first], autopilots[second]))
    raise VerificationError(
        f"vehicles {plan.sysids[first]} and {plan.sysids[second]} may come within {closest.distance_m:.2f} m in the "
        f"landing at {landing_s + closest.t_s:.1f} s ({required_m:g} m required). Under {flown} they descend at their "
        f"own speeds, not at those of the plan, and may begin {max(apart_s[first], apart_s[second]):.3g} s apart.",
        hint=f"their landing points are {beside_m:.2f} m apart horizontally: end the plan in a shape where it is "
        f"{required_m:g} m or more, which is enough at any speed",
    )


def _least_gap_m(one: LandingDescent, other: LandingDescent, apart_s: float) -> tuple[float, float]:
    """Return the least difference of height, and its time, with `other` up to `apart_s` earlier or later than `one`.

    Heights only fall. At every instant the other one is therefore between its height `apart_s` ago and that in
    `apart_s` from now, and the gap to this interval is linear between the knots.
    """
    ends_s = max(float(one.t_s[-1]), float(other.t_s[-1]) + apart_s)
    t_s = np.unique(np.concatenate([one.t_s, other.t_s - apart_s, other.t_s + apart_s, [0.0, ends_s]]))
    t_s = t_s[(t_s >= 0.0) & (t_s <= ends_s)]
    here_m = one.at(t_s)
    above_m, below_m = here_m - other.at(t_s - apart_s), other.at(t_s + apart_s) - here_m
    gap_m = np.where(above_m > 0.0, above_m, np.where(below_m > 0.0, -below_m, 0.0))  # negative: it is below
    passes = np.flatnonzero(gap_m[:-1] * gap_m[1:] < 0.0)
    if len(passes):
        return 0.0, float(t_s[passes[0]])
    at = int(np.argmin(np.abs(gap_m)))
    return float(abs(gap_m[at])), float(t_s[at])
