"""A loop's clock that does not count the time in which the program itself stood still."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import subprocess
import sys
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.util.steady_loop import COUNTED_S, LATE_S, SteadyClock, SteadyLoop, host_s, stalls_of


def test_a_standstill_hardly_counts_and_is_told_once_with_its_length() -> None:
    stalls = SteadyClock(100.0)
    assert stalls.turn(100.1) == pytest.approx(100.1)
    assert stalls.turn(106.2) == pytest.approx(100.1 + COUNTED_S)
    assert stalls.count == 1
    assert stalls.last_s == pytest.approx(6.1)
    assert stalls.turn(106.3) == pytest.approx(100.2 + COUNTED_S)
    assert stalls.count == 1
    assert stalls.stood_s == pytest.approx(6.1 - COUNTED_S)


def test_a_late_turn_of_a_busy_machine_is_time_like_any_other() -> None:
    stalls = SteadyClock(0.0)
    assert stalls.turn(LATE_S) == LATE_S
    assert stalls.count == 0 and stalls.stood_s == 0.0


def test_a_turn_that_looks_at_the_clock_all_the_time_is_a_standstill_too() -> None:
    stalls = SteadyClock(0.0)
    for tenth in range(1, 311):  # work on one datagram after the other
        stalls.look(0.1 * tenth)
    assert stalls.turn(31.0) == pytest.approx(LATE_S)
    assert stalls.count == 1
    assert stalls.last_s == pytest.approx(31.0)


@given(st.lists(st.tuples(st.floats(0.0, 20.0), st.booleans()), max_size=50))
def test_it_never_runs_back_and_never_faster_than_the_host(steps: list[tuple[float, bool]]) -> None:
    host, before = 1000.0, 1000.0
    stalls = SteadyClock(host)
    for step, ends in steps:
        host += step
        now = stalls.turn(host) if ends else stalls.look(host)
        assert before <= now <= before + min(step, LATE_S) + 1e-6
        assert now + stalls.stood_s == pytest.approx(host)
        before = now


def test_waiting_is_no_standstill() -> None:
    async def wait() -> tuple[int, float]:
        loop = asyncio.get_running_loop()
        began = loop.time()
        await asyncio.sleep(LATE_S + 0.3)
        return stalls_of(loop).count, loop.time() - began

    with asyncio.Runner(loop_factory=SteadyLoop) as runner:
        count, passed = runner.run(wait())
    assert count == 0
    assert passed >= LATE_S + 0.3


def test_another_loop_counts_everything() -> None:
    async def look() -> None:
        loop = asyncio.get_running_loop()
        assert stalls_of(loop).count == 0
        assert host_s(loop) == pytest.approx(loop.time(), abs=1.0)

    asyncio.run(look())


STOPPED = """
import asyncio, socket, sys
from gcs.util.steady_loop import SteadyLoop, host_s, stalls_of

async def main():
    loop = asyncio.get_running_loop()
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind(("127.0.0.1", 0))
    sock.setblocking(False)
    heard = asyncio.Event()
    loop.add_reader(sock.fileno(), heard.set)
    began, host = loop.time(), host_s(loop)
    print(sock.getsockname()[1], flush=True)
    try:
        async with asyncio.timeout(3.0):
            await heard.wait()
        print("heard", flush=True)
    except TimeoutError:
        print("timeout", flush=True)
    print(stalls_of(loop).count, stalls_of(loop).stood_s, loop.time() - began, host_s(loop) - host, flush=True)

with asyncio.Runner(loop_factory=SteadyLoop) as runner:
    runner.run(main())
"""


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="needs signals of Unix")
def test_a_stopped_program_reads_its_answers_before_its_timeouts() -> None:
    with subprocess.Popen([sys.executable, "-c", STOPPED], stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        port = int(program.stdout.readline())
        os.kill(program.pid, signal.SIGSTOP)
        time.sleep(3.5)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
            peer.sendto(b"answer", ("127.0.0.1", port))
        os.kill(program.pid, signal.SIGCONT)
        assert program.stdout.readline().strip() == "heard"
        count, stood, passed, host = map(float, program.stdout.readline().split())
    assert count >= 1  # a busy machine adds some
    assert stood > 3.4
    assert host > 3.4
    assert passed < 3.0
