"""The verdict on a plan, from its polynomials alone: it trusts nothing the solver says.

Knows: what every phase must hold, on a grid of 0.05 s, for every vehicle, over the exact ground. Does not know:
transcription, solver, mesh. A plan that is not verified is not a plan.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import pdist

from gcs.plan import margins
from gcs.plan.margins import Margin
from gcs.plan.trajectory import Plan
from gcs.plan.windows import window_errors
from gcs.quadrotor import ATTITUDE, POSITION, VELOCITY, Array
from gcs.scenario.physical import boundary_state, offsets_ned_m

GRID_S = 0.05
LENGTH_TOLERANCE_M = 1e-3  # clearance, terminal position, joints
LIMIT_TOLERANCE = 1e-3  # of a limit's size
WINDOW_TOLERANCE_M = 10e-3
SPEED_TOLERANCE_MPS = 1e-3
ANGLE_TOLERANCE_DEG = 0.01
AIRBORNE = ("hover", "run-up", "mission", "arrival-hover")


@dataclass(frozen=True)
class Check:
    """One promise and how well it is kept: `worst` is the least margin (negative: broken), where and when."""

    name: str
    phase: str
    unit: str
    worst: float
    tolerance: float
    sysid: int | None
    t_s: float | None

    @property
    def ok(self) -> bool:
        """The margin is not below zero by more than the tolerance."""
        return self.worst >= -self.tolerance

    def __str__(self) -> str:
        who = "" if self.sysid is None else f" (vehicle {self.sysid})"
        when = "" if self.t_s is None else f" at {self.t_s:.2f} s"
        kept = "kept by" if self.worst >= 0 else "missed by"
        return f"{self.name}, {self.phase}: {kept} {abs(self.worst):.3g} {self.unit}{when}{who}"


@dataclass(frozen=True)
class Report:
    """All checks of a plan, and the figures people ask for."""

    checks: tuple[Check, ...]
    clearance_min_m: float
    separation_min_m: float | None  # of one vehicle there is none
    window_error_max_m: float
    terminal_error_m: float

    @property
    def ok(self) -> bool:
        """Every promise is kept."""
        return all(c.ok for c in self.checks)

    @property
    def failures(self) -> tuple[Check, ...]:
        """The promises that are not."""
        return tuple(c for c in self.checks if not c.ok)


def verify(plan: Plan) -> Report:
    """Check every phase of a plan: Eqs. 1, 15-25, 51-53 and separations, for every vehicle."""
    checks: list[Check] = []
    for phase in plan.phases:
        checks += _phase_checks(plan, phase.name, phase.start_s, phase.end_s)
    clearance = min(c.worst for c in checks if c.name == "clearance above ground")
    separations = [c.worst + plan.scenario.limits.separation_min_m for c in checks if c.name == "separation"]
    windows = window_errors(plan.states, plan.controls, plan.joints_s, plan.quadrotor)
    vehicle, window = np.unravel_index(np.argmax(windows.error_m), windows.error_m.shape)
    drift = float(windows.error_m[vehicle, window])
    checks.append(
        Check(
            "Eq. 1 re-integrated over 5 s",
            "all",
            "m",
            WINDOW_TOLERANCE_M - drift,
            0.0,
            plan.sysids[vehicle],
            float(windows.start_s[window]),
        )
    )
    checks.append(_joint_check(plan))
    boundary, terminal = _boundary_checks(plan)
    return Report(
        (*checks, *boundary),
        clearance + plan.scenario.limits.clearance_min_m,
        min(separations, default=None),
        drift,
        terminal,
    )


def _phase_checks(plan: Plan, phase: str, start_s: float, end_s: float) -> list[Check]:
    scenario = plan.scenario
    times = np.linspace(start_s, end_s, int(np.ceil((end_s - start_s) / GRID_S)) + 1)
    # The end belongs to this phase's last polynomial, not to the next one's first.
    inside = np.clip(times, start_s, np.nextafter(end_s, start_s))
    states, controls = plan.states(inside), plan.controls(inside)
    found: list[tuple[Margin, float]] = [
        (m, LIMIT_TOLERANCE * m.scale)
        for m in (
            *margins.state_limits(scenario, states, to_the_ground=phase not in AIRBORNE),
            *margins.control_limits(scenario, controls),
            margins.turning(scenario, states, controls),
        )
    ]
    clearance = margins.clearance(scenario, states)
    if phase in AIRBORNE:
        found += [(clearance, LENGTH_TOLERANCE_M), (_place_in_formation(plan, states), LENGTH_TOLERANCE_M)]
    else:
        above = clearance.value + scenario.limits.clearance_min_m
        found.append((Margin("height above ground", "m", above, 1.0), LENGTH_TOLERANCE_M))
    if phase == "mission":
        found += [(m, LENGTH_TOLERANCE_M) for m in margins.box(scenario, states)]
    found += [(m, LENGTH_TOLERANCE_M) for m in margins.no_fly(scenario, states)]
    checks = [_worst(margin, tolerance, phase, plan.sysids, times) for margin, tolerance in found]
    if len(plan.sysids) > 1:
        checks.append(_separation(plan, states[..., POSITION], phase, times))
    return checks


def _place_in_formation(plan: Plan, states: Array) -> Margin:
    """Eq. 22: every vehicle where the scenario's formation has it, seen from the leader."""
    places = states[..., POSITION] - states[plan.leader, :, POSITION]
    off = np.linalg.norm(places - offsets_ned_m(plan.scenario)[:, None], axis=-1)
    return Margin("place in formation", "m", -off, 1.0)


def _worst(margin: Margin, tolerance: float, phase: str, sysids: tuple[int, ...], times: Array) -> Check:
    value = np.nan_to_num(margin.value, nan=-np.inf)
    vehicle, instant = np.unravel_index(np.argmin(value), value.shape)
    return Check(
        margin.name,
        phase,
        margin.unit,
        float(value[vehicle, instant]),
        tolerance,
        sysids[vehicle],
        float(times[instant]),
    )


def _separation(plan: Plan, positions: Array, phase: str, times: Array) -> Check:
    """Least distance between any two vehicles against the scenario's limit."""
    least = np.array([pdist(positions[:, n]).min() for n in range(len(times))])
    instant = int(np.argmin(least))
    worst = float(least[instant]) - plan.scenario.limits.separation_min_m
    return Check("separation", phase, "m", worst, LENGTH_TOLERANCE_M, None, float(times[instant]))


def _joint_check(plan: Plan) -> Check:
    """States do not jump where polynomials join."""
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


def _boundary_checks(plan: Plan) -> tuple[list[Check], float]:
    """Eqs. 15 and 16 at T0 and at the arrival, which is at the scenario's time exactly; also the ends on the ground."""
    checks: list[Check] = []
    scenario, leader, sysid = plan.scenario, plan.leader, plan.sysids[plan.leader]
    mission = plan.phase("mission")
    late = abs(mission.end_s - scenario.time.flight_s)
    checks.append(Check("arrival time", "mission", "s", -late, 0.0, None, mission.end_s))
    terminal = 0.0
    for name, t_s, boundary in (
        ("start", 0.0, scenario.start),
        ("end", np.nextafter(mission.end_s, 0.0), scenario.end),
    ):
        error = plan.states(np.array([t_s]))[leader, 0] - boundary_state(boundary)
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
    for name, t_s, points in (
        ("take-off point", plan.t_start_s, plan.pads_ned_m),
        ("landing point", plan.t_end_s, plan.landing_points_ned_m),
    ):
        distance = np.linalg.norm(plan.states(np.array([t_s]))[:, 0, POSITION] - points, axis=1)
        worst = int(np.argmax(distance))
        checks.append(Check(name, "all", "m", -float(distance[worst]), LENGTH_TOLERANCE_M, plan.sysids[worst], t_s))
    return checks, terminal
