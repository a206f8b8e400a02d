"""Answers to the events of a scenario in flight: its orders are given as an operator would give them."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping
from contextlib import suppress
from typing import Protocol

from gcs.errors import FlightError
from gcs.flight.contingency.event_watch import DueEvent, EventWatch, Observed
from gcs.flight.contingency.order_words import order_of_event
from gcs.flight.contingency.policy import HOLDS, IN_FORMATION
from gcs.flight.execution.executor import ContingencyExecutor
from gcs.flight.monitoring.progress import AskedOrder
from gcs.flight.setup.order_socket import Ordered
from gcs.link.session.status_report import reported_wind
from gcs.link.session.vehicle_session import VehicleSession
from gcs.plan.event_plans import other_order
from gcs.scenario.schema.scenario import EventTable
from gcs.util.aio import ended

LOOK_S = 0.25


class Steered(Ordered, Protocol):
    """A flight that takes orders, with its policy."""

    @property
    def contingency(self) -> ContingencyExecutor:
        """The contingency policy at work."""
        ...


class ScenarioEvents:
    """Watches the events of one flight. `run` beside it, from T0 to the landing.

    Orders go to the vehicles that fly the plan or hold: one that returns or lands already is left at that.
    """

    def __init__(self, flight: Steered, sessions: Mapping[int, VehicleSession]) -> None:
        """`sessions` by system id."""
        self._flight, self._rows, self._sessions = flight, flight.plan.scenario.on, sessions
        self._watch = EventWatch(self._rows)
        self._answers: set[asyncio.Task[None]] = set()
        self._loop = asyncio.get_running_loop()

    async def run(self) -> None:
        """Give the orders of what happens, until cancelled. A refused order is in the flight's events."""
        if not self._rows:
            await asyncio.Event().wait()
        try:
            while True:
                await asyncio.sleep(LOOK_S)
                plan_s = self._flight.snapshot().plan_time_s
                for due in self._watch.due(
                    self._loop.time(), -math.inf if plan_s is None else plan_s, self._observed()
                ):
                    self._give(due)
        finally:
            await ended(*self._answers)

    def _give(self, due: DueEvent) -> None:
        row, by = self._rows[due.row], f"[[on]] row {due.row + 1}: {due.why}"
        order = order_of_event(row)
        if not (steered := self._steered()):
            return
        try:
            self._flight.ask(order, steered if isinstance(order, AskedOrder) else (), by=by)
        except FlightError:
            again = self._watch.refused(due.row, self._loop.time())
            if not again or row.order == "hold":
                self._give_otherwise(row, by)
            return
        if not isinstance(order, AskedOrder):
            task = asyncio.ensure_future(self._answered(row, by))
            self._answers.add(task)
            task.add_done_callback(self._answers.discard)

    async def _answered(self, row: EventTable, by: str) -> None:
        try:
            await self._flight.answer()
        except FlightError:
            self._give_otherwise(row, by)

    def _give_otherwise(self, row: EventTable, by: str) -> None:
        if (otherwise := other_order(row)) is not None and (steered := self._steered()):
            with suppress(FlightError):  # which the flight tells
                self._flight.ask(AskedOrder(otherwise), steered, by=by)

    def _steered(self) -> tuple[int, ...]:
        states = self._flight.contingency.policy.states
        return tuple(sysid for sysid, state in states.items() if state in IN_FORMATION | HOLDS)

    def _observed(self) -> list[Observed]:
        """What vehicles in the air report: one that has landed may be switched off."""
        found = []
        for one in self._flight.vehicles_now():
            if not self._sessions[one.sysid].armed:
                continue
            wind = reported_wind(self._sessions[one.sysid])
            found.append(
                Observed(one.sysid, one.battery_pct, math.nan if wind is None else wind.speed_mps, one.link_age_s)
            )
        return found
