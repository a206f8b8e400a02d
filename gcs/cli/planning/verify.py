"""`gcs verify`: verify a plan again, from its polynomials alone."""

from __future__ import annotations

from gcs.cli.console import Screen
from gcs.cli.shared_options import DebugOption, JsonOption, PlanArgument


def verify(plan: PlanArgument, json: JsonOption = False, debug: DebugOption = False) -> int:
    """Prove a plan again and list the least margin of every criterion.

    Exit status 0 when the plan is verified, 5 when it failed verification.

    Example: gcs verify plans/simulation1.skein
    """
    screen = Screen(json=json)
    from rich.table import Table

    from gcs.cli.planning.plan import warn_of_position_errors
    from gcs.plan.trajectory.plan_file import load_plan
    from gcs.plan.verification.verify import refusal

    loaded, report = load_plan(plan, screen.warn)
    shown: set[str] = set()
    table = Table("criterion", "margin", "limit", "verdict", "least at")
    for check in sorted(report.checks, key=lambda c: c.worst):
        if check.name in shown and check.ok:
            continue
        shown.add(check.name)
        when = "" if check.t_s is None else f" {check.t_s:.2f} s"
        vehicle = "" if check.sysid is None else f", {check.sysid}"
        # Where the limit is violated, the violation that was found says more than the bound.
        proved = check.proved is not None and check.verdict != "violated"
        bound = check.proved if proved and check.proved is not None else check.worst
        margin = f"{'≥ ' if proved else ''}{_zeroed(bound):.3g} {check.unit}"
        limit = f"≥ {-check.tolerance:g}" if check.tolerance else "≥ 0"
        verdict = check.verdict if check.ok else check.verdict.upper()
        table.add_row(check.name, margin, limit, verdict, f"{check.phase}{when}{vehicle}")
    screen.show(table)
    warn_of_position_errors(screen, loaded, report)
    screen.say(f"verified: {'yes' if report.ok else 'NO'}, {len(report.checks)} checks, {len(report.failures)} failed")
    if report.sampled:
        screen.say(f"sampled, not proved between instants: {', '.join(report.sampled)}")
    screen.result(
        {
            "ok": report.ok,
            "failures": [str(c) for c in report.failures],
            "checks": len(report.checks),
            "sampled": list(report.sampled),
        }
    )
    if report.ok:
        return 0
    if json:
        return refusal(report).exit_code
    raise refusal(report)


def _zeroed(margin: float) -> float:
    """The margin without a sign of rounding alone."""
    return margin if abs(margin) > 1e-9 else 0.0
