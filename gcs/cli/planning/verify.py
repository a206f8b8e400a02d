"""`gcs verify`: check a plan again, from its polynomials alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.console import Screen
from gcs.cli.shared_options import DebugOption, JsonOption


def verify(
    plan: Annotated[Path, typer.Argument(metavar="PLAN", help="Plan file (.skein).", show_default=False)],
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Check a plan again and list the closest call of every constraint.

    Example: gcs verify plans/simulation1.skein
    """
    screen = Screen(json=json)
    from rich.table import Table

    from gcs.cli.plan_argument import refusal
    from gcs.plan.trajectory.plan_file import load_plan
    from gcs.plan.verification.verify import verify as check_plan

    loaded, _ = load_plan(plan)
    report = check_plan(loaded)
    closest: dict[str, object] = {}
    table = Table("constraint", "phase", "margin", "at", "vehicle", "holds")
    for check in sorted(report.checks, key=lambda c: c.worst):
        if check.name in closest and check.ok:
            continue
        closest[check.name] = check
        when = "" if check.t_s is None else f"{check.t_s:.2f} s"
        who = "" if check.sysid is None else str(check.sysid)
        margin = f"{check.worst if abs(check.worst) > 1e-9 else 0.0:.4g} {check.unit}"
        table.add_row(check.name, check.phase, margin, when, who, "yes" if check.ok else "NO")
    screen.show(table)
    screen.say(f"verified: {'yes' if report.ok else 'NO'}, {len(report.checks)} checks")
    screen.result({"ok": report.ok, "failures": [str(c) for c in report.failures], "checks": len(report.checks)})
    if report.ok:
        return 0
    if json:
        return refusal(report).exit_code
    raise refusal(report)
