"""A ground station changes nothing on vehicles that it did not arm, be it refused, stopped or not confirmed.

The vehicles have several links. One carries a flight, which must go on undisturbed.
"""

from __future__ import annotations

import json
import signal
import struct
from collections import Counter
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest

from gcs.cli.main import run
from gcs.link.wire.codec import Codec
from gcs.mavlink import MavCommand, MissionType
from gcs.plan.plan_file import save_plan
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.scenario import Scenario
from sim_bridge.protocol.endpoint_address import call
from sim_bridge.sim.world import World
from tests.air import mission_of
from tests.bridge.flying import say
from tests.fleets import free_port, wait_until
from tests.hostile.conftest import SPEEDUP, MakeStill, MakeVehicles, all_down
from tests.hostile.ground import PATIENCE_S, Ground, fly_arguments

GROUND_STATION = 255
READS = {"MISSION_REQUEST_LIST", "MISSION_REQUEST_INT", "MISSION_ACK"}  # of what was on board before
CHANGES_NOTHING = READS | {
    "HEARTBEAT",
    "PING",
    "TIMESYNC",
    "PARAM_REQUEST_READ",
    "PARAM_REQUEST_LIST",
    f"COMMAND_LONG {MavCommand.SET_MESSAGE_INTERVAL}",
    f"COMMAND_LONG {MavCommand.REQUEST_MESSAGE}",
}
GUIDED = 4
WAIVED = [f"--waive={name}" for name in ("disarmed", "pad", "height", "home", "local frame", "messages", "sensors")]


def sent(flights: Path) -> Counter[str]:
    """What the ground station of the only flight in a folder sent, commands with their number."""
    (log,) = flights.glob("*/telemetry.tlog")
    data, codec, found = log.read_bytes(), Codec(1, 1), Counter[str]()
    at = 0
    while at < len(data):
        at += struct.calcsize(">Q")
        length = 12 + data[at + 1] + (13 if data[at + 2] & 1 else 0)
        for message in codec.decode(data[at : at + length], None):
            if message.sysid == GROUND_STATION:
                found[f"{message.name} {message.fields.get('command', '')}".strip()] += 1
        at += length
    return found


@pytest.fixture(scope="module")
def waiting_file(hop: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan that hovers for long before it flies: three programs start meanwhile, on a busy machine too."""
    data = hop.scenario.model_dump(mode="json")
    data["ground_phases"]["hover_s"] = 150.0
    plan = make_plan(Scenario.model_validate(data))
    path = tmp_path_factory.mktemp("waiting") / "waiting.skein"
    save_plan(plan, verify(plan), path)
    return path


@pytest.mark.parametrize(
    "to_its_end", [pytest.param(False, marks=pytest.mark.slow), pytest.param(True, marks=pytest.mark.long)]
)
def test_further_flights_of_vehicles_that_fly_leave_them_alone(
    vehicles: MakeVehicles, waiting_file: Path, tmp_path: Path, *, to_its_end: bool
) -> None:
    """Each has a link of its own: one is refused at pre-flight, one waives all checks that fail, one is stopped.

    Meanwhile the flight goes on in real time; then it is flown to its end ten times as fast, or stopped to save time.
    """
    own, *others = (free_port() for _ in range(4))
    world, _ = vehicles(links=tuple(call(port) for port in (own, *others)), speedup=1.0)
    with Ground(*fly_arguments(waiting_file, own, tmp_path / "own")) as ground:
        wait_until(lambda: all(vehicle.autopilot.armed for vehicle in world.vehicles), PATIENCE_S)
        with ExitStack() as stack:
            refused, waived, stopped = (
                stack.enter_context(Ground(*fly_arguments(waiting_file, port, tmp_path / str(port), *more)))
                for port, more in zip(others, ((), WAIVED, ()), strict=True)
            )
            stopped.until("waiting for readiness")
            stopped.signal(signal.SIGINT)
            ended = [one.ended() for one in (refused, waived, stopped)]
        assert ground.running, ground.output
        modes = [vehicle.autopilot.mode.number for vehicle in world.vehicles]
        armed = [vehicle.autopilot.armed for vehicle in world.vehicles]
        if not to_its_end:
            ground.signal(signal.SIGINT)
            wait_until(lambda: all(one.autopilot.mode.number != GUIDED for one in world.vehicles), PATIENCE_S)
        world.options = replace(world.options, speedup=SPEEDUP)
        done = ground.ended()
    assert modes == [GUIDED] * 3
    assert all(armed)
    assert [one.code for one in ended[:2]] == [9, 9], ended
    assert ended[2].code in (128 + signal.SIGINT, 9), ended[2]  # it may have been refused before
    assert "disarmed: armed (required: disarmed)" in ended[0].output
    assert "armed, and not by this flight" in ended[1].output
    for port in others:
        assert not sent(tmp_path / str(port)).keys() - CHANGES_NOTHING
    assert sent(tmp_path / "own")["COMMAND_LONG 400"] >= 3  # the log has what is sent
    assert done.code == (0 if to_its_end else 128 + signal.SIGINT), done.output
    assert all_down(world)


def test_a_flight_that_is_not_confirmed_reads_what_is_on_board_and_changes_nothing(
    still: MakeStill,
    hop_file: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    fleet, port = still()
    stored = fleet._world.vehicles[0].store
    stored._items[MissionType.MISSION] = mission_of(12, seed=1)  # home is the first
    arguments = [str(one) for one in fly_arguments(hop_file, port, tmp_path) if one != "--yes-arm"]
    with Path("/dev/null").open() as nobody:
        monkeypatch.setattr("sys.stdin", nobody)
        code = run(arguments)
    said = "".join(capsys.readouterr())
    assert code == 2, said
    assert "not armed" in said
    assert "vehicle 1: mission of 11 items" in said
    assert stored.items()[1:] == mission_of(12, seed=1)[1:]
    messages = sent(tmp_path).keys()
    assert messages >= READS
    assert not messages - CHANGES_NOTHING
    assert not any(vehicle.autopilot.armed for vehicle in fleet._world.vehicles)


@pytest.mark.slow
def test_a_vehicle_that_a_pilot_flies_is_left_to_the_pilot(
    vehicles: MakeVehicles, hop_file: Path, tmp_path: Path
) -> None:
    """A refused flight is no flight that `gcs attach` would find, and attach that only shows takes nothing up."""
    world, port = vehicles()
    wait_until(lambda: world.t_s > 10.0)  # it may be armed from then on
    for command, *params in ((MavCommand.DO_SET_MODE, 1, GUIDED), (MavCommand.COMPONENT_ARM_DISARM, 1, 0)):
        order(world, 2, command, *params)
        wait_until(lambda: world.vehicles[1].autopilot.mode.number == GUIDED)
    wait_until(lambda: world.vehicles[1].autopilot.armed)
    order(world, 2, MavCommand.NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10)
    wait_until(lambda: world.airframes.truth[1, 2] < -8.0)
    with Ground(*fly_arguments(hop_file, port, tmp_path)) as ground:
        done = ground.ended()
    assert done.code == 9, done.output
    assert "vehicle 2: disarmed: armed" in done.output
    assert not sent(tmp_path).keys() - CHANGES_NOTHING
    with Ground("attach", "--to", tmp_path, "--land") as ground:
        nothing = ground.ended()
    assert nothing.code == 2, nothing.output
    assert "no unfinished flight" in nothing.output
    (folder,) = tmp_path.iterdir()
    with Ground("attach", folder, "--json") as ground:
        shown = ground.ended()
    assert shown.code == 0, shown.output
    assert [vehicle["armed"] for vehicle in json.loads(shown.output)["vehicles"]] == [False, True, False]
    assert world.vehicles[1].autopilot.mode.number == GUIDED
    assert world.airframes.truth[1, 2] < -8.0


def order(world: World, sysid: int, command: MavCommand, *params: float) -> None:
    """Have a pilot order something of a vehicle."""
    values = {f"param{n}": float(value) for n, value in enumerate((*params, *[0.0] * 7)[:7], start=1)}
    say(world, sysid, "COMMAND_LONG", command=int(command), confirmation=0, **values)
