"""Ctrl-C once and more often, in a process of its own: work that must not be left ends by itself."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
import threading

import pytest

from gcs.aio import Stoppable

FLIGHT = """
import asyncio
from gcs.aio import Stoppable, insisted

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
ctrl_c.on_again = again
try:
    ctrl_c.run(fly())
except KeyboardInterrupt:
    print("stopped", flush=True)
"""


def test_a_second_ctrl_c_does_not_end_the_wait_for_the_landing() -> None:
    process = subprocess.Popen([sys.executable, "-c", FLIGHT], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    for line in ("flying", "ordered to land"):
        assert process.stdout.readline().strip() == line
        process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=60.0)
    assert said.split("\n") == ["still in the air", "landed", "stopped", ""]
    assert process.returncode == 0


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
