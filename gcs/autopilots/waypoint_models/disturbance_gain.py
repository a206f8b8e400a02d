"""The largest position error that a disturbance of bounded size can cause: the gain of the closed loop."""

from functools import lru_cache

from gcs.autopilots.waypoint_models.tracking import Following

_STEP_S, _LONG_S = 0.01, 60.0  # of the impulse response: by its end nothing is left of it


@lru_cache(maxsize=16)
def disturbance_gain_s2(following: Following, drag_ps: float) -> float:
    """Position error over acceleration, s^2, of a vehicle with that drag per mass.

    No course of an acceleration of at most a, however it changes, moves the vehicle farther from its target than this
    gain times a: it is the integral of the absolute impulse response of the loops of `tracking`.
    """
    import numpy as np  # noqa: PLC0415 (the rows of autopilots load without it)
    from scipy.linalg import expm  # noqa: PLC0415

    loop = following.horizontal
    kp, kv, ki, kd, lag_s = loop.position_ps, loop.velocity_ps, loop.integral_ps2, loop.damping, following.lag_s
    # x, u, the integral of the velocity error, thrust; the error of the velocity is -(kp x + u)
    push = np.array([-kv * kp, -kv, 1.0, 0.0]) - kd * np.array([0.0, -drag_ps, 0.0, 1.0])
    system = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [0.0, -drag_ps, 0.0, 1.0],
            [-ki * kp, -ki, 0.0, 0.0],
            (push - [0.0, 0.0, 0.0, 1.0]) / lag_s,
        ]
    )
    step = expm(_STEP_S * system)
    state, total = np.array([0.0, 1.0, 0.0, 0.0]), 0.0
    for _ in range(round(_LONG_S / _STEP_S)):
        after = step @ state
        total += 0.5 * _STEP_S * float(abs(state[0]) + abs(after[0]))
        state = after
    return total
