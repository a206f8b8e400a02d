"""The ground station itself stands still (SIGSTOP) in every phase of a flight: nobody lands for it, nobody is lost.

The vehicles fly several times as fast as the clock, so a standstill is as many times longer for them. They do not wait
for setpoints here: each does what its autopilot does without them.
"""

from __future__ import annotations

import json
import re
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim_bridge.sim import world as worlds
from sim_bridge.sim.world import World
from tests.fleets import wait_until
from tests.hostile.conftest import MakeVehicles, all_down
from tests.hostile.ground import Ended, Ground, fly_arguments

SETPOINT = 84  # SET_POSITION_TARGET_LOCAL_NED
BOTH = ["ardupilot", "px4"]
LANDING_POINT_M = [60.0, 20.0]


@contextmanager
def stopped_in_the_air(ground: Ground, world: World) -> Iterator[None]:
    """Stop the ground station on the first part of the plan, until it has led its vehicles back.

    Emulated vehicles would wait for setpoints, up to 3 s of the clock; real ones do not, nor these meanwhile.
    """
    ground.until("take-off")
    start = world.airframes.truth[0, :2].copy()
    wait_until(lambda: float(np.linalg.norm(world.airframes.truth[0, :2] - start)) > 8.0, 120.0)
    before_s, worlds.TIMEOUT_S = worlds.TIMEOUT_S, 0.1
    time.sleep(0.3)  # a wait that has begun lasts as long as it should when it began
    try:
        ground.signal(signal.SIGSTOP)
        yield
        ground.signal(signal.SIGCONT)
        ground.until("are led back to the plan")
    finally:
        worlds.TIMEOUT_S = before_s


def events(flights: Path) -> list[dict[str, Any]]:
    (file,) = flights.glob("*/events.jsonl")
    return [json.loads(line) for line in file.read_text().splitlines()]


def told(done: Ended, least_s: float = 0.0) -> list[str]:
    """The standstills of this length or more that it told; a busy machine makes some of its own."""
    found = re.findall(r"this program stood still for [\d.]+ s", done.output)
    return [words for words in found if float(words.split()[-2]) > least_s - 0.15]


def has_flown_its_plan(done: Ended, world: World) -> None:
    assert done.code == 0, done.output
    assert "ordered to land" not in done.output
    assert " lost" not in done.output
    assert "link lost" not in done.output
    assert all_down(world)
    assert abs(world.airframes.truth[0, :2] - LANDING_POINT_M).max() < 1.0, "it did not land where planned"


def least_separation_m(world: World) -> float:
    places = world.airframes.truth[:, :3]
    return min(float(np.linalg.norm(a - b)) for n, a in enumerate(places) for b in places[:n])


def stopped_in_flight(
    make: MakeVehicles, hop_file: Path, tmp_path: Path, autopilot: str, seconds: float, speedup: float
) -> Ended:
    world, port = make(autopilot, speedup=speedup)
    with Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        with stopped_in_the_air(ground, world):
            time.sleep(seconds)
        nearest_m = np.inf
        while ground.running:
            if not world.airframes.landed.any():
                nearest_m = min(nearest_m, least_separation_m(world))
            time.sleep(0.02)
        done = ground.ended()
    has_flown_its_plan(done, world)
    assert nearest_m > 3.5, "5 m apart in the plan"
    assert len(told(done, seconds)) == 1, "once"
    what = [event["what"] for event in events(tmp_path) if event["sysid"] == -1]
    assert [f"this program {words}" for words in what] == told(done)
    assert "are led back to the plan" in done.output
    return done


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["ardupilot", pytest.param("px4", marks=pytest.mark.long)])
def test_stopped_in_flight_it_leads_all_back_to_the_plan(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path, autopilot: str
) -> None:
    """10 s for the vehicles: ArduCopter has braked and hovers, PX4 has left Offboard and descends."""
    done = stopped_in_flight(vehicles, hop_file, tmp_path, autopilot, 2.0, 5.0)
    assert "which goes on" in done.output
    if autopilot == "px4":
        assert done.output.count("ordered to follow setpoints again") >= 3


@pytest.mark.parametrize(
    "autopilot", [pytest.param("ardupilot", marks=pytest.mark.slow), pytest.param("px4", marks=pytest.mark.long)]
)
def test_stopped_on_the_ground_or_in_a_landing_it_goes_on(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path, autopilot: str
) -> None:
    """Stopped in the upload, in the take-off and in the landing: 15 s of the vehicles' time each."""
    world, port = vehicles(autopilot)
    with Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        for line in ("upload and read back", "take-off", "landing"):
            ground.until(line)
            time.sleep(0.1)
            ground.freeze(1.5)
        done = ground.ended()
    has_flown_its_plan(done, world)
    assert len(told(done, 1.4)) >= 3


@pytest.mark.long
@pytest.mark.parametrize("seconds", [2.0, 6.0, 15.0])
@pytest.mark.parametrize("autopilot", BOTH)
def test_at_real_speed_in_flight(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path, autopilot: str, seconds: float
) -> None:
    stopped_in_flight(vehicles, hop_file, tmp_path, autopilot, seconds, 1.0)


@pytest.mark.long
@pytest.mark.parametrize("seconds", [2.0, 6.0, 15.0])
@pytest.mark.parametrize("line", ["waiting for readiness", "upload and read back", "take-off", "flying", "landing"])
@pytest.mark.parametrize("autopilot", BOTH)
def test_in_every_phase_for_every_time(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path, autopilot: str, line: str, seconds: float
) -> None:
    world, port = vehicles(autopilot, speedup=2.0)
    with Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        ground.until(line)
        time.sleep(0.3)
        ground.freeze(seconds)
        done = ground.ended()
    has_flown_its_plan(done, world)
    assert len(told(done, seconds)) == 1


@pytest.mark.slow
def test_emulated_vehicles_that_wait_meanwhile_notice_nothing(hop_file: Path, tmp_path: Path) -> None:
    """Station and vehicles of `--sim` share one time, which stands with the process: there is nothing to tell."""
    with Ground("fly", hop_file, "--sim", "--speedup", "max", "--to", tmp_path) as ground:
        ground.until("flying")
        for _ in range(2):
            ground.freeze(1.3)
            time.sleep(0.3)
        done = ground.ended()
    assert done.code == 0, done.output
    assert told(done) == []
    assert "stayed without setpoints" not in done.output
