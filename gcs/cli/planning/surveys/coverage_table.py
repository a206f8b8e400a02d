"""What `gcs plan` and `gcs show` say about the coverage of a survey."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gcs.cli.console import Screen
from gcs.errors import counted

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan

_NAMED = 5  # places that are not covered
_SQUARE_M_PER_HA = 10_000.0


def say_coverage(screen: Screen, plan: Plan) -> dict[str, Any]:
    """Print the coverage of a plan's survey, and return it for `--json`; nothing where there is no survey."""
    from gcs.plan.verification.survey.coverage import coverage

    found = coverage(plan)
    if found is None:
        return {}
    gaps = found.gaps()
    area_ha = float(found.area.area) / _SQUARE_M_PER_HA
    # Cut, not rounded: 99.96 % is not all of it.
    percent = int(1e3 * found.share) / 10.0
    screen.say(
        f"coverage: {percent:g} % of {area_ha:.2f} ha proved, with {found.overlap:.0%} of it flown over more than once"
    )
    screen.say(
        f"battery: at most {float(found.used.max()):.0%} used; {found.ha_per_battery:.2f} ha per battery, "
        f"{found.reserve:.0%} of it in reserve"
    )
    if gaps:
        missed_m2 = sum(gap.area_m2 for gap in gaps)
        screen.warn(f"{missed_m2:.3g} m² of the survey are not covered, in {counted(len(gaps), 'place')}:")
        for gap in gaps[:_NAMED]:
            screen.warn(f"  {gap.area_m2:.3g} m² at north {gap.north_m:.1f} m, east {gap.east_m:.1f} m")
    return {
        "coverage": {
            "share": found.share,
            "area_m2": float(found.area.area),
            "uncovered": [vars(gap) for gap in gaps],
            "overlap": found.overlap,
            "slack_m": found.slack_m,
            "battery_share_max": float(found.used.max()),
            "ha_per_battery": found.ha_per_battery,
        }
    }
