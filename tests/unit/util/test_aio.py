"""Background work and several actions at once, whichever of them fails."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gcs.errors import FlightError, ProtocolMisuse
from gcs.util.aio import Stoppable, alongside, each, insisted
from tests.real_flights import in_virtual_time


async def _returns() -> None:
    await asyncio.sleep(1.0)


async def _is_cancelled() -> None:
    await asyncio.sleep(1.0)
    raise asyncio.CancelledError


async def _fails() -> None:
    await asyncio.sleep(1.0)
    raise FlightError("the stream stalled.")


@pytest.mark.parametrize(
    ("work", "failure"), [(_returns, ProtocolMisuse), (_is_cancelled, ProtocolMisuse), (_fails, FlightError)]
)
def test_a_block_does_not_go_on_without_its_background_work(work: Any, failure: type[Exception]) -> None:
    async def block() -> None:
        async with alongside(work()):
            await asyncio.sleep(1000.0)

    with pytest.raises(failure):
        in_virtual_time(block())


def test_one_action_that_fails_ends_the_others_before_anything_else_happens() -> None:
    """By any exception: an action that went on would arm a vehicle while the others are landing."""
    went_on: list[int] = []

    async def act(number: int) -> None:
        await asyncio.sleep(float(number))
        if number == 1:
            raise RuntimeError("a bug")
        went_on.append(number)

    async def fly() -> None:
        try:
            await each((1, 2, 3), act)
        finally:
            await asyncio.sleep(10.0)

    with pytest.raises(RuntimeError):
        in_virtual_time(fly())
    assert not went_on


@pytest.mark.parametrize("stop", [KeyboardInterrupt, SystemExit])
def test_an_exception_that_ends_the_event_loop_is_a_stop_and_no_more(stop: type[BaseException]) -> None:
    done: list[str] = []

    async def land() -> None:
        await asyncio.ensure_future(asyncio.sleep(0.05))  # by other tasks, which must not be cancelled
        done.append("landed")

    async def link() -> None:
        await asyncio.sleep(0.01)
        raise stop

    async def fly() -> None:
        tasks = [asyncio.ensure_future(link())]
        try:
            await asyncio.sleep(1000.0)
        finally:
            await insisted(land())
            for task in tasks:
                task.exception()  # the event loop would report it otherwise

    with pytest.raises(KeyboardInterrupt):
        Stoppable().run(fly())
    assert done == ["landed"]
