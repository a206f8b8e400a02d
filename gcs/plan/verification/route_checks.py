"""The route of a plan: the leader is at every point ahead, in order, as the point asks for it.

Checks at instants are exact. A hold is bounded at every instant, from the leader's polynomials.
"""

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
from scipy.interpolate import PPoly

from gcs.physics.states import ATTITUDE, POSITION, VELOCITY
from gcs.plan.trajectory.constraint_id import ConstraintId, Kind
from gcs.plan.trajectory.leg_lines import LegLine
from gcs.plan.trajectory.passages import Passage
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.proof.polynomials import enclosed
from gcs.plan.verification.proof.verdict import ANGLE_TOLERANCE_DEG, LENGTH_TOLERANCE_M, SPEED_TOLERANCE_MPS, Check
from gcs.scenario.environment.ground_distance import steepness
from gcs.scenario.values.si import route_points
from gcs.types import Array

TIME_TOLERANCE_S = 1e-3
_FIRST_S, _SHORTEST_S = 0.05, 5e-5  # between instants at which the height above the ground is computed
_NEAR = 0.002  # how much a bound may be above what is reached
_PARTS = 16  # of a hold's polynomials, each bounded on its own
_ORDER = 3
_PLACE_AND_YAW = [0, 1, 2, 8]
_YAW = 2  # among the angles
# Kind, unit, what is left at one point, its tolerance, when, and the bound of it, which is no more.
_Margin = tuple[Kind, str, float, float, float, float]


def route_checks(plan: Plan) -> list[Check]:
    """One check of each kind: its worst point, by number and name. None without a route.

    A plan that begins in the air answers for the points that its times are of.
    """
    wanted = len(route_points(plan.scenario))
    missing = abs(wanted - len(plan.route_s))
    if missing and (plan.begin_state is None or len(plan.route_s) > wanted):
        end_s = plan.phase(PhaseKind.MISSION).end_s
        passed = ConstraintId(Kind.POINTS_PASSED)
        return [Check(passed, PhaseKind.MISSION, "points", -missing, 0.0, None, end_s, -missing)]
    sysid = plan.sysids[plan.leader]
    worst: dict[Kind, tuple[float, Check]] = {}
    for passage in plan.passages:
        for kind, unit, margin, tolerance, t_s, proved in (
            *_order(plan, passage),
            *_at(plan, passage),
            *_hold(plan, passage),
        ):
            left = min(margin, proved)
            left = -np.inf if np.isnan(left) else left
            if kind not in worst or left < worst[kind][0]:
                name = ConstraintId(kind, of=passage.title)
                worst[kind] = left, Check(name, PhaseKind.MISSION, unit, margin, tolerance, sysid, t_s, proved)
    return [check for _, check in worst.values()] + _line_checks(plan, sysid)


def _line_checks(plan: Plan, sysid: int) -> list[Check]:
    """The worst leg for its corridor, its height, its ends and its yaw, at every instant between two points.

    Beyond the points at its ends the leader flies no farther than it may from the line, or from the points.
    """
    if not plan.lines:
        return []
    worst: dict[Kind, tuple[float, Check]] = {}
    mission, made = plan.phase(PhaseKind.MISSION), plan.passages
    begins = mission.start_s, *(passage.leaves_s for passage in made)
    ends = *(passage.arrives_s for passage in made), mission.end_s
    near_m = [0.0, *(passage.point.radius_m or 0.0 for passage in made), 0.0]
    for line, start_s, end_s, radii_m in zip(plan.lines, begins, ends, pairwise(near_m), strict=True):
        middle, along, ends_m = line.along
        beyond_m = max(line.limits.height_m if line.is_steep else line.limits.corridor_m, *radii_m)
        for kind, origin, rows, most, unit, tolerance in (
            (Kind.LEG_CORRIDOR, line.begin, line.rows[:2], line.limits.corridor_m, "m", LENGTH_TOLERANCE_M),
            (Kind.LEG_HEIGHT, line.begin, line.rows[2:3], line.limits.height_m, "m", LENGTH_TOLERANCE_M),
            (Kind.LEG_ENDS, middle, along, ends_m + beyond_m, "m", LENGTH_TOLERANCE_M),
            (Kind.LEG_YAW, line.begin, line.rows[3:], line.limits.yaw_rad, "deg", ANGLE_TOLERANCE_DEG),
        ):
            if np.isinf(most) or not start_s < end_s:
                continue
            if kind is Kind.LEG_HEIGHT and line.ground is not None:
                seen, bound, t_s = _farthest_from_ground_line(plan, line, (start_s, end_s))
            else:
                allowed = most + (float(np.radians(tolerance)) if kind is Kind.LEG_YAW else tolerance)
                seen, bound, t_s = _farthest(plan, _PLACE_AND_YAW, origin, (start_s, end_s), allowed, rows)
            margin, proved = (float(np.degrees(m) if kind is Kind.LEG_YAW else m) for m in (most - seen, most - bound))
            if kind not in worst or proved < worst[kind][0]:
                name = ConstraintId(kind, of=line.number)
                worst[kind] = proved, Check(name, PhaseKind.MISSION, unit, margin, tolerance, sysid, t_s, proved)
    return [check for _, check in worst.values()]


def _exact(kind: Kind, unit: str, margin: float, tolerance: float, t_s: float) -> _Margin:
    return kind, unit, margin, tolerance, t_s, margin


def _order(plan: Plan, passage: Passage) -> Iterator[_Margin]:
    """The point is left before the next one is reached, and before the arrival."""
    mission, made = plan.phase(PhaseKind.MISSION), plan.passages
    index = made.index(passage)
    later_s = made[index + 1].arrives_s if index + 1 < len(made) else mission.end_s
    yield _exact(Kind.POINT_ORDER, "s", later_s - passage.leaves_s, 0.0, passage.leaves_s)
    if not _is_under_way(plan, passage):
        yield _exact(Kind.POINT_ORDER, "s", passage.arrives_s - mission.start_s, 0.0, passage.arrives_s)


def _is_under_way(plan: Plan, passage: Passage) -> bool:
    """Whether the leader holds at the point while the plan begins in the air: it arrived before."""
    return plan.begin_state is not None and passage.arrives_s < plan.phase(PhaseKind.MISSION).start_s < passage.leaves_s


def _at(plan: Plan, passage: Passage) -> Iterator[_Margin]:
    """Place, time, speed and heading at the arrival."""
    if _is_under_way(plan, passage):
        return
    point, t_s = passage.point, passage.arrives_s
    state = plan.leader_trajectory.state(t_s)
    away_m = float(np.linalg.norm(state[POSITION] - passage.position_ned_m))
    yield _exact(Kind.POINT_DISTANCE, "m", (point.radius_m or 0.0) - away_m, LENGTH_TOLERANCE_M, t_s)
    if point.at_s is not None:
        yield _exact(Kind.POINT_TIME, "s", -abs(t_s - point.at_s), TIME_TOLERANCE_S, t_s)
    if point.after_s is not None:
        yield _exact(Kind.POINT_TIME, "s", t_s - point.after_s, TIME_TOLERANCE_S, t_s)
    if point.by_s is not None:
        yield _exact(Kind.POINT_TIME, "s", point.by_s - t_s, TIME_TOLERANCE_S, t_s)
    if point.speed_mps is not None:
        off_mps = abs(float(np.linalg.norm(state[VELOCITY])) - point.speed_mps)
        yield _exact(Kind.POINT_SPEED, "m/s", -off_mps, SPEED_TOLERANCE_MPS, t_s)
    if point.heading_deg is not None:
        off_deg = abs((float(np.degrees(state[ATTITUDE][_YAW])) - point.heading_deg + 180.0) % 360.0 - 180.0)
        yield _exact(Kind.POINT_HEADING, "deg", -off_deg, ANGLE_TOLERANCE_DEG, t_s)


def _hold(plan: Plan, passage: Passage) -> Iterator[_Margin]:
    """Over the whole hold the leader stays at the point, at rest."""
    start_s, end_s = max(passage.arrives_s, plan.phase(PhaseKind.MISSION).start_s), passage.leaves_s
    if not passage.point.hold_s or not start_s < end_s:
        return
    for kind, unit, columns, at_rest, tolerance in (
        (Kind.HOLD_DISTANCE, "m", POSITION, passage.position_ned_m, LENGTH_TOLERANCE_M),
        (Kind.HOLD_SPEED, "m/s", VELOCITY, np.zeros(3), SPEED_TOLERANCE_MPS),
    ):
        seen, bound, t_s = _farthest(plan, columns, at_rest, (start_s, end_s), tolerance)
        yield kind, unit, -seen, tolerance, t_s, -bound


def _farthest(
    plan: Plan,
    columns: slice | list[int],
    from_here: Array,
    span_s: tuple[float, float],
    allowed: float,
    rows: Array | None = None,
) -> tuple[float, float, float]:
    """The largest distance of three states from constants over a span: one that is reached, a bound, and when.

    With `rows` (R, C), of what these take from the difference of C states.
    """
    every = plan.leader_trajectory.state
    picked = np.eye(len(from_here)) if rows is None else rows
    motion = PPoly(np.einsum("dpk,rk->dpr", every.c[..., columns], picked), every.x)
    joints_s = motion.x[(motion.x > span_s[0]) & (motion.x < span_s[1])]
    parts = [np.linspace(a, b, _PARTS, endpoint=False) for a, b in pairwise([span_s[0], *joints_s, span_s[1]])]

    def away(start_s: Array, end_s: Array) -> tuple[Array, Array]:
        model = enclosed(motion, start_s, end_s, _ORDER) - (picked @ from_here)[:, None]
        return np.linalg.norm(model.middle, axis=0), np.linalg.norm(model.size(), axis=0)

    return _greatest(away, np.append(np.concatenate(parts), span_s[1]), allowed)


def _farthest_from_ground_line(plan: Plan, line: LegLine, span_s: tuple[float, float]) -> tuple[float, float, float]:
    """The largest distance above or below a line that follows the ground: one that is reached, a bound, and when.

    Between two instants it changes by no more than the leader's speeds and the steepest ground allow.
    """
    assert line.ground is not None
    every = plan.leader_trajectory.state
    joints_s = every.x[(every.x > span_s[0]) & (every.x < span_s[1])]
    edges_s = np.unique(np.concatenate([np.arange(span_s[0], span_s[1], _FIRST_S), joints_s, [span_s[1]]]))
    velocity = PPoly(every.c[..., POSITION], every.x).derivative()
    slope, steepest = line.rows[2], steepness(line.ground)

    def away(start_s: Array, end_s: Array) -> tuple[Array, Array]:
        off_m = line.off(every(0.5 * (start_s + end_s)))[1]
        speeds = enclosed(velocity, start_s, end_s, _ORDER)
        horizontal_mps = np.linalg.norm(speeds[:2].size(), axis=0)
        along_mps = (speeds[0] * slope[0] + speeds[1] * slope[1] + speeds[2] * slope[2]).size()
        return off_m, off_m + 0.5 * (end_s - start_s) * (along_mps + steepest * horizontal_mps)

    return _greatest(away, edges_s, line.limits.height_m + LENGTH_TOLERANCE_M)


def _greatest(
    away: Callable[[Array, Array], tuple[Array, Array]], edges_s: Array, allowed: float
) -> tuple[float, float, float]:
    """The greatest of a quantity between the first edge and the last: one that is reached, a bound, and when.

    `away` gives it in the middle of intervals, and its bounds there. Intervals are halved where a bound does not decide
    whether it is `allowed`, or is far more than what is reached.
    """
    start_s, end_s = edges_s[:-1], edges_s[1:]
    seen, bound, when_s = -np.inf, -np.inf, float(edges_s[0])
    while len(start_s):
        middle_s = 0.5 * (start_s + end_s)
        reached, most = away(start_s, end_s)
        worst = int(np.argmax(reached))
        if not reached[worst] <= seen:  # also for what is no number
            seen, when_s = float(reached[worst]), float(middle_s[worst])
        undecided = (reached <= allowed) & (most > allowed)
        wide = (undecided | (most > seen + _NEAR)) & (end_s - start_s > _SHORTEST_S)
        bound = float(np.maximum(bound, most[~wide].max(initial=-np.inf)))
        start_s, end_s = np.append(start_s[wide], middle_s[wide]), np.append(middle_s[wide], end_s[wide])
    return seen, bound, when_s
