"""`gcs attach` after the ground station was killed, whatever was going on: it finds the flight, and lands it."""

from __future__ import annotations

import json
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from gcs.cli.main import run
from gcs.flight.execution.resume import where_in_plan
from gcs.flight.recording.flight_state import NAME, held_folder
from gcs.plan.trajectory.plan import Plan
from sim_bridge.faults.fault_spec import parse_faults
from sim_bridge.sim.world import World
from tests.fleets import wait_until
from tests.hostile.attacker import Attacker
from tests.hostile.conftest import MakeVehicles, all_down
from tests.hostile.ground import Ended, Ground, fly_arguments

STOPPED, USAGE, FLIGHT, FILE = 130, 2, 9, 6
GUIDED = 4


def attach(flights: Path, *arguments: object) -> Ended:
    with Ground("attach", "--to", flights, *arguments) as ground:
        return ground.ended()


@contextmanager
def silent(world: World, sysid: int) -> Iterator[None]:
    """A vehicle neither hears nor says anything, and hovers on."""
    (fault,) = parse_faults([f"{sysid}:silent"], world.sysids)[sysid]
    row = world.sysids.index(sysid)
    world.injector.add(row, fault, world.t_s)
    try:
        yield
    finally:
        world.injector.end(row, [fault.kind], world.t_s)


@contextmanager
def lies(world: World, port: int) -> Iterator[None]:
    """A stranger says all the time that every vehicle stands on the ground."""
    over = threading.Event()

    def speak(stranger: Attacker) -> None:
        while not over.wait(0.01):
            for sysid in world.sysids:
                stranger.heartbeat(sysid, mode=9, armed=False)

    with Attacker(port) as stranger:
        thread = threading.Thread(target=speak, args=(stranger,))
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()


def killed(world: World, port: int, plan: Path, flights: Path, moment: str = "flying") -> None:
    """A flight whose ground station is killed when it says `moment`; the vehicles are in the air then."""
    with Ground(*fly_arguments(plan, port, flights)) as ground:
        ground.until(moment)
        wait_until(lambda: not world.airframes.landed.any())
        ground.signal(signal.SIGKILL)
        assert ground.ended().code == -signal.SIGKILL


@pytest.mark.parametrize(
    "order", [pytest.param("--land", marks=pytest.mark.slow), pytest.param("--return", marks=pytest.mark.long)]
)
def test_a_vehicle_that_is_not_heard_does_not_keep_the_others_up(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path, order: str
) -> None:
    world, port = vehicles()
    killed(world, port, hop_file, tmp_path)
    with silent(world, 2):
        first = attach(tmp_path, order)
        assert first.code == FLIGHT, first.output
        assert "vehicle 2 not heard" in first.output
        assert world.airframes.landed.tolist() == [True, False, True]
    last = attach(tmp_path, "--land")
    assert last.code == 0, last.output
    assert all_down(world)


@pytest.mark.long
@pytest.mark.parametrize("moment", ["take-off", "landing: t = "])
def test_it_lands_after_a_kill_in_every_phase(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path, moment: str
) -> None:
    world, port = vehicles(speedup=3.0)
    killed(world, port, hop_file, tmp_path, moment)
    done = attach(tmp_path, "--land")
    assert done.code == 0, done.output
    assert all_down(world)


@pytest.mark.long
def test_it_lands_after_a_kill_under_attack(vehicles: MakeVehicles, hop_file: Path, tmp_path: Path) -> None:
    world, port = vehicles()
    with Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        ground.until("flying")
        with lies(world, port):
            ground.until("flying")
            ground.signal(signal.SIGKILL)
            ground.ended()
    done = attach(tmp_path, "--land")
    assert done.code == 0, done.output
    assert all_down(world)


@pytest.mark.long
def test_it_lands_after_a_stop_and_a_kill(vehicles: MakeVehicles, hop_file: Path, tmp_path: Path) -> None:
    world, port = vehicles()
    with Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        ground.until("flying")
        ground.freeze(2.0)
        ground.signal(signal.SIGKILL)
        ground.ended()
    done = attach(tmp_path, "--land")
    assert done.code == 0, done.output
    assert all_down(world)


@pytest.mark.long
def test_a_flight_without_its_state_lands_by_its_links(vehicles: MakeVehicles, hop_file: Path, tmp_path: Path) -> None:
    world, port = vehicles()
    killed(world, port, hop_file, tmp_path)
    (folder,) = tmp_path.iterdir()
    state = folder / NAME
    state.write_text(state.read_text()[:200])
    refused = attach(tmp_path, folder, "--land")
    assert refused.code == FILE, refused.output
    assert "--link" in refused.output
    done = attach(tmp_path, folder, "--land", "--link", f"udpin:127.0.0.1:{port}")
    assert done.code == 0, done.output
    assert all_down(world)


@pytest.mark.long
def test_two_ground_stations_do_not_fly_one_flight(vehicles: MakeVehicles, hop_file: Path, tmp_path: Path) -> None:
    world, port = vehicles()
    with Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        ground.until("flying")
        second = attach(tmp_path, "--land")
        assert second.code == USAGE, second.output
        assert f"still flown by process {ground.process.pid}" in second.output
        assert ground.ended().code == 0
    assert all_down(world)


STATE = {
    "format": "skein-flight-1",
    "mission": "hop",
    "plan_hash": "",
    "links": ["udpin:127.0.0.1:1"],
    "systems": {},
    "mode": "stream",
    "follow": False,
    "step": "flying",
    "t0_unix_s": 1.0,
    "pid": 1 << 22,
}


def flight(root: Path, name: str, text: str) -> Path:
    folder = root / name
    folder.mkdir()
    (folder / NAME).write_text(text)
    return folder


def test_a_second_attach_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = flight(tmp_path, "now", json.dumps(STATE))
    with held_folder(folder):
        assert run(["attach", "--to", str(tmp_path), "--land"]) == USAGE
    assert "still flown by process" in capsys.readouterr().err


def test_the_nearest_instant_needs_no_vehicle_that_is_not_heard(hop: Plan) -> None:
    places = hop.states(np.array([10.0]))[:, 0, :3]
    places[1] = np.nan
    where = where_in_plan(hop, places)
    assert abs(where.t_s - 10.0) < 0.2 and where.off_m < 0.1
