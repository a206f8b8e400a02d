"""Skein's verifier applied between the nodes of any solver's solution: margins, windows, objective on a fine grid."""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy.interpolate import PPoly

from gcs.physics.states import POSITION
from gcs.plan.ocp import margins, stage_functions
from gcs.plan.ocp.objectives import TERMINAL_WEIGHTS
from gcs.plan.ocp.problem import Problem
from gcs.plan.trajectory.integration_windows import window_errors
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.plan.verification.proof.verdict import LENGTH_TOLERANCE_M, LIMIT_TOLERANCE, WINDOW_TOLERANCE_M

_GRID_S = 0.05
_FINE = 20  # points of the quadrature of every interval


@dataclass(frozen=True)
class Findings:
    """Largest violations over the whole flight (0 where nothing is violated) and what the trajectory really costs."""

    clearance_m: float  # below the least height above the exact ground
    limit: float  # of any limit of the state or of turning, as a share of the limit
    limit_name: str
    control: float  # outside the control box that was asked for, in halves of its width
    window_m: float  # largest error of Eq. 1 re-integrated over 5 s
    jump_m: float  # of the position at a joint
    objective: float  # Eq. 35 of the polynomials, Q normalised by its true integral

    @property
    def verified(self) -> bool:
        """All of it within the verifier's tolerances."""
        lengths, shares = (self.clearance_m, self.jump_m), (self.limit, self.control)
        held = max(lengths) <= LENGTH_TOLERANCE_M and max(shares) <= LIMIT_TOLERANCE
        return held and self.window_m <= WINDOW_TOLERANCE_M


def trajectory(result: dict[str, Any]) -> Trajectory:
    """The polynomials through a contender's points."""
    joints = np.array(result["joints_s"])
    return Trajectory(
        *(PPoly(_coefficients(result[f"{part}_tau"], result[part], joints), joints) for part in ("state", "control"))
    )


def _coefficients(tau: list[list[float]], values: list[list[list[float]]], joints: Any) -> Any:
    top = max(len(points) for points in tau)
    coefficients = np.zeros((top, len(tau), len(values[0][0])))
    for i, (points, at) in enumerate(zip(tau, values, strict=True)):
        powers = (np.array(points) * (joints[i + 1] - joints[i]))[:, None] ** np.arange(len(points) - 1, -1, -1)
        coefficients[top - len(points) :, i] = np.linalg.solve(powers, np.array(at))
    return coefficients


def look(problem: Problem, flown: Trajectory) -> Findings:
    """Judge one trajectory of the leader."""
    count = int(np.ceil(problem.duration_s / _GRID_S))
    times = np.linspace(problem.start_s, problem.end_s, count + 1)
    state, control = flown.state(times)[None], flown.control(times)[None]
    scenario = problem.scenario
    limits = [
        *margins.state_limits(scenario, state),
        *margins.box(scenario, state),
        margins.turning(scenario, state, control),
    ]
    worst = min(limits, key=lambda m: float(m.value.min()) / m.scale)
    excess = np.maximum(problem.control_low - control, control - problem.control_high)
    joints = flown.joints_s
    windows = window_errors(lambda t: flown.state(t)[None], lambda t: flown.control(t)[None], joints, problem.quadrotor)
    inner = joints[1:-1]
    jump = flown.state(inner) - flown.state(np.nextafter(inner, -np.inf))
    return Findings(
        max(0.0, -float(margins.clearance(scenario, state).value.min())),
        max(0.0, -float(worst.value.min()) / worst.scale),
        worst.name,
        max(0.0, float((excess / (0.5 * (problem.control_high - problem.control_low))).max())),
        float(windows.error_m.max()),
        float(np.linalg.norm(jump[:, POSITION], axis=1).max()),
        cost(problem, flown),
    )


def cost(problem: Problem, flown: Trajectory) -> float:
    """Eq. 35 integrated over the polynomials."""
    nodes, weights = np.polynomial.legendre.leggauss(_FINE)
    # Short pieces at the end, where Q varies fastest.
    edges = np.union1d(flown.joints_s, problem.end_s - np.geomspace(0.5, problem.duration_s, 12)[:-1])
    half = 0.5 * np.diff(edges)[:, None]
    times = (edges[:-1, None] + half * (nodes + 1.0)).ravel()
    shares = (half * weights).ravel()
    late = shares * TERMINAL_WEIGHTS[problem.objective.terminal_weight](times, problem.end_s)
    z = np.concatenate([flown.state(times), flown.control(times)], axis=1).T
    rate = stage_functions.functions(problem).cost.map(len(times))
    return float(ca.sum2(rate(z, np.vstack([shares / problem.duration_s, late / late.sum()]))))
