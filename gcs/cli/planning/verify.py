"""`gcs verify`: verify a plan again, from its polynomials alone."""

from __future__ import annotations

from gcs.cli.console import Screen
from gcs.cli.shared_options import DebugOption, JsonOption, PlanArgument


def verify(
    plan: PlanArgument,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Verify a plan again and list the least margin of every criterion.

    Exit status 0 when the plan is verified, 5 when it failed verification.

    Example: gcs verify plans/simulation1.skein
    """
    screen = Screen(json=json)
    from rich.table import Table

    from gcs.cli.plan_argument import verdict_word
    from gcs.cli.planning.plan import warn_of_position_errors
    from gcs.plan.trajectory.plan_file import load_plan
    from gcs.plan.verification.verify import refusal

    loaded, report = load_plan(plan, screen.warn)
    shown: set[str] = set()
    table = Table("criterion", "measured margin", "limit", "verdict", "where")
    for check in sorted(report.checks, key=lambda c: c.worst):
        if check.name in shown and check.ok:
            continue
        shown.add(check.name)
        when = "" if check.t_s is None else f" at {check.t_s:.2f} s"
        vehicle = "" if check.sysid is None else f", vehicle {check.sysid}"
        margin = f"{check.worst if abs(check.worst) > 1e-9 else 0.0:.4g} {check.unit}"
        limit = f"≥ {-check.tolerance:g}" if check.tolerance else "≥ 0"
        table.add_row(check.name, margin, limit, verdict_word(check.ok), f"{check.phase}{when}{vehicle}")
    screen.show(table)
    warn_of_position_errors(screen, loaded)
    screen.say(f"verified: {'yes' if report.ok else 'NO'}, {len(report.checks)} checks, {len(report.failures)} failed")
    screen.result({"ok": report.ok, "failures": [str(c) for c in report.failures], "checks": len(report.checks)})
    if report.ok:
        return 0
    if json:
        return refusal(report).exit_code
    raise refusal(report)
