"""The values that the paper leaves out: each is varied alone, and every sentence is judged again."""

from collections.abc import Callable
from typing import Any

import gcs
from gcs.errors import GcsError
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario

FORCES, MOMENTS = "forces, N", "moments, N m"
VALUES: dict[str, tuple[str, str, tuple[Any, ...]]] = {  # key of the scenario: symbol, unit, what it is varied to
    "objective.height_ref_m": ("h_r", "m", (10.0, 15.0, 20.0, 25.0, 30.0)),
    "objective.heading_scale_deg": ("heading scale", "°", (5.0, 10.0, 30.0, 60.0)),
    "objective.height_scale_m": ("height scale", "m", (10.0, 20.0, 40.0)),
    "objective.drag_power_Ns2pm2": ("k_f", "N s²/m²", (0.0073, 0.0146, 0.0292)),
    "limits.clearance_min_m": ("h_min", "m", (0.25, 0.5, 1.0)),
    "limits.load_factor_max": ("n_max", "", (0.1, 0.2, 0.3)),
    "limits.control_margin": ("control margin", "", (0.15, 0.3)),
    "limits.roll_pitch_force_N": ("U2, U3", "", (FORCES, MOMENTS)),  # a unit that the paper prints in two ways
}
HEAD = "| unstated value | chosen | varied to | no plan at |\n| --- | --- | --- | --- |"
HEADING_SCALE = "objective.heading_scale_deg"


def value_of(scenario: Scenario, key: str) -> Any:
    """The value that a study has."""
    table, name = key.split(".")
    value = getattr(getattr(scenario, table), name)
    return FORCES if isinstance(value, tuple) else value


def with_value(scenario: Scenario, key: str, to: Any) -> Scenario:
    """The scenario with one value changed, or with the numbers for U2 and U3 read as moments."""
    name, changed = key.split(".")
    table, new = getattr(scenario, name), {changed: to}
    if to == MOMENTS:
        new = {"roll_pitch_force_N": None, "roll_pitch_moment_Nm": table.roll_pitch_force_N}
    return scenario.model_copy(update={name: table.model_copy(update=new)})


def vary(plans: dict[str, Plan], judge: Callable[[dict[str, Plan]], Any]) -> list[Any]:
    """For every value and every change of it the verdicts, None where a flight has no plan."""
    chosen, rows = judge(plans), []
    for key, (symbol, unit, values) in VALUES.items():
        (own,) = {value_of(plan.scenario, key) for plan in plans.values()}  # all studies agree
        tried = []
        for to in values:
            print(f"vary: {symbol} = {to}", flush=True)
            changed = {name: with_value(plan.scenario, key, to) for name, plan in plans.items() if to != own}
            try:
                found = judge({name: gcs.make_plan(s) for name, s in changed.items()}) if changed else chosen
            except GcsError:
                found = None
            tried.append({"value": to, "holds": found and [holds for holds, *_ in found.values()]})
        rows.append({"symbol": symbol, "unit": unit, "chosen": own, "tried": tried})
    return rows


def column(rows: list[Any], number: int) -> str:
    """What decides sentence `number` (from 0), and where it holds."""
    said = []
    for row in rows:
        seen = [(_shown(t["value"]), t["holds"][number]) for t in row["tried"] if t["holds"] is not None]
        where, but = (", ".join(value for value, holds in seen if holds is which) for which in (True, False))
        if where and but:
            said.append(f"{row['symbol']}: holds at {where} {row['unit']}; not at {but}".replace(" ;", ";"))
    return "<br>".join(said) or "none of them"


def summary(row: dict[str, Any]) -> str:
    """A row of the table of values: what was varied, and where no plan was found."""
    others = ", ".join(_shown(t["value"]) for t in row["tried"] if t["value"] != row["chosen"])
    none = ", ".join(_shown(t["value"]) for t in row["tried"] if t["holds"] is None)
    chosen = f"{_shown(row['chosen'])} {row['unit']}".rstrip()
    return f"| {row['symbol']} | {chosen} | {others} | {none} |"


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"
