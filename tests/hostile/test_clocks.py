"""Clocks under attack: a stranger's, the host's, and GNSS times on board that jump in flight, alone and together."""

from __future__ import annotations

import queue
import re
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from gcs.cli.main import run
from gcs.flight.recording.flight_folder import read_events
from gcs.flight.recording.flight_state import read_flight_state
from gcs.flight.recording.tlog import load_tlog
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array
from sim_bridge.faults.fault_spec import parse_faults
from sim_bridge.sim.world import World
from tests.fleets import CLOCK, EPOCH_UNIX_S
from tests.hostile.attacker import Attacker
from tests.hostile.conftest import MakeStill, MakeVehicles, all_down
from tests.hostile.ground import Ground, fly_arguments

SET_CLOCK = Path(__file__).parent / "wall_clock"
LATEST = 2**64 - 1
NEAR_M = 1.5  # of the plan, at ten times real time on a busy machine; a clock that is 20 s off is 40 m off
NO_GO = 9


def furthest_m(world: World, plan: Plan, t0_unix_s: float) -> float:
    """The largest distance of a vehicle from its plan between the take-off and the landing."""
    truth, read = world.truth, queue.SimpleQueue[tuple[Array, Array]]()
    assert truth is not None
    world.call(lambda: read.put((truth.t_s, truth.state[..., POSITION])))
    CLOCK.to_next(CLOCK.now_s + 1.0)
    at_s, states = read.get(timeout=300.0)
    t_s = at_s + EPOCH_UNIX_S - t0_unix_s
    flown = (t_s >= 0.0) & (t_s <= plan.flight_s)
    return float(np.linalg.norm(states[:, flown] - plan.states(t_s[flown])[..., POSITION], axis=-1).max())


def only_folder(flights: Path) -> Path:
    (folder,) = flights.iterdir()
    return folder


def clock_events(folder: Path) -> set[tuple[int, str]]:
    return {(one.sysid, one.what) for one in read_events(folder / "events.jsonl") if "clock" in one.what}


@pytest.mark.slow
@pytest.mark.parametrize("jumps", [("1:clock-jump=20@10..22", "2:clock-jump=3600@20", "3:clock-jump=-20@15")])
def test_jumps_of_gnss_time_are_told_and_not_followed(
    still_vehicles: MakeVehicles, hop: Plan, hop_file: Path, tmp_path: Path, jumps: tuple[str, ...]
) -> None:
    world, port = still_vehicles(faults=parse_faults(jumps, hop.sysids), record_truth=True)
    assert run(list(map(str, fly_arguments(hop_file, port, tmp_path)))) == 0
    assert all_down(world)
    folder = only_folder(tmp_path)
    assert clock_events(folder) == {
        (1, "has a GNSS time that is off by +20.0 s: it flies by its boot clock"),
        (1, "has a GNSS time that agrees with its boot clock again"),
        (2, "has a GNSS time that is off by +3600.0 s: it flies by its boot clock"),
        (3, "has a GNSS time that is off by -20.0 s: it flies by its boot clock"),
    }
    t0_unix_s = read_flight_state(folder).t0_unix_s
    assert t0_unix_s is not None
    assert furthest_m(world, hop, t0_unix_s) < NEAR_M


@pytest.mark.long
def test_a_strangers_time_the_hosts_clock_and_a_jump_of_all_vehicles_change_nothing(
    vehicles: MakeVehicles, hop: Plan, hop_file: Path, tmp_path: Path
) -> None:
    world, port = vehicles(faults=parse_faults(["all:clock-jump=3600@12"], hop.sysids), record_truth=True)
    with (
        Attacker(port) as stranger,
        Ground(*fly_arguments(hop_file, port, tmp_path), env={"PYTHONPATH": str(SET_CLOCK)}) as ground,
    ):
        ground.until("flying")
        ground.signal(signal.SIGUSR1)
        ground.until("GNSS time that is off")
        ground.signal(signal.SIGUSR2)
        while ground.running:
            stranger.heartbeat(200)
            stranger.say("SYSTEM_TIME", 200, time_unix_usec=LATEST, time_boot_ms=2**32 - 1)
            time.sleep(0.02)
        done = ground.ended()
    assert done.code == 0, done.output
    assert all_down(world)
    folder = only_folder(tmp_path)
    assert clock_events(folder) == {
        (sysid, "has a GNSS time that is off by +3600.0 s: it flies by its boot clock") for sysid in hop.sysids
    }
    t0_unix_s = read_flight_state(folder).t0_unix_s
    assert t0_unix_s is not None
    assert furthest_m(world, hop, t0_unix_s) < NEAR_M
    stamps_s = np.array([frame.stamp_us for frame in load_tlog(folder / "telemetry.tlog").frames]) / 1e6
    assert EPOCH_UNIX_S < stamps_s[stamps_s > 0.0].min() < stamps_s.max() < EPOCH_UNIX_S + 600.0


def test_a_vehicle_with_another_time_is_named_before_anything_is_armed(
    still: MakeStill, hop_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fleet, port = still(faults=["2:clock-jump=20"])
    code = run(list(map(str, fly_arguments(hop_file, port, tmp_path))))
    said = "".join(capsys.readouterr())
    assert code == NO_GO, said
    assert re.search(r"vehicle 2: clock: GNSS time is off by \+(19|20)\.\d+ s from the others", said), said
    assert "vehicle 1: clock" not in said
    assert not any(vehicle.autopilot.armed for vehicle in fleet._world.vehicles)
