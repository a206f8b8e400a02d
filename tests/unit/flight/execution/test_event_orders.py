"""The events of a scenario in flight: whose reports count, and what is ordered where no plan is found."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import pytest

from gcs.errors import FlightError
from gcs.flight.contingency.policy import State
from gcs.flight.execution.scenario_events import ScenarioEvents
from gcs.flight.monitoring.progress import AskedOrder
from gcs.plan.formation_orders import Hold
from gcs.scenario.schema.scenario import EventTable
from tests.point_fleet import StandingLoop


class Flight:
    """Refuses orders that change the plan."""

    def __init__(self, *rows: EventTable) -> None:
        self.plan: Any = SimpleNamespace(scenario=SimpleNamespace(on=rows))
        states = {1: State.FLYING, 2: State.FLYING}
        self.contingency: Any = SimpleNamespace(policy=SimpleNamespace(states=states))
        self.asked: list[object] = []

    def ask(self, order: object, vehicles: object = (), *, by: str = "") -> tuple[int, ...]:
        self.asked.append(order)
        if not isinstance(order, AskedOrder):
            raise FlightError("vehicle 2 is silent.", hint="")
        return (1, 2)

    def snapshot(self) -> Any:
        return SimpleNamespace(plan_time_s=10.0)

    def vehicles_now(self) -> tuple[Any, ...]:
        return tuple(SimpleNamespace(sysid=i, battery_pct=20.0, link_age_s=30.0) for i in (1, 2))


def watched(flight: Flight, armed: bool, monkeypatch: pytest.MonkeyPatch) -> list[object]:
    monkeypatch.setattr("gcs.flight.execution.scenario_events.reported_wind", lambda _: None)
    sessions: Any = {i: SimpleNamespace(armed=armed) for i in (1, 2)}

    async def run() -> None:
        with suppress(TimeoutError):
            await asyncio.wait_for(ScenarioEvents(flight, sessions).run(), 4.0)  # type: ignore[arg-type]

    with asyncio.Runner(loop_factory=StandingLoop) as runner:
        runner.run(run())
    return flight.asked


@pytest.mark.parametrize("row", [{"silent_for_s": 5.0}, {"battery_below_percent": 30.0}])
def test_vehicles_that_have_landed_cause_no_event(row: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """They may be switched off, with an empty battery."""
    assert not watched(Flight(EventTable(**row, order="land")), False, monkeypatch)
    assert watched(Flight(EventTable(**row, order="land")), True, monkeypatch) == [AskedOrder.LAND]


def test_a_formation_that_cannot_hold_as_one_brakes_one_by_one_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    assert watched(Flight(EventTable(at_s=9.5, order="hold")), True, monkeypatch) == [Hold(), AskedOrder.HOLD]


def test_where_a_vehicle_is_not_heard_nobody_waits_for_a_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    assert watched(Flight(EventTable(silent_for_s=5.0, order="hold")), True, monkeypatch) == [AskedOrder.HOLD]
