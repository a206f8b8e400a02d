"""What the planner's process does for a flight: plans that replace the rest of the flown one, and their setpoints."""

from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path

from gcs.errors import GcsError, PlanningError
from gcs.flight.monitoring.progress import PlanForecast
from gcs.flight.setup.plan_forecast import forecast_of
from gcs.mission.export.setpoint_stream import build_stream
from gcs.mission.model import SetpointStream
from gcs.plan.formation_orders import FlyHome, PlanOrder
from gcs.plan.plan_changer import PlanChanger, Proposal
from gcs.plan.plan_file import read_returns, save_plan, stored_returns
from gcs.plan.prepared_returns import PreparedReturns
from gcs.plan.replanning.formation_rest import with_empty_places
from gcs.plan.replanning.plan_pieces import continued
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.no_fly import zones
from gcs.scenario.schema.scenario import NoFlyZone

GivenZones = tuple[tuple[NoFlyZone, float], ...]  # each with the plan time since when it counts
WAIT_S = 15.0  # for a prepared return: one that begins later is flown where none is found by planning
_TRIED = 2  # prepared returns: each is verified anew


@dataclass(frozen=True)
class Replacement:
    """A verified plan from an instant on, its setpoints, and the file that it is kept in."""

    proposal: Proposal
    stream: SetpointStream
    file: Path | None

    @property
    def plan(self) -> Plan:
        """The plan, of the vehicles that fly it."""
        return self.proposal.plan


class PlanWorker:
    """Changes the plan of one flight. `folder`: where new plans are kept, as `NAME.made` until they are flown.

    `prepared`: a plan file that may have returns. `flies`: what the last order led to, in a process that takes up the
    work of another one.
    """

    def __init__(
        self, plan: Plan, folder: Path | None, prepared: Path | None = None, flies: Proposal | None = None
    ) -> None:
        self._changer, self._flown = PlanChanger(plan), plan  # the flown one keeps the places of vehicles that left
        self._folder, self._prepared = folder, prepared
        self._returns: PreparedReturns | None = None
        self._made: Proposal | None = None
        if flies is not None:
            self._changer = PlanChanger(flies.plan, flies.left, flies.pace)

    def rehearse(self) -> dict[bool, float]:
        """Build the programs, and return the seconds that a plan takes: by the optimiser (False), and without it."""
        self._read_returns()
        return self._changer.rehearse()

    def change(self, order: PlanOrder, begin_s: float, name: str, given: GivenZones = ()) -> Replacement:
        """The plan that carries out an order from `begin_s` on. Raises as `PlanChanger.change`.

        `given`: zones that came up, and the plan times since when they count.
        """
        return self._kept(self._changer.change(order, begin_s), name, given)

    def fly_home(
        self, order: FlyHome, from_s: float, within_s: float, name: str, given: GivenZones = ()
    ) -> Replacement | None:
        """The next prepared return that begins at or after `from_s` and within a time; None where none can be flown."""
        found = self._ready_return(order, from_s, within_s)
        return None if found is None else self._kept(found, name, given)

    def _ready_return(self, order: FlyHome, from_s: float, within_s: float) -> Proposal | None:
        ahead = self._read_returns().from_on(from_s)
        for one in [one for one in ahead if one.begins_s <= from_s + max(within_s, one.cpu_s)][:_TRIED]:
            with suppress(PlanningError):
                return self._changer.begin_return(one, order.zones)
        return None

    def _read_returns(self) -> PreparedReturns:
        if self._returns is None:
            self._returns = PreparedReturns(())
            if self._prepared is not None:
                with suppress(GcsError):  # each is planned when it is asked for
                    self._returns = read_returns(self._prepared, stored_returns(self._prepared))
        return self._returns

    def _kept(self, found: Proposal, name: str, given: GivenZones) -> Replacement:
        since_s = [max((t_s for one, t_s in given if one == zone), default=-inf) for zone in zones(found.plan.scenario)]
        if max(since_s, default=-inf) > -inf:
            found = replace(found, plan=replace(found.plan, zones_since_s=tuple(since_s)))
        stream = build_stream(with_empty_places(self._flown, found.plan), found.plan.scenario.mission.setpoint_rate_hz)
        file = None if self._folder is None else self._folder / f"{name}.made"
        if file is not None:
            save_plan(found.plan, found.report, file)
        self._made = found
        return Replacement(found, stream, file)

    def propose(self, order: PlanOrder, begin_s: float) -> PlanForecast:
        """What an order would lead to, planned and verified as if it were given. Raises as `PlanChanger.change`."""
        ready = self._ready_return(order, begin_s, WAIT_S) if isinstance(order, FlyHome) else None
        return forecast_of(self._changer.flown, ready or self._changer.change(order, begin_s))

    def adopt(self) -> None:
        """The vehicles fly the last plan: go on from it. A process that began with that plan does so already."""
        made, self._made = self._made, None
        if made is not None:
            self._changer.adopt(made)
            self._flown = continued(self._flown, made.plan)
