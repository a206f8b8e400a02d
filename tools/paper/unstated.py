"""The values the paper leaves out: each is varied alone, and every sentence is judged again.

Knows: which values, how far they are varied, and how a column shows the verdicts. Does not know: sentences.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gcs
from gcs.errors import GcsError
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from tools.paper.claims import Claim
from tools.paper.run import ROOT, Run

Judge = Callable[[dict[str, Plan]], list[Claim]]
FORCES, MOMENTS = "forces, N", "moments, N m"


@dataclass(frozen=True)
class Unstated:
    """One value: its key in the scenario, its symbol, and what it is varied to."""

    table: str
    key: str
    symbol: str
    unit: str
    values: tuple[float, ...]


VALUES = (
    Unstated("objective", "height_ref_m", "h_r", "m", (10.0, 15.0, 20.0, 25.0, 30.0)),
    Unstated("objective", "heading_scale_deg", "heading scale", "°", (5.0, 10.0, 30.0, 60.0)),
    Unstated("objective", "height_scale_m", "height scale", "m", (10.0, 20.0, 40.0)),
    Unstated("objective", "drag_power_Ns2pm2", "k_f", "N s²/m²", (0.0073, 0.0146, 0.0292)),
    Unstated("limits", "clearance_min_m", "h_min", "m", (0.25, 0.5, 1.0)),
    Unstated("limits", "load_factor_max", "n_max", "", (0.1, 0.2, 0.3)),
    Unstated("limits", "control_margin", "control margin", "", (0.15, 0.3)),
)
READING = "U2, U3"  # the unit of two limits that the paper prints in two ways


def with_value(scenario: Scenario, value: Unstated, to: float) -> Scenario:
    """The scenario with one value changed."""
    table = getattr(scenario, value.table)
    return scenario.model_copy(update={value.table: table.model_copy(update={value.key: to})})


def as_moments(scenario: Scenario) -> Scenario:
    """The scenario with the same numbers for U2 and U3, read as moments."""
    limits = scenario.limits
    other = {"roll_pitch_force_N": None, "roll_pitch_moment_Nm": limits.roll_pitch_force_N}
    return scenario.model_copy(update={"limits": limits.model_copy(update=other)})


def vary(run: Run, missions: list[str], judge: Judge) -> list[dict[str, Any]]:
    """For every value and every change of it, the verdicts by sentence number; those of the chosen one are known."""
    chosen = [bool(claim.holds) for claim in judge({name: run.plan(name) for name in missions})]
    scenarios = {name: gcs.load_scenario(ROOT / "missions" / name) for name in missions}
    rows = []
    for value in VALUES[:1] if run.short else VALUES:
        used = {getattr(getattr(s, value.table), value.key) for s in scenarios.values()}
        assert len(used) == 1, f"the studies disagree on {value.key}: {used}"
        own = used.pop()
        tried: dict[Any, list[bool] | None] = {own: chosen}
        for to in value.values[-1:] if run.short else value.values:
            if to != own:
                changed = {name: with_value(s, value, to) for name, s in scenarios.items()}
                tried[to] = _verdicts(run, f"{value.symbol} = {to:g}", changed, judge)
        rows.append(_row(value.symbol, value.unit, own, tried))
    if not run.short:
        moments = _verdicts(run, "U2, U3 as moments", {n: as_moments(s) for n, s in scenarios.items()}, judge)
        rows.append(_row(READING, "", FORCES, {FORCES: chosen, MOMENTS: moments}))
    return rows


def _row(symbol: str, unit: str, own: Any, tried: dict[Any, list[bool] | None]) -> dict[str, Any]:
    ordered = sorted(tried.items(), key=lambda item: item[0])
    return {"symbol": symbol, "unit": unit, "chosen": own, "tried": [{"value": v, "holds": h} for v, h in ordered]}


def _verdicts(run: Run, what: str, scenarios: dict[str, Scenario], judge: Judge) -> list[bool] | None:
    """None where one of the flights has no plan."""
    run.log(f"vary: {what}")
    try:
        plans = {name: gcs.make_plan(scenario) for name, scenario in scenarios.items()}
    except GcsError as error:
        run.log(f"vary: {what}: {error.message}")
        return None
    return [bool(claim.holds) for claim in judge(plans)]


def column(rows: list[dict[str, Any]], number: int) -> str:
    """What decides sentence `number` (from 0), and where it holds."""
    told = []
    for row in rows:
        seen = [(t["value"], t["holds"][number]) for t in row["tried"] if t["holds"] is not None]
        if len({holds for _, holds in seen}) > 1:
            where = ", ".join(_shown(value) for value, holds in seen if holds)
            but = ", ".join(_shown(value) for value, holds in seen if not holds)
            told.append(f"{row['symbol']}: holds at {where} {row['unit']}; not at {but}".replace(" ;", ";"))
    return "<br>".join(told) or "none of them"


def summary(rows: list[dict[str, Any]]) -> list[str]:
    """Which values were varied, and where no plan was found."""
    lines = ["| unstated value | chosen | varied to | no plan at |", "| --- | --- | --- | --- |"]
    for row in rows:
        others = [_shown(t["value"]) for t in row["tried"] if t["value"] != row["chosen"]]
        none = [_shown(t["value"]) for t in row["tried"] if t["holds"] is None]
        chosen = f"{_shown(row['chosen'])} {row['unit']}".rstrip()
        lines.append(f"| {row['symbol']} | {chosen} | {', '.join(others)} | {', '.join(none)} |")
    return lines


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"
