"""The windows over which Eq. 1 is integrated again under the planned control, and how far the plan is from that.

Open-loop integration over a whole flight says nothing, because Eq. 1 integrates four times. Windows of 5 s do.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gcs.physics.quadrotor import Quadrotor, derivative
from gcs.physics.states import POSITION
from gcs.types import Array

WINDOW_S = 5.0
STEP_S = 0.05
_INSIDE_S = 1e-9  # controls at a joint are evaluated from inside the step


@dataclass(frozen=True)
class WindowErrors:
    """Largest distance between integrated and planned position in each window, per vehicle."""

    start_s: Array  # (W,)
    error_m: Array  # (V, W)


def window_errors(
    states: Callable[[Array], Array],
    controls: Callable[[Array], Array],
    joints_s: Array,
    quadrotor: Quadrotor,
    window_s: float = WINDOW_S,
    stride_s: float = 1.0,
    step_s: float = STEP_S,
) -> WindowErrors:
    """Position errors of Eq. 1, re-integrated under the planned control over every window of `window_s`.

    `states` and `controls` map times (N,) to (V, N, 12) and (V, N, 4). Windows start at every joint and every
    `stride_s`. The integrator (classical Runge-Kutta, steps of at most `step_s`) stops and restarts at every joint,
    because controls have corners there: a step across a corner errs by more than it measures.
    """
    starts = np.union1d(np.arange(joints_s[0], joints_s[-1], stride_s), joints_s[:-1])
    edges = np.union1d(starts, joints_s)
    counts = np.maximum(np.ceil(np.diff(edges) / step_s - 1e-9).astype(int), 1)
    pieces = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(edges[:-1], edges[1:], counts, strict=True)]
    times = np.concatenate([*pieces, edges[-1:]])
    steps = np.diff(times)
    planned = states(times)
    before, middle, after = (
        controls(t) for t in (times[:-1] + _INSIDE_S, times[:-1] + 0.5 * steps, times[1:] - _INSIDE_S)
    )
    first = np.searchsorted(times, starts)
    last = np.minimum(np.searchsorted(times, starts + window_s - 1e-9), len(times) - 1)
    state = planned[:, first].copy()
    worst = np.zeros(state.shape[:2])
    for advance in range(int(np.max(last - first))):
        active = first + advance < last
        step = first[active] + advance
        h = steps[step, None]
        x = state[:, active]
        k1 = derivative(x, before[:, step], quadrotor)
        k2 = derivative(x + 0.5 * h * k1, middle[:, step], quadrotor)
        k3 = derivative(x + 0.5 * h * k2, middle[:, step], quadrotor)
        k4 = derivative(x + h * k3, after[:, step], quadrotor)
        x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        state[:, active] = x
        distance = np.linalg.norm((x - planned[:, step + 1])[..., POSITION], axis=-1)
        worst[:, active] = np.maximum(worst[:, active], distance)
    return WindowErrors(starts, worst)
