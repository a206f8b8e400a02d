"""`gcs campaign report`: pass rates, quantiles, effects and the worst flights of a campaign."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.table import Table

from gcs.cli.shared import shared_options as shared
from gcs.cli.shared.console import Screen

if TYPE_CHECKING:
    from gcs.campaign.statistics import Interval

EFFECTS = "effects.png"
_REASONS = 6


def campaign_report(
    folder: Annotated[Path, shared.argument("Folder of the campaign.", "FOLDER")],
    json: shared.JsonOption = False,
    debug: shared.DebugOption = False,
) -> int:
    """Show a campaign's pass rates, quantiles, effects and worst flights, also while it flies.

    `gcs campaign report FOLDER` is this command. It draws the effects into effects.png of that folder.

    Example: gcs campaign-report campaigns/field
    """
    show_report(Screen(json=json), folder)
    return 0


def show_report(screen: Screen, path: Path) -> None:
    """Print the report of a campaign's folder, and draw its picture. Raises FileFormatError."""
    from gcs.campaign.campaign_options import CampaignOptions
    from gcs.campaign.campaign_summary import flight_folder, summarise
    from gcs.campaign.effects_plot import draw_effects
    from gcs.campaign.records import MARGIN, CampaignFolder

    folder = CampaignFolder(path)
    width = CampaignOptions.recorded(folder.asked()).width
    found = summarise(folder, width)
    ended = ", ".join(f"{count} {name}" for name, count in sorted(found.outcomes.items())) or "none has ended"
    screen.say(f"{found.mission}: {found.outcomes.total()} of {found.asked} flights: {ended}")
    if found.complete and width is not None and found.not_counted + found.outcomes.total() <= found.asked:
        screen.say(f"the interval of the pass rate is {width:.3g} wide: {found.not_counted} later flights do not count")
    table = _table("flights that held, with 95 % intervals (Clopper-Pearson)", "factor", "values", "held", "share")
    for one in found.strata:
        table.add_row(one.factor or "all", one.values, f"{one.held} of {one.flights}", _percent(one.rate))
    screen.show(table)
    if found.figures:
        table = _table(
            "worst value of a flight, quantiles with 95 % intervals", "criterion", "5 %", "50 %", "95 %", "margin"
        )
        for row in found.figures:
            table.add_row(row.name, *map(_interval, row.quantiles), _number(row.least_margin))
        screen.show(table)
    if found.effects:
        factors = list(dict.fromkeys(one.factor for one in found.effects))
        table = _table("rank correlation with the margin; * : not by chance (95 %)", "criterion", *factors)
        cells = {(one.figure, one.factor): _effect(one.correlation) for one in found.effects}
        for figure in dict.fromkeys(one.figure for one in found.effects):
            table.add_row(figure, *(cells[figure, factor] for factor in factors))
        screen.show(table)
        if draw_effects(found, path / EFFECTS):
            screen.say(f"picture: {path / EFFECTS}")
    for outcome, reason, count in found.reasons[:_REASONS]:
        screen.say(f"{count} {outcome}: {reason}")
    for row in found.figures:
        for index in row.worst[:1]:
            if index in found.kept:
                screen.say(f"least {row.name}{MARGIN}: gcs refly {flight_folder(path, index)}")
    screen.result(found.data() | {"folder": str(path)})


def _table(title: str, *headings: str) -> Table:
    table = Table(title=title)
    for heading in headings:
        table.add_column(heading, overflow="fold")
    return table


def _percent(one: Interval) -> str:
    if math.isnan(one.value):
        return "–"
    return f"{100 * one.value:.1f} % ({100 * one.low:.1f} to {100 * one.high:.1f})"


def _interval(one: Interval) -> str:
    return f"{_number(one.value)} ({_number(one.low)} to {_number(one.high)})"


def _number(value: float) -> str:
    if math.isnan(value):
        return "–"
    return f"{value:.3f}" if math.isfinite(value) else ("∞" if value > 0 else "-∞")


def _effect(one: Interval) -> str:
    if math.isnan(one.value):
        return "–"
    return f"{one.value:+.2f}{' *' if one.low > 0.0 or one.high < 0.0 else ''}"
