"""Signals once and more often, in a process of its own: work that must not be left ends by itself."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from gcs.util.aio import Stoppable

HUP, INT, TERM = signal.SIGHUP, signal.SIGINT, signal.SIGTERM
FLIGHT = """
import asyncio
import sys
import signal
from gcs.util.aio import Stoppable, StopSignals, insisted

stops = StopSignals()
if "program" in sys.argv:
    stops.listen()
landed = asyncio.Event()

async def land():
    print("ordered to land", flush=True)
    helper = asyncio.ensure_future(landed.wait())  # as links and orders are
    await helper
    print("landed", flush=True)

async def fly():
    try:
        print("flying", flush=True)
        await asyncio.sleep(1000.0)
    finally:
        await insisted(land())

def again():
    print("still in the air", flush=True)
    asyncio.get_running_loop().call_later(0.2, landed.set)

ctrl_c = Stoppable()
ctrl_c.again_calls(again)
try:
    ctrl_c.run(fly())
except KeyboardInterrupt as stop:
    print("stopped by", stop, flush=True)
    sys.exit(stops.exit_code if "program" in sys.argv else 128 + signal.Signals[str(stop)])
"""


@pytest.mark.parametrize("arguments", [(), ("program",)])
@pytest.mark.parametrize("number", [INT, TERM, HUP])
def test_a_second_signal_does_not_end_the_wait_for_the_landing(number: signal.Signals, arguments: tuple[str]) -> None:
    process = subprocess.Popen([sys.executable, "-c", FLIGHT, *arguments], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    for line in ("flying", "ordered to land"):
        assert process.stdout.readline().strip() == line
        process.send_signal(number)
    said, _ = process.communicate(timeout=60.0)
    assert said.split("\n") == ["still in the air", "landed", f"stopped by {number.name}", ""]
    assert process.returncode == 128 + number


def test_a_background_job_is_stopped_by_an_explicit_sigint_too() -> None:
    in_background = ["sh", "-c", """trap "" INT; exec "$@" """, "sh"]  # as `&` in a script
    process = subprocess.Popen(
        [*in_background, sys.executable, "-c", FLIGHT, "program"], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "flying\n"
    process.send_signal(INT)
    assert process.stdout.readline() == "ordered to land\n"
    process.send_signal(TERM)
    assert process.communicate(timeout=60.0)[0] == "still in the air\nlanded\nstopped by SIGINT\n"


def test_a_closed_terminal_does_not_stop_a_program_under_nohup() -> None:
    process = subprocess.Popen(
        ["nohup", sys.executable, "-c", FLIGHT, "program"], stdout=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "flying\n"
    process.send_signal(HUP)
    process.send_signal(TERM)
    assert process.stdout.readline() == "ordered to land\n"
    process.send_signal(HUP)
    process.send_signal(TERM)
    assert process.communicate(timeout=60.0)[0] == "still in the air\nlanded\nstopped by SIGTERM\n"


def test_a_library_leaves_handlers_of_the_program_alone() -> None:
    async def work() -> list[object]:
        return [signal.getsignal(number) for number in (INT, TERM, HUP)]

    def own(*_: object) -> None:
        pass

    before = {number: signal.signal(number, handler) for number, handler in ((INT, own), (HUP, signal.SIG_IGN))}
    try:
        during = Stoppable().run(work())
        assert (during[0], during[2]) == (own, signal.SIG_IGN)
        assert during[1] is not signal.SIG_DFL
        assert signal.getsignal(TERM) is signal.SIG_DFL
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def test_work_ends_as_it_does_without_ctrl_c() -> None:
    async def work() -> int:
        await asyncio.sleep(0.0)
        return 3

    async def failing() -> None:
        raise ValueError("as it is")

    assert Stoppable().run(work()) == 3
    with pytest.raises(ValueError, match="as it is"):
        Stoppable().run(failing())
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    found: list[int] = []
    aside = threading.Thread(target=lambda: found.append(Stoppable().run(work())))
    aside.start()
    aside.join()
    assert found == [3]


WORKERS = """
from gcs.util.aio import StopSignals
from gcs.plan.search.homotopy_classes import run_all
from tests.unit.test_stoppable import wait_for_ever

if __name__ == "__main__":
    StopSignals().listen()
    try:
        run_all(wait_for_ever, [1, 2], 2)
    except KeyboardInterrupt as stop:
        print("stopped by", stop)
"""


def wait_for_ever(number: int) -> None:
    """A worker's task: print its process and wait."""
    os.write(1, f"{os.getpid()}\n".encode())  # at once: two workers print to one pipe
    time.sleep(1000.0)


@pytest.mark.parametrize("number", [TERM, pytest.param(HUP, marks=pytest.mark.slow)])
def test_workers_of_the_planner_end_with_it(number: signal.Signals, repo_root: Path) -> None:
    process = subprocess.Popen([sys.executable, "-c", WORKERS], stdout=subprocess.PIPE, text=True, cwd=repo_root)
    assert process.stdout is not None
    workers = [int(process.stdout.readline()) for _ in range(2)]
    process.send_signal(number)
    process.send_signal(number)
    assert process.communicate(timeout=60.0)[0] == f"stopped by {number.name}\n"
    for pid in workers:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
