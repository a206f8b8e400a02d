"""Verify a plan from its polynomials alone: every phase, every vehicle, every 0.05 s, over the exact ground.

It uses nothing of the transcription, the solver or the mesh. `docs/verification.md` lists the checks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs.errors import VerificationError
from gcs.physics.quadrotor import ATTITUDE, POSITION, VELOCITY, Array
from gcs.plan.formation.shape import Rows
from gcs.plan.nlp import margins
from gcs.plan.nlp.margins import Margin
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.formation_checks import course, landing_points, late_s, least_separation, place_in_formation
from gcs.plan.verification.position_errors import climb_separation_m
from gcs.plan.verification.reintegration import WINDOW_S, window_errors
from gcs.scenario.si import boundary_state

GRID_S = 0.05
LENGTH_TOLERANCE_M = 1e-3  # clearance, terminal position, joints
LIMIT_TOLERANCE = 1e-3  # share of the limit
WINDOW_TOLERANCE_M = 10e-3
SPEED_TOLERANCE_MPS = 1e-3
ANGLE_TOLERANCE_DEG = 0.01
START_TOLERANCE_S = 0.06
COURSE_TOLERANCE = 0.01  # share of `course_tolerance_deg`
_LISTED = 5  # failures in an error
_BLOCK = 100_000  # vehicles times instants checked together
_WINDOWED = 50  # vehicles re-integrated together
AIRBORNE = ("hover", "run-up", "mission", "arrival-hover")


@dataclass(frozen=True)
class Check:
    """One check and its least margin `worst` (negative: violated), with vehicle and time."""

    name: str
    phase: str
    unit: str
    worst: float
    tolerance: float
    sysid: int | None
    t_s: float | None

    @property
    def ok(self) -> bool:
        """Whether the limit is violated by no more than the tolerance."""
        return self.worst >= -self.tolerance

    def __str__(self) -> str:
        vehicle = "" if self.sysid is None else f" (vehicle {self.sysid})"
        when = "" if self.t_s is None else f" at t = {self.t_s:.2f} s"
        verdict = "margin" if self.worst >= 0 else "violated by"
        return f"{self.name}, {self.phase}: {verdict} {abs(self.worst):.3g} {self.unit}{when}{vehicle}"


@dataclass(frozen=True)
class Report:
    """All checks of a plan, and its four key figures."""

    checks: tuple[Check, ...]
    clearance_min_m: float
    separation_min_m: float | None  # of one vehicle there is none
    window_error_max_m: float
    terminal_error_m: float

    @property
    def ok(self) -> bool:
        """Whether the plan is verified: all checks passed."""
        return all(c.ok for c in self.checks)

    @property
    def failures(self) -> tuple[Check, ...]:
        """The checks that failed."""
        return tuple(c for c in self.checks if not c.ok)


def refusal(report: Report) -> VerificationError:
    """The error for a plan that failed verification, with its worst checks."""
    worst = "; ".join(str(c) for c in report.failures[:_LISTED])
    more = f"; and {len(report.failures) - _LISTED} more" if len(report.failures) > _LISTED else ""
    return VerificationError(
        f"the plan failed verification: {worst}{more}",
        hint="change the scenario and plan again, or add --unverified to use the plan for inspection",
    )


def verify(plan: Plan) -> Report:
    """The report on a plan: Eqs. 1, 15-25, 51-53 and separations, in every phase, for every vehicle."""
    checks: list[Check] = []
    for phase in plan.phases:
        checks += _phase_checks(plan, phase.name, phase.start_s, phase.end_s)
    clearance = min(c.worst for c in checks if c.name == "clearance above ground")
    separations = [c.worst + plan.scenario.limits.separation_min_m for c in checks if c.name == "separation"]
    windows = _window_check(plan)
    checks += [windows, _joint_check(plan), *_change_checks(plan), *_climb_checks(plan)]
    boundary, terminal = _boundary_checks(plan)
    return Report(
        (*checks, *boundary),
        clearance + plan.scenario.limits.clearance_min_m,
        min(separations, default=None),
        WINDOW_TOLERANCE_M - windows.worst,
        terminal,
    )


def _phase_checks(plan: Plan, phase: str, start_s: float, end_s: float) -> list[Check]:
    """All checks of one phase, in blocks that fit into memory for any number of vehicles."""
    times = np.linspace(start_s, end_s, int(np.ceil((end_s - start_s) / GRID_S)) + 1)
    worst: dict[str, Check] = {}
    for block in np.array_split(times, int(np.ceil(len(times) * len(plan.sysids) / _BLOCK))):
        # The end belongs to this phase's last polynomial, not to the next one's first.
        inside = np.clip(block, start_s, np.nextafter(end_s, start_s))
        for check in _block_checks(plan, phase, inside):
            known = worst.setdefault(check.name, check)
            if check.worst - check.tolerance < known.worst - known.tolerance:
                worst[check.name] = check
    checks = list(worst.values())
    if len(plan.sysids) > 1:
        least, when = least_separation(plan.shape, np.clip(times, start_s, np.nextafter(end_s, start_s)))
        missing = least - plan.scenario.limits.separation_min_m
        checks.append(Check("separation", phase, "m", missing, LENGTH_TOLERANCE_M, None, when))
    return checks


def _block_checks(plan: Plan, phase: str, times: Array) -> list[Check]:
    scenario = plan.scenario
    moving = plan.shape.moves_apart(times, plan.quadrotor.wind)
    checks: list[Check] = []
    fleet = np.arange(len(plan.sysids))
    # Where the leader's velocity, attitude and control are those of all vehicles, one row stands for all.
    for rows, part in ((np.array([plan.leader]), times[~moving]), (fleet, times[moving])):
        if not len(part):
            continue
        states, controls = plan.motion(part, rows)
        found = [
            *margins.state_limits(scenario, states),
            *margins.control_limits(scenario, controls),
            margins.turning(scenario, states, controls),
            *margins.acceleration(scenario, states, controls),
        ]
        if phase == "mission":
            found += margins.shape_motion(
                scenario, plan.shape.offsets(part, 1, rows), plan.shape.offsets(part, 2, rows)
            )
        checks += [_worst(m, LIMIT_TOLERANCE * m.scale, phase, rows, plan, part) for m in found]
    places = plan.leader_trajectory.state(times)[:, POSITION] + plan.offsets(times)
    checks += [
        _worst(m, tolerance, phase, fleet, plan, times) for m, tolerance in _of_places(plan, phase, places, times)
    ]
    return checks


def _of_places(plan: Plan, phase: str, places: Array, times: Array) -> list[tuple[Margin, float]]:
    """Margins and tolerances of height, clearance, no-fly zones, box and shape, from positions (V, N, 3)."""
    scenario = plan.scenario
    height = margins.height(scenario, places, to_the_ground=phase not in AIRBORNE)
    found = [(height, LIMIT_TOLERANCE * height.scale)]
    clearance = margins.clearance(scenario, places)
    if phase in AIRBORNE:
        found += [(clearance, LENGTH_TOLERANCE_M), (place_in_formation(plan, places, times), LENGTH_TOLERANCE_M)]
    else:
        above = clearance.value + scenario.limits.clearance_min_m
        found.append((Margin("height above ground", "m", above, 1.0), LENGTH_TOLERANCE_M))
    if phase == "mission":
        found += [(m, LENGTH_TOLERANCE_M) for m in margins.box(scenario, places)]
    return found + [(m, LENGTH_TOLERANCE_M) for m in margins.no_fly(scenario, places, times)]


def _worst(margin: Margin, tolerance: float, phase: str, rows: Rows, plan: Plan, times: Array) -> Check:
    value = np.nan_to_num(margin.value, nan=-np.inf)
    vehicle, instant = np.unravel_index(np.argmin(value), value.shape)
    sysid, t_s = plan.sysids[rows[vehicle]], float(times[instant])
    return Check(margin.name, phase, margin.unit, float(value[vehicle, instant]), tolerance, sysid, t_s)


def _window_check(plan: Plan) -> Check:
    """Eq. 1 re-integrated: the leader's whole flight, and all vehicles where the shape moves."""
    worst = (0.0, plan.sysids[plan.leader], plan.t_start_s)
    spans: list[tuple[Rows, float, float]] = [(np.array([plan.leader]), plan.t_start_s, plan.t_end_s)]
    for start_s, end_s in plan.shape.apart_s(plan.quadrotor.wind):
        for rows in np.array_split(np.arange(len(plan.sysids)), int(np.ceil(len(plan.sysids) / _WINDOWED))):
            spans.append((rows, max(start_s - WINDOW_S, plan.t_start_s), min(end_s + WINDOW_S, plan.t_end_s)))
    for rows, start_s, end_s in spans:
        inner = plan.joints_s[(plan.joints_s > start_s) & (plan.joints_s < end_s)]
        windows = window_errors(
            lambda t, rows=rows: plan.motion(t, rows)[0],  # type: ignore[misc]
            lambda t, rows=rows: plan.motion(t, rows)[1],  # type: ignore[misc]
            np.concatenate([[start_s], inner, [end_s]]),
            plan.quadrotor,
        )
        errors = np.nan_to_num(windows.error_m, nan=np.inf)
        vehicle, window = np.unravel_index(np.argmax(errors), errors.shape)
        error = float(errors[vehicle, window])
        worst = max(worst, (error, plan.sysids[rows[vehicle]], float(windows.start_s[window])))
    return Check("Eq. 1 re-integrated over 5 s", "all", "m", WINDOW_TOLERANCE_M - worst[0], 0.0, worst[1], worst[2])


def _joint_check(plan: Plan) -> Check:
    """The largest jump of a state where polynomials join."""
    joints = plan.joints_s[1:-1]
    jump = np.abs(plan.states(joints) - plan.states(np.nextafter(joints, -np.inf)))
    instant = int(np.argmax(jump.max(axis=(0, 2))))
    return Check(
        "state continuous at joints",
        "all",
        "SI",
        -float(jump.max()),
        LENGTH_TOLERANCE_M,
        None,
        float(joints[instant]),
    )


def _climb_checks(plan: Plan) -> list[Check]:
    """Autopilots climb at their own rates, so over the pads only the distance between the columns counts."""
    if plan.begin_state is not None or len(plan.sysids) < 2:
        return []
    missing = climb_separation_m(plan) - plan.scenario.judge.separation_min_m
    return [Check("separation over the pads", "takeoff", "m", missing, LENGTH_TOLERANCE_M, None, plan.t_start_s)]


def _change_checks(plan: Plan) -> list[Check]:
    """Scheduled changes begin on time; a formation that turns with its course faces where it flies."""
    checks = []
    if late := late_s(plan):
        worst_s, t_s = max(late)
        checks.append(Check("changes begin when they should", "mission", "s", -worst_s, START_TOLERANCE_S, None, t_s))
    if plan.scenario.formation.frame == "course":
        mission = plan.phase("mission")
        times = np.arange(mission.start_s, mission.end_s, GRID_S)
        faced, known_s = course(plan, times)
        tolerance = COURSE_TOLERANCE * faced.scale
        checks.append(_worst(faced, tolerance, "mission", np.array([plan.leader]), plan, known_s))
    return checks


def _boundary_checks(plan: Plan) -> tuple[list[Check], float]:
    """Eqs. 15 and 16 at T0 and at the arrival, the arrival time (exact), take-off and landing points."""
    checks: list[Check] = []
    scenario, leader, sysid = plan.scenario, plan.leader, plan.sysids[plan.leader]
    mission = plan.phase("mission")
    late = abs(mission.end_s - scenario.time.flight_s)
    checks.append(Check("arrival time", "mission", "s", -late, 0.0, None, mission.end_s))
    terminal = 0.0
    begin = boundary_state(scenario, scenario.start) if plan.begin_state is None else np.array(plan.begin_state)
    for name, t_s, boundary in (
        ("start", mission.start_s, begin),
        ("end", np.nextafter(mission.end_s, 0.0), boundary_state(scenario, scenario.end)),
    ):
        error = plan.states(np.array([t_s]))[leader, 0] - boundary
        off = float(np.linalg.norm(error[POSITION]))
        terminal = off
        checks += [
            Check(f"{name} position", "mission", "m", -off, LENGTH_TOLERANCE_M, sysid, float(t_s)),
            Check(
                f"{name} velocity",
                "mission",
                "m/s",
                -float(np.abs(error[VELOCITY]).max()),
                SPEED_TOLERANCE_MPS,
                sysid,
                float(t_s),
            ),
            Check(
                f"{name} attitude",
                "mission",
                "deg",
                -float(np.degrees(np.abs(error[ATTITUDE]).max())),
                ANGLE_TOLERANCE_DEG,
                sysid,
                float(t_s),
            ),
        ]
    grounds = [("landing point", plan.t_end_s, landing_points(plan))]
    if plan.begin_state is None:
        grounds.insert(0, ("take-off point", plan.t_start_s, plan.pads_ned_m))
    for name, t_s, points in grounds:
        distance = np.linalg.norm(plan.states(np.array([t_s]))[:, 0, POSITION] - points, axis=1)
        worst = int(np.argmax(distance))
        checks.append(Check(name, "all", "m", -float(distance[worst]), LENGTH_TOLERANCE_M, plan.sysids[worst], t_s))
    return checks, terminal
