"""The sum of the objective's terms (Eq. 35): its integrand, its lower bound, and each term along a trajectory."""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from gcs.errors import UsageError
from gcs.plan.ocp.objectives import TERMINAL_WEIGHTS, TERMS
from gcs.plan.ocp.problem import Flights, ObjectiveTerm, Problem, Share
from gcs.plan.ocp.representatives import NUMBERS
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.types import Array

_BOUND_TOLERANCE = 1e-6
_TIMES = 2000  # instants of a free time of flight; between each two the objective has a bound of its own
_SAMPLES = 8  # Gauss nodes on each interval of a trajectory


def cost_rate(problem: Problem, x: Sequence[ca.SX], u: Sequence[ca.SX], shares: ca.SX) -> ca.SX:
    """The integrand of Eq. 35, for the `shares` of this instant (see `cost_shares`)."""
    x = [*x, *ca.vertsplit(shares[2:])]
    total = {Share.MEAN: ca.SX(0), Share.TERMINAL: ca.SX(0)}
    for term, weight in reversed(weighted(problem)):
        if term.share is not Share.DURATION:
            total[term.share] = weight * term.rate(problem, x, u, term.scale(problem)) + total[term.share]
    return shares[0] * total[Share.MEAN] + shares[1] * total[Share.TERMINAL]


def cost_shares(problem: Problem, times_s: Array, mean: Array, terminal: Array) -> Array:
    """What the cost takes at each instant (R, N): the quadrature's shares (N,) of the mean and of the mean with Q, and
    behind them the numbers of the representatives."""
    sample = problem.representatives
    others = [] if sample is None else [sample.numbers(problem.shape, times_s)]
    return np.vstack([mean, terminal, *others])


def share_rows(problem: Problem) -> int:
    """Number of rows of `cost_shares`."""
    return 2 if problem.representatives is None else 2 + NUMBERS * len(problem.representatives.rows)


def duration_cost(problem: Problem) -> float:
    """What the time of flight costs."""
    costs = [
        weight * problem.duration_s / term.scale(problem) * term.rate(problem, (), (), term.scale(problem))
        for term, weight in weighted(problem)
        if term.share is Share.DURATION
    ]
    return float(sum(costs))


def least_cost(problem: Problem, length_m: float) -> float:
    """The lower bound of the whole objective for all flights at least `length_m` long, in any time there is."""
    free = problem.free_time
    times = np.full(2, problem.duration_s) if free is None else np.linspace(free.earliest_s, free.latest_s, _TIMES)
    flights = Flights(length_m, times[:-1], times[1:])
    bounds = [weight * term.lower_bound(problem, flights, term.scale(problem)) for term, weight in weighted(problem)]
    return float(np.min(sum(bounds, start=np.zeros(1))))


def weighted(problem: Problem) -> list[tuple[ObjectiveTerm, float]]:
    """The terms that count in this problem, with their weights."""
    terms = [(term, term.weight(problem)) for term in (*TERMS, *problem.extra_objectives)]
    return [(term, weight) for term, weight in terms if weight]


def term_cost(problem: Problem, term: ObjectiveTerm, trajectory: Trajectory) -> float:
    """The cost of one term along a trajectory, without its weight."""
    scale = term.scale(problem)
    if term.share is Share.DURATION:
        return float((trajectory.end_s - trajectory.start_s) / scale * term.rate(problem, (), (), scale))
    times, spans = quadrature(trajectory.joints_s)
    numbers = cost_shares(problem, times, times, times)[2:].T
    states, controls = np.hstack([trajectory.state(times), numbers]), trajectory.control(times)
    x, u = ca.SX.sym("x", states.shape[1]), ca.SX.sym("u", controls.shape[1])
    rate = ca.Function("rate", [x, u], [term.rate(problem, ca.vertsplit(x), ca.vertsplit(u), scale)])
    rates = np.asarray(rate.map(len(times))(states.T, controls.T)).ravel()
    if term.share is Share.MEAN:
        return float(spans @ rates / problem.mean_s)
    spans = spans * TERMINAL_WEIGHTS[problem.objective.terminal_weight](times, trajectory.end_s)
    return float(spans @ rates / spans.sum())


def lower_bound(problem: Problem, term: ObjectiveTerm, trajectory: Trajectory) -> float:
    """The lower bound of one term, without its weight, for flights as long as this one in its time."""
    # Chords are never longer than the path between their ends.
    times = np.union1d(quadrature(trajectory.joints_s)[0], trajectory.joints_s)
    places = trajectory.state(times)[:, :3]
    length_m = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    lasting_s = np.array([trajectory.end_s - trajectory.start_s])
    return float(np.min(term.lower_bound(problem, Flights(length_m, lasting_s, lasting_s), term.scale(problem))))


def refuse_false_bounds(problem: Problem, trajectory: Trajectory) -> None:
    """Raises UsageError where a flight disproves the lower bound, or the weight, of a term given by the caller."""
    for term in problem.extra_objectives:
        if (weight := term.weight(problem)) < 0.0:
            raise UsageError(
                f'the weight of objective "{term.name}" is {weight:g}; it must be 0 or more',
                hint="change the sign of its rate instead, and give a lower bound that is valid for it",
            )
        cost, bound = term_cost(problem, term, trajectory), lower_bound(problem, term, trajectory)
        if bound > cost + _BOUND_TOLERANCE * max(abs(cost), 1.0):
            raise UsageError(
                f'the lower bound of objective "{term.name}" is {bound:.4g}, but an optimised flight costs {cost:.4g}',
                hint="correct its lower_bound: it must be at most the cost of every flight of that length and time",
            )


def quadrature(joints: Array) -> tuple[Array, Array]:
    """Instants (N,) and the seconds (N,) that each stands for in an integral over polynomials between joints."""
    (nodes, weights), half = np.polynomial.legendre.leggauss(_SAMPLES), 0.5 * np.diff(joints)[:, None]
    return (joints[:-1, None] + half * (nodes + 1.0)).ravel(), (half * weights).ravel()
