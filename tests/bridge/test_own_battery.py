"""Vehicles that fly another battery than the scenario says: no-go on the ground, or an end in the hover before T0.

However it ends, what they had on board before is there again.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.cli.main import run as gcs
from gcs.flight.recording.flight_folder import BEFORE, EVENTS, read_events
from gcs.link.protocols.mission.read_back import compare_missions
from gcs.link.session.load_before import recorded_before
from gcs.mavlink import MissionType
from gcs.plan.trajectory.energy import energy_Wh
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from tests.air import mission_of
from tests.fleets import StillFleet, free_port, still_commands

Fly = Callable[..., tuple[int, str, StillFleet, Path]]


def with_battery(plan: Plan, share: float, effort: float = 1.0) -> Scenario:
    """The scenario of vehicles whose battery the plan takes this share of, and whose rotors draw `effort` more."""
    taken, power = energy_Wh(plan), plan.scenario.vehicle.power
    assert taken is not None
    assert power is not None
    own = {"battery_Wh": float(taken.max()) / share, "figure_of_merit": power.figure_of_merit / effort}
    vehicle = plan.scenario.vehicle.model_copy(update={"power": power.model_copy(update=own)})
    return plan.scenario.model_copy(update={"vehicle": vehicle})


def assert_old_mission(fleet: StillFleet, when: str) -> None:
    held = fleet._world.vehicles[0].store.items()[1:]
    assert compare_missions(mission_of(12, seed=1)[1:], held, autopilot=Autopilot.ARDUPILOT) == [], when


@pytest.fixture
def fly(hop: Plan, hop_skein: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Fly:
    def call(share: float, effort: float, *options: str) -> tuple[int, str, StillFleet, Path]:
        port = free_port()
        with (
            still_commands(),
            StillFleet(with_battery(hop, share, effort), links=[f"udpout:127.0.0.1:{port}"]) as fleet,
        ):
            stored = fleet._world.vehicles[0].store._items
            stored[MissionType.MISSION] = mission_of(12, seed=1)  # home is the first
            link = f"udpin:127.0.0.1:{port}"
            code = gcs(["fly", str(hop_skein), "--link", link, "--yes-arm", "--to", str(tmp_path), *options])
            said = capsys.readouterr().err
            (folder,) = tmp_path.iterdir()
            if (folder / BEFORE).exists():
                assert_old_mission(fleet, "after the flight")
                stored[MissionType.MISSION] = ()  # as if the ground station had been killed
                assert gcs(["restore", str(folder), "--link", link]) == 0
                assert_old_mission(fleet, "after `gcs restore`")
            return code, said, fleet, folder

    return call


def test_a_smaller_battery_than_the_scenarios_is_a_no_go(fly: Fly) -> None:
    code, said, fleet, _ = fly(0.8, 1.0)
    assert code == 9
    assert "no-go: vehicle 1: battery: has 100%, needs 8" in said
    assert " mAh at 14.8 V)" in said
    assert not any(vehicle.autopilot.armed for vehicle in fleet._world.vehicles)


@pytest.mark.parametrize("mode", ["stream", pytest.param("mission", marks=pytest.mark.slow)])
def test_a_hover_that_draws_twice_as_much_ends_the_flight_before_t0(fly: Fly, hop: Plan, mode: str) -> None:
    """Pre-flight says that half of the battery is enough."""
    code, said, fleet, flown = fly(0.5, 2.0, "--mode", mode)
    assert code == 9, said
    assert "the start was aborted: vehicle 1 draws " in said
    assert "25% must be left at the end" in said
    assert any("in the hover: the plan needs " in event.what for event in read_events(flown / EVENTS))
    assert fleet._world.airframes.landed.all()
    assert not any(vehicle.autopilot.armed for vehicle in fleet._world.vehicles)
    assert fleet._world.vehicles[1].store.items()[1:] == ()
    assert [len(one.items[MissionType.MISSION]) for one in recorded_before(flown / BEFORE)] == [11, 0, 0]
    off_pad_m = fleet._world.airframes.truth[:, :2] - hop.pads_ned_m[:, :2]
    assert abs(off_pad_m).max() < 1.0


@pytest.mark.slow
def test_a_battery_that_the_plan_asks_too_much_of_ends_the_flight(fly: Fly, hop: Plan) -> None:
    """124 % was asked, and the operator waived the check: at 20 % all are ordered down, and that is too late."""
    code, said, fleet, _ = fly(1.24, 1.0, "--waive", "battery")
    bodies = fleet._world.airframes
    assert code == 9, said
    assert bodies.battery.empty.any()
    assert bodies.landed.all()
    assert "battery low (20 % left" in said
