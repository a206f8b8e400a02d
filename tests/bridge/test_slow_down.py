"""A slower leg with about as much room as its slow-down takes: a vehicle obeys at once or late, as its fault says."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.autopilots.waypoint_models.navigator import NavigatorOrders
from gcs.autopilots.waypoint_models.predict import predict
from gcs.frames import ned_to_geodetic, to_degE7
from gcs.mavlink import CopterMode, MavResult
from gcs.mission.model import Command, Frame, MissionItem
from gcs.types import Array
from sim_bridge.faults.fault_spec import parse_faults
from sim_bridge.fleet import plain_scenario
from sim_bridge.protocol.endpoint_address import EndpointKind, EndpointSpec
from sim_bridge.sim.world import World, WorldOptions
from tests.fleets import EPOCH_UNIX_S

HEIGHT_M, CRUISE_MPS, SLOW_MPS, BEFORE_M = 10.0, 3.0, 1.0, 40.0
LONGEST_S = 200.0


def orders(slow_m: float) -> NavigatorOrders:
    """North: fast, slowly for `slow_m`, fast again."""
    north_m = np.array([0.0, BEFORE_M, BEFORE_M + slow_m, 2.0 * BEFORE_M + slow_m])
    points = np.stack([north_m, np.zeros(4), np.full(4, -HEIGHT_M)], axis=1)
    return NavigatorOrders.through(points, (CRUISE_MPS, SLOW_MPS, CRUISE_MPS))


def predicted_s(world: World, slow_m: float) -> list[float]:
    """How long the slow leg takes, at both ends of what the autopilot may do."""
    navigator = world.vehicles[0].autopilot.path_generator.navigator
    assert navigator is not None
    ends = [predict(each, orders(slow_m)).completed_s for each in navigator.reactions]
    return [float(end[1] - end[0]) for end in ends]


def mission(world: World, pad_ned_m: Array, slow_m: float) -> tuple[MissionItem, ...]:
    origin, flown = world.vehicles[0].autopilot.path_generator.origin, orders(slow_m)

    def place(command: Command, north_m: float) -> MissionItem:
        lat, lon, _ = ned_to_geodetic(pad_ned_m + np.array([north_m, 0.0, 0.0]), origin)
        return MissionItem(
            command, Frame.GLOBAL_RELATIVE_ALT, (0.0,) * 4, to_degE7(float(lat)), to_degE7(float(lon)), HEIGHT_M
        )

    items = [place(Command.NAV_WAYPOINT, 0.0), place(Command.NAV_TAKEOFF, 0.0)]
    for (north_m, _, _), mps in zip(flown.waypoints_ned_m, flown.speeds_mps, strict=True):
        items.append(MissionItem(Command.DO_CHANGE_SPEED, Frame.MISSION, (1.0, mps, -1.0, 0.0), 0, 0, 0.0))
        items.append(place(Command.NAV_WAYPOINT, north_m))
    return tuple(items)


@pytest.mark.slow
def test_vehicles_obey_a_slower_leg_at_once_or_late() -> None:
    # By this seed they would do the opposite.
    faults = parse_faults(["1:slow-down=at-once", "2:slow-down=late"], (1, 2))
    options = WorldOptions(links=[EndpointSpec(EndpointKind.UDP_IN)], seed=0, epoch_unix_s=EPOCH_UNIX_S, faults=faults)
    with World(plain_scenario(2), options) as world:
        while not all(vehicle.autopilot.readiness.ready for vehicle in world.vehicles):
            world.step()
        open_m = [length for length in np.arange(14.0, 40.0, 0.5) if np.ptp(predicted_s(world, length)) > 2.0]
        pads = world.airframes.truth[:, :3].copy()
        for row, vehicle in enumerate(world.vehicles):
            pilot, estimate = vehicle.autopilot, world.airframes.estimate[row]
            pilot.progress.hold(mission(world, pads[row], open_m[0]))
            assert pilot.set_mode(world.t_s, CopterMode.GUIDED) == MavResult.ACCEPTED
            assert pilot.arm(world.t_s, estimate) == MavResult.ACCEPTED
            assert pilot.start_mission(world.t_s, estimate) == MavResult.ACCEPTED
        passed_s: list[list[float]] = [[], []]
        while min(map(len, passed_s)) < 2:
            world.step()
            assert world.t_s < LONGEST_S
            north_m = world.airframes.truth[:, 0] - pads[:, 0]
            for row, times in enumerate(passed_s):
                if len(times) < 2 and north_m[row] > BEFORE_M + len(times) * open_m[0]:
                    times.append(world.t_s)
        took_s = [end - begin for begin, end in passed_s]
    at_once_s, late_s = predicted_s(world, open_m[0])
    assert at_once_s > late_s + 2.0
    assert took_s == pytest.approx([at_once_s, late_s], abs=1.0)
