"""Benchmark of emulated vehicles: steps, filters and messages of 1, 6, 50 and 200 vehicles on one core.

./tools/run python tools/bench_bridge.py [--vehicles 1 6 50 200] [--autopilot px4] [--seconds 8] [--json FILE]

Vehicles of the `field` preset fly a mission on board, each with its filter, and send forty messages a second of flight,
each from a port of its own. Nothing waits or sleeps. Times are CPU times, so other programs do not count: `--seconds`
for each size, in a process of its own, so that none profits from warm caches of another.
"""

import math
import socket
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from gcs.frames import Origin, ned_to_geodetic
from gcs.link.protocols.mission.item_messages import with_home
from gcs.link.wire.message import GROUND, Message
from gcs.mavlink import CopterMode, MavCommand, MessageId
from gcs.mission.model import Home, MissionItem
from sim_bridge.dynamics.airframes import CONTROL_PERIOD_S
from sim_bridge.fleet import plain_scenario
from sim_bridge.personality import by_name
from sim_bridge.protocol.endpoint_address import call
from sim_bridge.sim.world import World, WorldOptions
from tools.bench.frame import apart, finish, options, serve

GOALS = {6: 40.0, 200: 1.0}  # times real time
WARM_S = 20.0  # of flight, before anything is measured
SIDE_M = 60.0
RATES_HZ = {
    MessageId.ATTITUDE: 10.0,
    MessageId.LOCAL_POSITION_NED: 10.0,
    MessageId.GLOBAL_POSITION_INT: 4.0,
    MessageId.MISSION_CURRENT: 4.0,
    MessageId.EXTENDED_SYS_STATE: 4.0,
    MessageId.SYSTEM_TIME: 2.0,
    MessageId.SYS_STATUS: 2.0,
    MessageId.GPS_RAW_INT: 2.0,
    MessageId.EKF_STATUS_REPORT: 2.0,
}


def measure(vehicles: int, autopilot: str, cpu_s: float) -> dict[str, Any]:
    """One run in this process."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground, under_way(vehicles, autopilot, ground) as world:
        messages, began_s, began = world.traffic.sent, world.t_s, time.process_time()
        while time.process_time() - began < cpu_s:
            for _ in range(10):
                world.step()
        took_s, flown_s = time.process_time() - began, world.t_s - began_s
        assert all(vehicle.autopilot.flying for vehicle in world.vehicles), "a vehicle has come down"
        return {
            "vehicles": vehicles,
            "steps_per_s": flown_s / CONTROL_PERIOD_S / took_s,
            "times_real_time": flown_s / took_s,
            "messages_per_s": (world.traffic.sent - messages) / took_s,
            "messages_per_vehicle_and_s_of_flight": (world.traffic.sent - messages) / flown_s / vehicles,
            **filter_costs(world),
        }


def under_way(vehicles: int, autopilot: str, ground: socket.socket) -> World:
    """Vehicles in the middle of a mission, all of them."""
    ground.bind(("127.0.0.1", 0))
    scenario = plain_scenario(vehicles)
    options = WorldOptions(
        links=[call(ground.getsockname()[1])], speedup=math.inf, seed=1, personality=by_name(autopilot)
    )
    world = World(scenario, options)
    while not all(vehicle.autopilot.readiness.ready for vehicle in world.vehicles):
        world.step()
    for row, vehicle in enumerate(world.vehicles):
        pilot = vehicle.autopilot
        for number, rate_hz in RATES_HZ.items():
            params = {f"param{i}": 0.0 for i in range(1, 8)} | {"param1": float(number), "param2": 1e6 / rate_hz}
            fields = {"command": int(MavCommand.SET_MESSAGE_INTERVAL), "target_system": vehicle.station.sysid}
            vehicle.receive(
                Message("COMMAND_LONG", {**fields, "target_component": 1, "confirmation": 0, **params}, *GROUND), 0.0
            )
        origin, pad = Origin(**scenario.origin.model_dump()), world.airframes.truth[row, :3]
        corners = [(SIDE_M, 0.0), (SIDE_M, SIDE_M), (0.0, SIDE_M), (0.0, 0.0)]
        items = [MissionItem(22, 3, (0.0,) * 4, *_place(pad, origin), 5.0)]
        for north, east in corners * 60:
            items.append(MissionItem(16, 3, (0.0,) * 4, *_place(pad + np.array([north, east, 0.0]), origin), 10.0))
        home = Home(*(float(v) for v in ned_to_geodetic(pad, origin)))
        pilot.progress.hold(
            with_home(tuple(items), home) if world.vehicles[row].autopilot.progress.first else tuple(items)
        )
        pilot.set_mode(world.t_s, CopterMode.GUIDED)
        pilot.arm(world.t_s, world.airframes.estimate[row])
        pilot.start_mission(world.t_s, world.airframes.estimate[row])
    end_s = world.t_s + WARM_S
    while world.t_s < end_s:
        world.step()
    return world


def filter_costs(world: World) -> dict[str, float]:
    """Microseconds of one vehicle's filter: carrying its mean on (each step), and one update with a measurement."""
    estimator, costs = world.airframes.estimator, {"propagate": [0.0, 0], "update": [0.0, 0]}

    def timed(name: str, work: Callable[..., None]) -> Callable[..., None]:
        def run(*args: Any, **kwargs: Any) -> None:
            began = time.process_time()
            work(*args, **kwargs)
            costs[name][0] += time.process_time() - began
            costs[name][1] += 1

        return run

    for name in costs:
        setattr(estimator, name, timed(name, getattr(estimator, name)))
    for _ in range(400):
        world.step()
    for name in costs:
        delattr(estimator, name)
    vehicles = len(world.vehicles)
    return {f"{name}_us": 1e6 * total / count / vehicles for name, (total, count) in costs.items()}


def _place(ned_m: np.ndarray, origin: Origin) -> tuple[int, int]:
    lat, lon, _ = ned_to_geodetic(ned_m, origin)
    return round(float(lat) * 1e7), round(float(lon) * 1e7)


def main() -> None:
    """Run, print, and write what was asked for."""
    serve(measure)
    asked = options(__doc__, vehicles=[1, 6, 50, 200], autopilot=("ardupilot", "px4"), seconds=8.0, json=None)
    rows = [apart(__file__, vehicles, asked.autopilot, asked.seconds) for vehicles in asked.vehicles]
    finish(f"emulated vehicles on a mission, {asked.autopilot}, one core", rows, asked.json)
    for vehicles, goal in GOALS.items():
        for row in (r for r in rows if r["vehicles"] == vehicles):
            met = "met" if row["times_real_time"] >= goal else "MISSED"
            print(f"{vehicles} vehicles: {row['times_real_time']:.1f} times real time, asked {goal:g}: {met}")


if __name__ == "__main__":
    main()
