"""The network interface goes down in flight and comes up again: the flight goes on, or lands by its rules.

The test starts itself anew in a network namespace of its own, where it may take the loopback interface down. It is
skipped where the system does not allow such namespaces.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.hostile.conftest import MakeVehicles, all_down
from tests.hostile.ground import Ground, fly_arguments

INSIDE = "SKEIN_IN_NAMESPACE"
SPEEDUP = 5.0
UNSHARE = ["unshare", "--user", "--map-root-user", "--net", "--"]


def why_not() -> str:
    """Why no namespace can be had here; empty if one can."""
    if not (shutil.which("unshare") and shutil.which("ip")):
        return "needs unshare and ip"
    tried = subprocess.run([*UNSHARE, "ip", "link", "set", "lo", "up"], capture_output=True, text=True, check=False)
    return tried.stderr.strip() or "no namespace" if tried.returncode else ""


def in_a_namespace(request: pytest.FixtureRequest) -> bool:
    """Run this very test in a namespace of its own; return whether this is the run inside it."""
    if os.environ.get(INSIDE):
        subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
        return True
    if reason := why_not():
        pytest.skip(f"no network namespace of its own: {reason}")
    line = [*UNSHARE, sys.executable, "-m", "pytest", "-q", "-n0", "-p", "no:cacheprovider", "-m", "slow or not slow"]
    done = subprocess.run(
        [*line, request.node.nodeid],
        cwd=request.config.rootpath,
        env={**os.environ, INSIDE: "1"},
        capture_output=True,
        text=True,
        timeout=400.0,
        check=False,
    )
    assert done.returncode == 0 and "1 passed" in done.stdout, done.stdout + done.stderr
    return False


def interface(state: str) -> None:
    subprocess.run(["ip", "link", "set", "lo", state], check=True)


@pytest.mark.parametrize(
    "down_s",  # of the vehicles' time
    [
        pytest.param(2.0, marks=pytest.mark.long),
        pytest.param(4.0, marks=pytest.mark.slow),
        pytest.param(16.0, marks=pytest.mark.long),
    ],
)
def test_an_interface_that_goes_down_and_up(
    request: pytest.FixtureRequest, vehicles: MakeVehicles, hop_file: Path, tmp_path: Path, down_s: float
) -> None:
    if not in_a_namespace(request):
        return
    world, port = vehicles(speedup=SPEEDUP)
    with Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        ground.until("flying")
        interface("down")
        time.sleep(down_s / SPEEDUP)
        interface("up")
        done = ground.ended()
    assert done.code in (0, 9), done.output
    assert "Traceback" not in done.output, done.output
    assert all_down(world), done.output
    if down_s < 3.0:  # no link counts as lost
        assert done.code == 0, done.output
