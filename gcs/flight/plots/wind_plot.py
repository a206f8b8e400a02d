"""The polar picture of a plan's wind envelope: the greatest steady wind from each direction, and what limits it."""

from pathlib import Path
from typing import cast

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes

from gcs.flight.plots.figure_file import BESIDE, head, save, settle
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.wind_envelope import WindEnvelope, proved_mps, wind_envelope
from gcs.scenario.schema.scenario import PlannedWind

_SIZE_IN = (8.2, 6.2)
_BESIDE_IN = 2.6
_STEPS = 720
_ALLOWED, _EVERYWHERE, _PLANNED = "#2ca02c", "#1f77b4", "#d62728"
_MARKS = ("o", "s", "^", "D", "v", "P", "X")


def save_winds(plan: Plan, path: Path, gust_share: float = 0.0) -> None:
    """Draw the wind envelope of a plan in the format of the file's ending. Raises UsageError."""
    save(draw_winds(plan.scenario.name, plan.scenario.wind, wind_envelope(plan, gust_share)), path)


def draw_winds(name: str, planned: PlannedWind | None, envelope: WindEnvelope) -> Figure:
    """Return the polar picture: north up, the direction that the wind comes from, m/s outwards."""
    figure = plt.figure(figsize=_SIZE_IN, layout="constrained")
    axes = cast("PolarAxes", figure.add_subplot(projection="polar"))
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    from_deg = np.linspace(0.0, 360.0, _STEPS)
    border = [envelope.ok_from(float(deg)) for deg in from_deg]
    axes.fill(np.radians(from_deg), border, color=_ALLOWED, alpha=0.18)
    axes.plot(np.radians(from_deg), border, color=_ALLOWED, lw=1.2, label="greatest steady wind")
    label = f"from every direction: {proved_mps(envelope.wind_ok_mps)} m/s"
    axes.plot(np.radians(from_deg), np.full(_STEPS, envelope.wind_ok_mps), color=_EVERYWHERE, lw=1.0, label=label)
    limits = dict.fromkeys(each.limit for each in envelope.borders)
    for mark, limit in zip(_MARKS, limits, strict=False):
        of = [each for each in envelope.borders if each.limit == limit]
        axes.plot(
            np.radians([each.from_deg for each in of]),
            [each.speed_mps for each in of],
            mark,
            color=_ALLOWED,
            ms=4,
            label=f"limited by {limit}" if limit else "no limit up to 30 m/s",
        )
    if planned is not None and planned.speed_mps > 0.0:
        label = f"planned: {planned.speed_mps:g} m/s from {planned.from_deg:g}°"
        axes.plot(np.radians(planned.from_deg), planned.speed_mps, "*", color=_PLANNED, ms=11, label=label)
    axes.set_rlabel_position(22.5)
    axes.set_ylim(0.0, None)
    axes.legend(**BESIDE)
    gusts = f", gusts of {envelope.gust_share:.0%} of it" if envelope.gust_share else ""
    head(axes, f"{name}: winds in which the plan stays proved, m/s{gusts}", _SIZE_IN[0] - _BESIDE_IN)
    settle(figure)
    return figure
