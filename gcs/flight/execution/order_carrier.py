"""The vehicles that fly one plan together, and the orders in a crisis, repeated until carried out or out of reach."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

from gcs.errors import GcsError
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.contingency.order_book import FailedOrder, OrderBook, StandingOrder
from gcs.flight.execution.streamer import Streamer
from gcs.flight.execution.takeoff_landing import FlightVehicle, set_mode
from gcs.flight.monitoring.fleet_time import FleetTime
from gcs.flight.monitoring.monitor import Monitor
from gcs.flight.monitoring.predicted_tracks import PredictedTracks
from gcs.plan.trajectory.plan import Plan
from gcs.util.aio import ended


@dataclass(frozen=True)
class FlyingFleet:
    """The vehicles of a plan by system id, their positions, their setpoints, their common time, and the options."""

    vehicles: Mapping[int, FlightVehicle]
    monitor: Monitor
    streamer: Streamer
    time: FleetTime
    options: FlightOptions
    tracks: PredictedTracks | None = None  # of vehicles that fly missions of their own

    @property
    def plan(self) -> Plan:
        """The plan that they fly; it may be replaced in flight."""
        return self.monitor.plan

    async def land(self, sysid: int) -> None:
        """Order a vehicle to land, once, and end its stream. Raises as switching modes does."""
        vehicle = hurried(self.vehicles[sysid])
        await set_mode(vehicle, vehicle.behaviour.land)
        self.streamer.leave(sysid)


ATTEMPT_S = 6.0  # for the HEARTBEAT to show the ordered mode
OnFailure = Callable[[StandingOrder], None]


def hurried(vehicle: FlightVehicle) -> FlightVehicle:
    """Return a vehicle whose orders time out as orders in a crisis do."""
    return replace(vehicle, options=replace(vehicle.options, phase_timeout_s=ATTEMPT_S))


class OrderCarrier:
    """Carries the orders of a flight. `reachable` tells whether a vehicle is still heard, `armed` whether it is up.

    A vehicle that is not `ours` gets none.
    """

    def __init__(
        self,
        armed: Callable[[int], bool],
        reachable: Callable[[int], bool],
        ours: Callable[[int], bool] = lambda _: True,
    ) -> None:
        self._book = OrderBook()
        self._armed = armed
        self._reachable = reachable
        self._ours = ours
        self._tasks: dict[int, asyncio.Future[None]] = {}

    @property
    def failed(self) -> tuple[FailedOrder, ...]:
        """Every order that was refused or not answered at least once."""
        return self._book.failed

    def start(
        self,
        sysid: int,
        what: str,
        work: Callable[[], Awaitable[object]],
        on_failure: OnFailure,
        *,
        planned: bool = False,
    ) -> None:
        """Begin an order in place of the one before. `work` gives it once and raises an error if that fails.

        A `planned` order that a repetition carried out did not fail.
        """
        self.end(sysid)
        if self._ours(sysid):
            order = self._book.give(sysid, what, asyncio.get_running_loop().time(), planned=planned)
            self._carry(order, work, on_failure)

    def end(self, sysid: int) -> None:
        """End the order to a vehicle: a pilot flies it, or another order follows."""
        self._book.end(sysid)
        if (task := self._tasks.pop(sysid, None)) is not None:
            task.cancel()

    def stands(self, sysid: int) -> bool:
        """Whether an order to this vehicle is not carried out yet."""
        return self._book.has(sysid)

    async def close(self) -> None:
        """End all orders."""
        for sysid in self._tasks:
            self._book.end(sysid)
        await ended(*self._tasks.values())

    def _carry(self, order: StandingOrder, work: Callable[[], Awaitable[object]], on_failure: OnFailure) -> None:
        task = self._tasks[order.sysid] = asyncio.ensure_future(self._insist(order, work, on_failure))

        def again(done: asyncio.Future[None]) -> None:
            if not done.cancelled():
                done.exception()
            if self._book.stands(order):  # nothing that happens to the task ends the order
                order.failed(asyncio.get_running_loop().time(), "its task ended")
                self._carry(order, work, on_failure)

        task.add_done_callback(again)

    async def _insist(self, order: StandingOrder, work: Callable[[], Awaitable[object]], on_failure: OnFailure) -> None:
        loop = asyncio.get_running_loop()
        while self._book.stands(order):
            await asyncio.sleep(order.wait_s(loop.time()))
            if order.attempts and not (self._armed(order.sysid) and self._reachable(order.sysid)):
                break
            try:
                await work()
            except Exception as error:
                if not self._armed(order.sysid) and order.attempts:
                    break  # it has landed meanwhile
                words = error.message if isinstance(error, GcsError) else f"{type(error).__name__}: {error}"
                self._book.note_failure(order, loop.time(), words.rstrip("."))
                with suppress(Exception):  # a failed report does not end the order
                    on_failure(order)
            else:
                self._book.carried_out(order)
                return
        if self._book.stands(order):
            self._book.end(order.sysid)
