"""The wind envelope of a plan for an operator: its lines, its table, and its part of `--json`."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING

from gcs.cli.shared.console import Screen

if TYPE_CHECKING:
    from gcs.plan.trajectory.plan import Plan
    from gcs.plan.verification.wind_envelope import WindBorder, WindEnvelope
    from gcs.types import JsonObject


def say_winds(screen: Screen, plan: Plan, gust_share: float = 0.0, *, whole: bool = False) -> JsonObject:
    """Print the winds in which a verified plan stays proved, as a table too if `whole`; return them for `--json`."""
    from gcs.plan.verification.wind_envelope import proved_mps, wind_envelope

    found = wind_envelope(plan, gust_share)
    least = min(found.borders, key=lambda border: border.speed_mps)
    most = max(found.borders, key=lambda border: border.speed_mps)
    gusts = f", with gusts of {gust_share:.0%} of it" if gust_share else ""
    height = f" at {found.reference_m:g} m height" if found.shear else ""
    screen.say(
        f"wind: up to {proved_mps(found.wind_ok_mps)} m/s{height} from every direction{gusts}; "
        f"{proved_mps(least.speed_mps)} m/s from {least.from_deg:g}° ({_limit(least)}) "
        f"to {proved_mps(most.speed_mps)} m/s from {most.from_deg:g}° ({_limit(most)})"
    )
    if math.isfinite(found.gust_ok_mps):
        screen.say(
            f"gusts: up to {proved_mps(found.gust_ok_mps)} m/s keep the position error within judge.position_rms_m"
        )
    if whole:
        _show(screen, found)
    return {"wind_ok_mps": found.wind_ok_mps, "wind_envelope": envelope_data(found)}


def envelope_data(found: WindEnvelope) -> JsonObject:
    """The envelope as plain values."""
    return {
        "wind_ok_mps": found.wind_ok_mps,
        "gust_ok_mps": found.gust_ok_mps if math.isfinite(found.gust_ok_mps) else None,
        "gust_share": found.gust_share,
        "reference_m": found.reference_m,
        "shear": found.shear,
        "knows_battery": found.knows_battery,
        "borders": [asdict(border) for border in found.borders],
    }


def _show(screen: Screen, found: WindEnvelope) -> None:
    from rich.table import Table

    from gcs.plan.verification.wind_envelope import proved_mps

    title = "greatest steady wind from each direction" + ("" if found.knows_battery else ", whatever the battery lasts")
    table = Table("from", "wind", "limited by", title=title)
    for border in found.borders:
        table.add_row(f"{border.from_deg:g}°", f"{proved_mps(border.speed_mps)} m/s", _limit(border))
    screen.show(table)


def _limit(border: WindBorder) -> str:
    if border.limit is None:
        return "no limit reached"
    vehicle = "" if border.sysid is None else f", vehicle {border.sysid}"
    when = "" if border.t_s is None else f", t = {border.t_s:.1f} s"
    return f"{border.limit}{vehicle}{when}"
