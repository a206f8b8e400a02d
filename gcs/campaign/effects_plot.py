"""The picture of a campaign: which factor matters for which criterion, as rank correlations."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from gcs.campaign.campaign_summary import CampaignSummary
from gcs.flight.plots.figure_file import Look, head_figure, save

_STRONG = 0.6  # from here on, text is white


def draw_effects(summary: CampaignSummary, path: Path) -> bool:
    """Draw the table of effects, and return whether there was anything to draw."""
    factors = list(dict.fromkeys(one.factor for one in summary.effects))
    figures = list(dict.fromkeys(one.figure for one in summary.effects))
    if not factors:
        return False
    found = {(one.factor, one.figure): one.correlation for one in summary.effects}
    rho = np.array([[found[factor, figure].value for factor in factors] for figure in figures])
    figure, axes = plt.subplots(figsize=(3.5 + 1.1 * len(factors), 2.0 + 0.4 * len(figures)), layout="constrained")
    shown = axes.imshow(rho, cmap="RdBu", vmin=-1.0, vmax=1.0, aspect="auto")
    axes.set_xticks(range(len(factors)), factors, rotation=30, ha="right")
    axes.set_yticks(range(len(figures)), figures)
    for row, name in enumerate(figures):
        for column, factor in enumerate(factors):
            one = found[factor, name]
            if math.isnan(one.value):
                continue
            sure = one.low > 0.0 or one.high < 0.0
            look: Look = {
                "color": "white" if abs(one.value) > _STRONG else "black",
                "weight": "bold" if sure else "normal",
            }
            axes.text(column, row, f"{one.value:+.2f}", ha="center", va="center", fontsize=9, **look)
    figure.colorbar(shown, label="rank correlation with the margin")
    flights = summary.outcomes.total()
    head_figure(figure, f"{summary.mission}: what {flights} flights depend on (red: less margin; bold: not by chance)")
    save(figure, path)
    return True
