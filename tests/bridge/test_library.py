"""Emulated vehicles as a library: `Fleet` in a program, fixtures for pytest."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path

import numpy as np
import pytest

from gcs.errors import ScenarioError, UsageError
from gcs.link.session.linked_fleet import LinkedFleet as Ground
from gcs.mavlink import CopterMode, MavCommand, MavResult
from gcs.scenario.validation.cross_table import check
from sim_bridge import Fleet, NotInTime
from sim_bridge.fleet import SPACING_M, plain_scenario, scenario_for
from sim_bridge.testing import make_fleet
from tests.bridge.test_links import serial_station, udp_station
from tests.fleets import free_port

__all__ = ["make_fleet"]  # that of users, not the one of this folder


def test_a_fleet_flies_in_a_thread_and_tells_the_truth(repo_root: Path) -> None:
    async def fly() -> None:
        async with Fleet(repo_root / "missions" / "field", vehicles=2, speedup=math.inf, seed=3) as fleet:
            assert fleet.sysids == (1, 2)
            pad = fleet.state(2).position_ned_m
            with udp_station(fleet.address(2)[1]) as station:
                await fleet.until(lambda: fleet.t_s > 6.0)
                assert station.command(2, MavCommand.DO_SET_MODE, 1, CopterMode.GUIDED) == MavResult.ACCEPTED
                assert station.command(2, MavCommand.COMPONENT_ARM_DISARM, 1) == MavResult.ACCEPTED
                assert fleet.state(2).armed
                assert station.command(2, MavCommand.NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 4) == MavResult.ACCEPTED
                await fleet.until(lambda: pad[2] - fleet.state(2).position_ned_m[2] > 3.5)
            states = fleet.states()
            assert states[2].flying
            assert states[2].mode == "GUIDED"
            assert states[1].landed
            assert not states[1].armed
            assert states[1].t_s == states[2].t_s
            fleet.fault("2:die@start:0")
            await fleet.until(lambda: fleet.state(2).landed)
            assert not fleet.state(2).armed

    asyncio.run(fly())


@pytest.mark.parametrize("fleet", [{"vehicles": 3, "one_port": True, "autopilot": "px4"}], indirect=True)
def test_the_fixture_takes_arguments(fleet: Fleet) -> None:
    assert fleet.sysids == (1, 2, 3)
    assert len({fleet.address(sysid) for sysid in fleet.sysids}) == 1
    with udp_station(fleet.address(1)[1]) as station:
        for sysid in fleet.sysids:
            assert station.hear("HEARTBEAT", sysid).fields["autopilot"] == 12


def test_fleets_call_a_ground_station_where_it_listens(make_fleet) -> None:
    port = free_port()
    fleet = make_fleet(vehicles=2, links=[f"udpout:127.0.0.1:{port}", "pty"])

    async def listen() -> None:
        async with Ground(f"udpin:127.0.0.1:{port}").open() as ground:
            await ground.vehicles([1, 2], 10.0)

    asyncio.run(listen())
    with serial_station(str(fleet.path(2, link=1))) as station:
        station.hear("HEARTBEAT", 2)
    with pytest.raises(UsageError, match="has no port"):
        fleet.address(1, link=1)


def test_what_does_not_come_about_is_not_waited_for_longer_than_asked(make_fleet) -> None:
    fleet = make_fleet(vehicles=1, speedup=math.inf)
    with pytest.raises(NotInTime, match="5 s"):
        fleet.wait_until(lambda: fleet.state(1).flying, patience_s=5.0)
    with pytest.raises(UsageError, match="vehicle 2 is not in this fleet, which has 1"):
        fleet.state(2)
    with pytest.raises(UsageError, match="is unknown"):
        fleet.fault("1:headache")


def test_an_error_in_the_thread_is_the_callers(make_fleet) -> None:
    with pytest.raises(ZeroDivisionError), Fleet(vehicles=1) as fleet:
        fleet._world.call(lambda: 1 / 0)
        fleet.wait_until(lambda: False)


@pytest.mark.parametrize("vehicles", [1, 4, 6, 50, 254])
def test_scenarios_with_another_number_of_vehicles(repo_root: Path, vehicles: int) -> None:
    for scenario in (scenario_for(repo_root / "missions" / "field", vehicles), plain_scenario(vehicles)):
        assert len(scenario.formation.sysids) == vehicles
    assert check(plain_scenario(vehicles)) == []


def test_the_plain_scenario_is_as_it_says() -> None:
    from gcs.scenario.values.si import pads_ned_m

    pads = pads_ned_m(plain_scenario(9))
    apart = np.linalg.norm(pads[:, None] - pads[None], axis=-1) + 1e3 * np.eye(9)
    assert apart.min() == pytest.approx(SPACING_M)
    assert np.allclose(pads[:, 2], 0.0)


def test_what_cannot_be_is_said() -> None:
    with pytest.raises(UsageError, match="254"):
        Fleet(vehicles=255)
    with pytest.raises(UsageError, match="needs at least 1 vehicle, not 0"):
        Fleet(vehicles=0)
    with pytest.raises(ScenarioError, match="nowhere"):
        Fleet("missions/nowhere")
    with pytest.raises(UsageError, match="let other machines command"):
        Fleet(links=["tcpin:0.0.0.0:1"])
