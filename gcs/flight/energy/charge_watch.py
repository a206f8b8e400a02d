"""The charge of every vehicle of a flight: measured against modelled discharge, and the choice at a low battery."""

from __future__ import annotations

from collections.abc import Sequence

from gcs.flight.energy.energy_choice import Discharge, EnergyAdviser, EnergyChoice, EnergySituation, SafePoint
from gcs.flight.monitor import VehicleView
from gcs.plan.trajectory.plan import Plan


class ChargeWatch:
    """Follows the discharge of a plan's vehicles by their reports. Time is an argument."""

    def __init__(self, plan: Plan, adviser: EnergyAdviser) -> None:
        self._rows = {sysid: row for row, sysid in enumerate(plan.sysids)}
        self._adviser = adviser
        self._discharge = {sysid: Discharge() for sysid in plan.sysids}
        self._seen_s: dict[int, float] = {}

    def watch(self, sysid: int, unix_s: float, remaining_pct: int | None, plan_time_s: float | None) -> None:
        """Take in the charge of an airborne vehicle. `plan_time_s` None: it does not fly the plan now."""
        before_s = self._seen_s.get(sysid, unix_s)
        self._seen_s[sysid] = unix_s
        passed_s, model, discharge = max(unix_s - before_s, 0.0), self._adviser.model, self._discharge[sysid]
        if plan_time_s is None:
            discharge.expect(model.hover_per_s * passed_s)
        else:
            discharge.expect(model.planned_use(self._rows[sysid], plan_time_s - passed_s, plan_time_s))
        if remaining_pct is not None:
            discharge.report(remaining_pct / 100.0)

    def decide(
        self,
        view: VehicleView,
        remaining_pct: float,
        reserve_pct: float,
        plan_time_s: float | None,
        points: Sequence[SafePoint] = (),
        heading: SafePoint | None = None,
    ) -> EnergyChoice:
        """Return the choice of one vehicle. `plan_time_s` None: it left the plan; `heading` is where it flies to."""
        now = EnergySituation(
            self._rows[view.sysid],
            view.position_ned_m,
            view.velocity_ned_mps,
            remaining_pct,
            plan_time_s,
            self._discharge[view.sysid].scale,
            points,
            heading,
        )
        return self._adviser.decide(now, reserve_pct)
