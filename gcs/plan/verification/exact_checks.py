"""Exact checks at instants: ends, joints, pads, route points, times of changes, assignment of places, battery."""

import numpy as np

from gcs.physics.quadrotor import derivative
from gcs.physics.states import ATTITUDE, POSITION, VELOCITY
from gcs.plan.trajectory.constraint_id import ConstraintId, Kind
from gcs.plan.trajectory.energy import charge_needed
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.constraints.formation_checks import assignments_m, landing_points, late_s
from gcs.plan.verification.position_errors import climb_separation_m
from gcs.plan.verification.proof.verdict import (
    ANGLE_TOLERANCE_DEG,
    LENGTH_TOLERANCE_M,
    LIMIT_TOLERANCE,
    SPEED_TOLERANCE_MPS,
    Check,
)
from gcs.plan.verification.route_checks import route_checks
from gcs.scenario.values.navigation_error import judged_separation_m
from gcs.scenario.values.si import boundary_state, torque_limits
from gcs.types import Array
from gcs.util.long_work import report

START_TOLERANCE_S = 0.06
_JERK_TOLERANCE_S = 0.01  # the largest jerk, so long, is the largest step of an acceleration
_CONTROL_TOLERANCE = 10.0 * LIMIT_TOLERANCE


def exact_checks(plan: Plan) -> tuple[list[Check], float]:
    """All of them, and the position error at the end."""
    boundary, terminal_m = _boundary_checks(plan)
    return [
        *_joint_checks(plan),
        *_change_checks(plan),
        *_climb_checks(plan),
        *route_checks(plan),
        *boundary,
        *_battery_checks(plan),
    ], terminal_m


def _exact(
    kind: Kind, phase: str, unit: str, worst: float, tolerance: float, sysid: int | None, t_s: float | None
) -> Check:
    return Check(ConstraintId(kind), phase, unit, worst, tolerance, sysid, t_s, proved=worst)


def _joint_checks(plan: Plan) -> list[Check]:
    """The largest jump of a state where polynomials join, and of a control within a phase."""
    joints = plan.joints_s[1:-1]
    if not len(joints):
        return []
    after, before = plan.motion(joints), plan.motion(np.nextafter(joints, -np.inf))
    jump = np.nan_to_num(np.abs(after[0] - before[0]), nan=np.inf).max(axis=(0, 2))
    worst = int(np.argmax(jump))
    found = [
        _exact(Kind.STATE_JOINTS, "all", "SI", -float(jump[worst]), LENGTH_TOLERANCE_M, None, float(joints[worst]))
    ]
    found += _control_joints(plan, joints, np.abs(after[1] - before[1]))
    most = plan.scenario.limits.jerk_max_mps3
    if most is not None:
        steps = derivative(*after, plan.quadrotor)[..., VELOCITY] - derivative(*before, plan.quadrotor)[..., VELOCITY]
        sizes = np.nan_to_num(np.linalg.norm(steps, axis=-1), nan=np.inf)  # (V, N)
        vehicle, joint = np.unravel_index(int(sizes.argmax()), sizes.shape)
        found.append(
            _exact(
                Kind.ACCELERATION_JOINTS,
                "all",
                "m/s2",
                -float(sizes[vehicle, joint]),
                _JERK_TOLERANCE_S * most,
                plan.sysids[vehicle],
                float(joints[joint]),
            )
        )
    return found


def _control_joints(plan: Plan, joints: Array, steps: Array) -> list[Check]:
    """Controls do not jump within a phase; `steps` (V, N, 4) are their jumps at the joints.

    Where a scheduled change begins or ends, snap steps, and with it the moments U2 to U4, by design: they are limited,
    thrust and rates are continuous.
    """
    limits = plan.scenario.limits
    within = ~np.isclose(joints[:, None], [phase.start_s for phase in plan.phases], rtol=0.0, atol=1e-6).any(axis=1)
    sizes = np.array([max(limits.thrust_N), *torque_limits(limits, plan.scenario.vehicle.arm_m)])
    share = np.nan_to_num(steps / sizes, nan=np.inf)
    share[:, np.isin(joints, plan.shape.joints_s), 1:] = 0.0
    share = share[:, within]
    if not share.size:
        return []
    vehicle, joint, _ = np.unravel_index(int(share.argmax()), share.shape)
    worst, sysid, t_s = -float(share.max()), plan.sysids[vehicle], float(joints[within][joint])
    return [_exact(Kind.CONTROL_JOINTS, "all", "of its limit", worst, _CONTROL_TOLERANCE, sysid, t_s)]


def _climb_checks(plan: Plan) -> list[Check]:
    """Autopilots climb at their own rates, so over the pads only the distance between the columns counts."""
    if plan.begin_state is not None or len(plan.sysids) < 2:
        return []
    missing = climb_separation_m(plan) - judged_separation_m(plan.scenario)
    return [_exact(Kind.PAD_SEPARATION, PhaseKind.TAKEOFF, "m", missing, LENGTH_TOLERANCE_M, None, plan.t_start_s)]


def _battery_checks(plan: Plan) -> list[Check]:
    """The charge that is left of a full battery, less the reserve of [preflight].

    Of vehicles without [vehicle.power], and of a plan that begins in the air without saying what was used before, it is
    not known.
    """
    if plan.scenario.vehicle.power is None or (plan.begin_state is not None and not plan.used_before):
        return []
    used = charge_needed(plan) + (np.array(plan.used_before) if plan.used_before else 0.0)
    left = np.nan_to_num(1.0 - plan.scenario.preflight.reserve - used, nan=-np.inf)
    row = int(np.argmin(left))
    landing, share = PhaseKind.LANDING, "of a full battery"
    return [_exact(Kind.BATTERY, landing, share, float(left[row]), 0.0, plan.sysids[row], plan.t_end_s)]


def _change_checks(plan: Plan) -> list[Check]:
    """Scheduled changes begin on time, and vehicles take the places whose longest path is shortest (Eq. 14)."""
    checks: list[Check] = []
    report("comparing the ways of all vehicles in changes of shape")
    if late := late_s(plan):
        worst_s, t_s = max(late)
        checks.append(_exact(Kind.CHANGE_TIMES, PhaseKind.MISSION, "s", -worst_s, START_TOLERANCE_S, None, t_s))
    if longer := assignments_m(plan):
        worst_m, t_s = max(longer)
        checks.append(_exact(Kind.ASSIGNMENT, PhaseKind.MISSION, "m", -worst_m, LENGTH_TOLERANCE_M, None, t_s))
    return checks


def _boundary_checks(plan: Plan) -> tuple[list[Check], float]:
    """Eqs. 15 and 16 at T0 and at the arrival, the arrival time (exact), take-off and landing points."""
    checks: list[Check] = []
    scenario, leader, sysid = plan.scenario, plan.leader, plan.sysids[plan.leader]
    mission = plan.phase(PhaseKind.MISSION)
    late = abs(mission.end_s - scenario.time.flight_s)
    checks.append(_exact(Kind.ARRIVAL_TIME, PhaseKind.MISSION, "s", -late, 0.0, None, mission.end_s))
    terminal = 0.0
    begin = boundary_state(scenario, scenario.start) if plan.begin_state is None else np.array(plan.begin_state)
    for kinds, t_s, boundary in (
        ((Kind.START_POSITION, Kind.START_VELOCITY, Kind.START_ATTITUDE), mission.start_s, begin),
        (
            (Kind.END_POSITION, Kind.END_VELOCITY, Kind.END_ATTITUDE),
            np.nextafter(mission.end_s, 0.0),
            boundary_state(scenario, scenario.end),
        ),
    ):
        error = plan.states(np.array([t_s]))[leader, 0] - boundary
        terminal = float(np.linalg.norm(error[POSITION]))
        limits = (
            ("m", terminal, LENGTH_TOLERANCE_M),
            ("m/s", float(np.abs(error[VELOCITY]).max()), SPEED_TOLERANCE_MPS),
            ("deg", float(np.degrees(np.abs(error[ATTITUDE]).max())), ANGLE_TOLERANCE_DEG),
        )
        for kind, (unit, off, tolerance) in zip(kinds, limits, strict=True):
            checks.append(_exact(kind, PhaseKind.MISSION, unit, -off, tolerance, sysid, float(t_s)))
    grounds = [(Kind.LANDING_POINT, plan.t_end_s, landing_points(plan))]
    if plan.begin_state is None:
        grounds.insert(0, (Kind.TAKEOFF_POINT, plan.t_start_s, plan.pads_ned_m))
    for kind, t_s, points in grounds:
        distance = np.linalg.norm(plan.states(np.array([t_s]))[:, 0, POSITION] - points, axis=1)
        worst = int(np.argmax(distance))
        checks.append(_exact(kind, "all", "m", -float(distance[worst]), LENGTH_TOLERANCE_M, plan.sysids[worst], t_s))
    return checks, terminal
