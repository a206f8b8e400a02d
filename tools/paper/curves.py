"""Time histories of all vehicles with their limits: Figs. 10, 12, 13, 14 and their like of Simulation 2.

Knows: which curves a figure has, and two scales for each: with its limits, and close up. Does not know: claims.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from gcs.physics.quadrotor import Array
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.si import torque_limits
from tools.paper.track import ENDS_S
from tools.pictures.scenery import LIMIT, colour

_STEP_S = 0.1
_THICK, _THINNER = 4.5, 0.7  # vehicles that do the same are seen as rims of each other


@dataclass(frozen=True)
class Curve:
    """Values (V, N) of every vehicle and their limits."""

    name: str
    unit: str
    values: Array
    low: float
    high: float


def draw(plan: Plan, what: str) -> Figure:
    """`what`: attitude, thrust, moments or velocity."""
    t_s = np.append(np.arange(0.0, plan.flight_s, _STEP_S), np.nextafter(plan.flight_s, 0.0))
    states, controls = plan.motion(t_s)
    limits = plan.scenario.limits
    torque = torque_limits(limits, plan.quadrotor.arm_m)
    roll, pitch, _ = limits.roll_pitch_yaw_deg
    curves = {
        "attitude": [
            Curve("pitch", "deg", np.degrees(states[..., 7]), -pitch, pitch),
            Curve("roll", "deg", np.degrees(states[..., 6]), -roll, roll),
        ],
        "thrust": [Curve("U1", "N", controls[..., 0], *limits.thrust_N)],
        "moments": [
            Curve(f"U{i + 1}", unit, controls[..., i], -torque[i - 1], torque[i - 1])
            for i, unit in ((1, "N"), (2, "N"), (3, "N m"))
        ],
        "velocity": [
            Curve(f"v_{axis}", "m/s", states[..., 3 + i], -limits.speed_ned_mps[i], limits.speed_ned_mps[i])
            for i, axis in enumerate("xyz")
        ],
    }[what]
    return _figure(plan, t_s, curves)


def _figure(plan: Plan, t_s: Array, curves: list[Curve]) -> Figure:
    figure = Figure(figsize=(9.0, 1.2 + 1.7 * len(curves)), layout="constrained")
    panels = figure.subplots(len(curves), 2, sharex=True, squeeze=False)
    for (whole, near), curve in zip(panels, curves, strict=True):
        for axes in (whole, near):
            for row, values in enumerate(curve.values):
                label = f"vehicle {plan.sysids[row]}"
                axes.plot(t_s, values, color=colour(row), lw=_THICK - _THINNER * row, label=label)
            axes.grid(alpha=0.3)
        for bound in (curve.low, curve.high):
            whole.axhline(bound, color=LIMIT, lw=1.2, ls="--")
        whole.set_ylabel(f"{curve.name}, {curve.unit}")
        room = 0.08 * (curve.high - curve.low)
        whole.set_ylim(curve.low - room, curve.high + room)
        between = curve.values[:, (t_s > ENDS_S) & (t_s < plan.flight_s - ENDS_S)]
        near.set_ylim(between.min() - 0.2 * np.ptp(between), between.max() + 0.2 * np.ptp(between))
        for bound in (curve.low, curve.high):
            low, high = near.get_ylim()
            if low <= bound <= high:
                near.axhline(bound, color=LIMIT, lw=1.2, ls="--")
    panels[0, 0].set_title("with its limits (dashed)", fontsize=9)
    panels[0, 1].set_title(f"close up, as between the first and the last {ENDS_S:g} s", fontsize=9)
    panels[0, 0].plot([], [], color=LIMIT, lw=1.2, ls="--", label="limit, Eq. 51")
    for axes in panels[-1]:
        axes.set_xlabel("time, s")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=8, ncols=len(labels), loc="outside lower center", frameon=False)
    return figure
