"""What the planner's process does for a flight: plans that replace the rest of the flown one, and their setpoints."""

from dataclasses import dataclass
from pathlib import Path

from gcs.flight.monitoring.progress import PlanForecast
from gcs.flight.setup.plan_forecast import forecast_of
from gcs.mission.export.setpoint_stream import build_stream
from gcs.mission.model import SetpointStream
from gcs.plan.plan_changer import PlanChanger, PlanOrder, Proposal
from gcs.plan.plan_file import save_plan
from gcs.plan.replanning.formation_rest import with_empty_places
from gcs.plan.replanning.plan_pieces import continued
from gcs.plan.trajectory.plan import Plan


@dataclass(frozen=True)
class Replacement:
    """A verified plan from an instant on, its setpoints, the file that it is kept in, and the seconds that it took."""

    plan: Plan
    stream: SetpointStream
    file: Path | None
    took_s: float


class PlanWorker:
    """Changes the plan of one flight. `folder`: where new plans are kept, as `NAME.made` until they are flown."""

    def __init__(self, plan: Plan, folder: Path | None) -> None:
        self._changer, self._flown = PlanChanger(plan), plan  # the flown one keeps the places of vehicles that left
        self._folder = folder
        self._made: Proposal | None = None

    def rehearse(self) -> dict[bool, float]:
        """Build the programs, and return the seconds that a plan takes: by the optimiser (False), and without it."""
        return self._changer.rehearse()

    def change(self, order: PlanOrder, begin_s: float, name: str) -> Replacement:
        """The plan that carries out an order from `begin_s` on. Raises as `PlanChanger.change`."""
        found = self._changer.change(order, begin_s)
        stream = build_stream(with_empty_places(self._flown, found.plan), found.plan.scenario.mission.setpoint_rate_hz)
        file = None if self._folder is None else self._folder / f"{name}.made"
        if file is not None:
            save_plan(found.plan, found.report, file)
        self._made = found
        return Replacement(found.plan, stream, file, found.took_s)

    def propose(self, order: PlanOrder, begin_s: float) -> PlanForecast:
        """What an order would lead to, planned and verified as if it were given. Raises as `PlanChanger.change`."""
        found = self._changer.change(order, begin_s)
        return forecast_of(self._changer.flown, found)

    def adopt(self) -> None:
        """The vehicles fly the last plan: go on from it."""
        assert self._made is not None
        self._changer.adopt(self._made)
        self._flown = continued(self._flown, self._made.plan)
