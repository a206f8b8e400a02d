"""The heading of a formation that turns with its course: where a re-plan takes it over, and where it has to end."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from gcs.plan.formation.shape import Shape
from gcs.plan.formation.timeline import lay
from gcs.plan.ocp.problem import HeadingEnds, Problem
from gcs.plan.search.initial_guess import piecewise_linear
from gcs.plan.trajectory.phases import PhaseKind
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario

_EVERY_S = 0.1
_DEGREE = 5


@dataclass(frozen=True)
class Turning:
    """The scheduled shape of a plan as it would be without its heading, the heading over plan time, and both in one."""

    base: Shape
    heading_rad: BSpline  # seen from the direction that the formation faces at T0
    zero_rad: float  # this direction
    turned: Shape

    def taken_over(self, problem: Problem) -> Problem:
        """The problem with the heading as it is at the problem's start, and at its end as the old plan landed."""
        start = np.array([float(self.heading_rad(problem.start_s, order)) for order in range(4)])
        return replace(problem, heading=HeadingEnds(self.zero_rad, start, float(self.heading_rad(problem.end_s))))

    def without_heading(self, problem: Problem) -> Problem:
        """The same problem for the leader alone, in the shape that the old plan has at its times."""
        return replace(problem, shape=self.turned, coordinates=(), heading=None)

    def on(self, guess: Trajectory) -> Trajectory:
        """A guess of the leader's flight with the heading of the old plan."""
        times = np.union1d(guess.joints_s, np.arange(guess.start_s, guess.end_s, _EVERY_S))
        chain = np.column_stack([self.heading_rad(times, order) for order in range(4)])
        controls = np.hstack([guess.control(times), np.zeros((len(times), 1))])
        states = np.hstack([guess.state(times), chain])
        return Trajectory(piecewise_linear(times, states), piecewise_linear(times, controls))


def turning(plan: Plan, scenario: Scenario, problem: Problem) -> Turning | None:
    """The turning of a plan; None for one whose formation keeps its direction, or also changes by itself.

    `scenario` has the changes at their planned times, `problem` is that of the whole flight.
    """
    if not problem.follows_course or len(problem.coordinates) > 1:
        return None
    mission = plan.phase(PhaseKind.MISSION)
    starts_s = tuple(move.start_s for move in plan.scheduled_moves)
    base = lay(scenario, starts_s, 0.0, mission.end_s).shape
    count = max(int((mission.end_s - mission.start_s) / _EVERY_S), _DEGREE) + 1
    times = np.linspace(mission.start_s, np.nextafter(mission.end_s, -np.inf), count)
    plain, turned = (shape.offsets(times)[..., :2] @ np.array([1.0, 1.0j]) for shape in (base, plan.shape))
    angles = np.unwrap(np.angle((plain.conj() * turned).sum(axis=0)))
    return Turning(base, make_interp_spline(times, angles, _DEGREE), problem.course_at_start_rad, plan.shape)
