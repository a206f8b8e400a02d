"""Setpoints leave on time whatever the page does: shown to nobody, or frozen."""

from __future__ import annotations

import os
import signal
import subprocess
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from gcs.flight.recording.tlog import load_tlog
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array
from sim_bridge.protocol.endpoint_address import call
from sim_bridge.sim.world import WorldOptions
from tests.bridge.test_page_in_flight import page_of
from tests.fleets import free_port, running_fleet
from tests.kept import GCS

LATE_S = 0.1  # one period, for 99 of 100: on a busy machine 46 ms without any reader; a page waited for takes seconds


@pytest.mark.slow
@pytest.mark.parametrize("what", ["alone", "frozen"])
def test_setpoints_leave_on_time_whatever_the_page_does(
    hop: Plan, hop_skein: Path, tmp_path: Path, what: str, record_property: pytest.RecordProperty
) -> None:
    port = free_port()
    line = [*GCS, "fly", str(hop_skein), "--link", f"udpin:127.0.0.1:{port}", "--yes-arm", "--page"]
    with (
        running_fleet(hop.scenario, WorldOptions(links=(call(port),), speedup=1.0)),
        subprocess.Popen([*line, "--to", str(tmp_path)], stdout=subprocess.PIPE, text=True) as command,
        ExitStack() as stack,
    ):
        stack.callback(command.kill)
        assert command.stdout is not None
        said: list[str] = []
        while "flying: t =" not in (said[-1] if said else ""):
            said.append(command.stdout.readline())
            assert said[-1], f"it ended: {said}"
        if what == "frozen":
            os.kill(page_of(command.pid), signal.SIGSTOP)
        said.append(command.stdout.read())
        assert command.wait() == 0, said
    (log,) = tmp_path.glob("*/telemetry.tlog")
    late_s = lateness_s(log)
    figures = [float(np.percentile(late_s, share)) for share in (50, 95, 99, 100)]
    record_property("late_ms", [round(1e3 * one, 1) for one in figures])
    print(what, "late, ms: median, 95 %, 99 %, most:", [round(1e3 * one, 1) for one in figures])
    assert len(late_s) > 3 * 10 * 20 and figures[2] < LATE_S


def lateness_s(log: Path) -> Array:
    """How much later than the least late one to its vehicle every setpoint was sent, by the time that it is for."""
    late_s: dict[int, list[float]] = {}
    for frame in load_tlog(log).frames:
        if frame.message is not None and frame.message.name == "SET_POSITION_TARGET_LOCAL_NED":
            fields = frame.message.fields
            at_s = frame.stamp_us / 1e6 - fields["time_boot_ms"] / 1e3
            late_s.setdefault(fields["target_system"], []).append(at_s)
    return np.concatenate([np.array(each) - np.percentile(each, 1) for each in late_s.values()])
