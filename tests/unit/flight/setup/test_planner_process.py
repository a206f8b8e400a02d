"""A process that keeps an object: calls in turn, errors with their hints, and its end."""

from __future__ import annotations

import asyncio
import os
import signal

import pytest

from gcs.errors import PlanningError
from gcs.flight.setup.own_process import OwnProcessEnded
from gcs.flight.setup.planner_process import PlannerProcess


class Counter:
    def __init__(self, first: int) -> None:
        self.count = first

    def add(self, number: int) -> int:
        self.count += number
        print("what the object prints is no answer")
        return self.count

    def process(self) -> int:
        return os.getpid()

    def refuse(self) -> None:
        raise PlanningError("no way", hint="land")

    def end(self) -> None:
        os.kill(os.getpid(), signal.SIGKILL)


def test_one_object_answers_all_calls_and_errors_keep_their_hints() -> None:
    async def run() -> None:
        process = PlannerProcess(Counter, 10)
        try:
            assert await asyncio.gather(process.call("add", 1), process.call("add", 2)) == [11, 13]
            with pytest.raises(PlanningError, match="no way") as refusal:
                await process.call("refuse")
            assert refusal.value.hint == "land"
            pid = await process.call("process")
            assert pid != os.getpid()
            with pytest.raises(OwnProcessEnded):
                await process.call("end")
            assert await process.call("add", 1) == 11, "a new one begins as the first did"
        finally:
            await process.close()
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)

    asyncio.run(run())
