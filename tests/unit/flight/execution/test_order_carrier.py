"""Orders are given until they are carried out, or the vehicle is down or out of reach; in virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest

from gcs.errors import PeerRefusal
from gcs.flight.contingency.order_book import StandingOrder
from gcs.flight.execution.order_carrier import OrderCarrier
from tests.real_flights import in_virtual_time


class Vehicle:
    """Refuses the first orders."""

    def __init__(self, refusals: int) -> None:
        self.refusals = refusals
        self.given_s: list[float] = []
        self.armed = self.heard = True

    async def land(self) -> None:
        self.given_s.append(asyncio.get_running_loop().time())
        if len(self.given_s) <= self.refusals:
            raise PeerRefusal("vehicle 3 refused.")


def given(vehicle: Vehicle, until_s: float, change: Callable[[Vehicle], None] | None = None) -> OrderCarrier:
    """The carrier after `until_s`; `change` comes over the vehicle half way."""
    failures: list[StandingOrder] = []

    async def fly() -> OrderCarrier:
        carrier = OrderCarrier(lambda _: vehicle.armed, lambda _: vehicle.heard)
        carrier.start(3, "land", vehicle.land, failures.append)
        await asyncio.sleep(until_s / 2)
        if change is not None:
            change(vehicle)
        await asyncio.sleep(until_s / 2)
        vehicle.refusals = min(vehicle.refusals, len(failures))
        await carrier.close()
        return carrier

    return in_virtual_time(fly())


def test_a_refused_order_is_repeated_with_growing_pauses_until_it_is_carried_out() -> None:
    vehicle = Vehicle(refusals=7)
    carrier = given(vehicle, 200.0)
    pauses = [round(b - a) for a, b in zip(vehicle.given_s, vehicle.given_s[1:], strict=False)]
    assert pauses == [1, 2, 4, 8, 16, 20, 20]
    (failed,) = carrier.failed
    assert (failed.attempts, failed.carried_out) == (7, True)
    assert "vehicle 3 refused" in str(failed)
    assert not carrier.stands(3)


@pytest.mark.parametrize("attribute", ["armed", "heard"])
def test_it_ends_when_the_vehicle_is_down_or_out_of_reach(attribute: str) -> None:
    vehicle = Vehicle(refusals=1000)
    carrier = given(vehicle, 400.0, lambda one: setattr(one, attribute, False))
    assert vehicle.given_s[-1] - vehicle.given_s[0] < 225.0
    (failed,) = carrier.failed
    assert not failed.carried_out


@pytest.mark.parametrize("failure", [RuntimeError("a bug"), MemoryError(), asyncio.CancelledError()])
def test_nothing_that_happens_to_its_task_ends_an_order(failure: BaseException) -> None:
    class Breaking(Vehicle):
        async def land(self) -> None:
            await super().land()
            if len(self.given_s) < 3:
                raise failure

    vehicle = Breaking(refusals=0)
    carrier = given(vehicle, 20.0)
    assert len(vehicle.given_s) == 3
    assert not carrier.stands(3)


def test_a_report_that_fails_does_not_end_an_order() -> None:
    async def fly() -> None:
        def fail(_: StandingOrder) -> None:
            raise OSError(28, "No space left on device")

        carrier = OrderCarrier(lambda _: True, lambda _: True)
        carrier.start(3, "land", vehicle.land, fail)
        await asyncio.sleep(10.0)
        await carrier.close()

    vehicle = Vehicle(refusals=2)
    in_virtual_time(fly())
    assert len(vehicle.given_s) == 3


def test_a_vehicle_that_is_not_ours_gets_no_order() -> None:
    async def fly() -> None:
        carrier = OrderCarrier(lambda _: True, lambda _: True, lambda sysid: sysid != 3)
        carrier.start(3, "land", vehicle.land, lambda _: None)
        assert not carrier.stands(3)
        await asyncio.sleep(10.0)

    vehicle = Vehicle(refusals=0)
    in_virtual_time(fly())
    assert not vehicle.given_s


def test_an_order_that_is_carried_out_at_once_leaves_no_trace() -> None:
    vehicle = Vehicle(refusals=0)
    assert given(vehicle, 10.0).failed == ()
    assert len(vehicle.given_s) == 1
