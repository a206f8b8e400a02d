"""Two missions worked by hand: what their `.waypoints` and `.plan` files have to say, number by number.

Vehicle 1 is taken 5 m up, goes 20 m south in 10 s, stands for 20 s, goes 20 m north in 5 s and lands. Vehicle 2 does
the same 10 m further east and 1 m lower. The origin lies at 45° north, 7° east, 100 m above the sea, over flat ground.

The radii of curvature of WGS 84 at 45° (a = 6378137 m, e² = 0.00669437999, sin² = 1/2) are

    W = sqrt(1 - e²/2) = 0.99832500
    of the meridian     a (1 - e²) / W³ = 6367381.8 m; at 105 m above the ellipsoid 6367486.8 m
    across it                     a / W = 6388838.3 m; at 104 m above the ellipsoid 6388942.3 m

20 m south is 20 / 6367486.8 rad = 1.799636e-4°, which is stored as 1800 units of 1e-7°.
10 m east is 10 / (6388942.3 cos 45°) rad = 1.268261e-4°, which is stored as 1268 units.
1800e-7° along the meridian at 105 m are 20.0040 m: 2.0004 m/s for 10 s, 4.0008 m/s for 5 s, and the same at 104 m.
The level through the origin falls below its plane by d²/2N, 7.8 micrometres at 10 m, which no file shows.

Files hold home in 1e-9 degrees and whole millimetres: 1.268261e-4° is written as 0.000126826°.
"""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import rasterio.warp
from scipy.interpolate import PPoly

from gcs.autopilots.traits import Autopilot
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.formats.registry import FORMATS
from gcs.mission.model import VehicleMission
from gcs.mission.waypoints.mission_items import build_missions
from gcs.plan.formation.shape import rigid
from gcs.plan.trajectory.phases import Phase
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.schema.scenario import Scenario
from tests.unit.plan.problems import FLAT, changed

WAYPOINT, LAND, TAKEOFF, DELAY, SPEED = 16, 21, 22, 93, 178
HOME, RELATIVE, NOWHERE = 0, 3, 2  # frames: above the sea, above home, of items without a position
NORTH, SOUTH, WEST, EAST = 45.0, 44.99982, 7.0, 7.0001268


def by_hand(lon_deg: float, alt_m: float) -> list[tuple[float, ...]]:
    """Frame, command, four parameters, latitude, longitude and altitude of each item."""
    return [
        (RELATIVE, TAKEOFF, 0, 0, 0, 90, NORTH, lon_deg, alt_m),
        (NOWHERE, SPEED, 1, 2.0004, -1, 0, 0, 0, 0),
        (RELATIVE, WAYPOINT, 0, 0, 0, 90, SOUTH, lon_deg, alt_m),
        (NOWHERE, DELAY, 20, -1, -1, -1, 0, 0, 0),
        (NOWHERE, SPEED, 1, 4.0008, -1, 0, 0, 0, 0),
        (RELATIVE, WAYPOINT, 0, 0, 0, 90, NORTH, lon_deg, alt_m),
        (RELATIVE, LAND, 0, 0, 0, 90, NORTH, lon_deg, 0),
    ]


BY_HAND = {1: by_hand(WEST, 5.0), 2: by_hand(EAST, 4.0)}


@pytest.fixture(scope="module")
def missions(simulation1: Scenario) -> dict[int, VehicleMission]:
    first = simulation1.formation.vehicle[0].model_dump()
    pair = [{**first, "sysid": 1, "position_m": [0.0, 0.0, 5.0]}, {**first, "sysid": 2, "position_m": [0.0, 10.0, 4.0]}]
    scenario = changed(
        simulation1,
        origin={"lat_deg": 45.0, "lon_deg": 7.0, "alt_amsl_m": 100.0},
        terrain=FLAT,
        time={"flight_s": 35.0},
        start={"position_m": [0.0, 0.0, 5.0], "velocity_mps": [0.0, 0.0, 0.0]},
        end={"position_m": [0.0, 0.0, 5.0]},
        formation={"leader": 1, "vehicle": pair},
    )
    joints_s = np.array([-10.0, 0.0, 10.0, 30.0, 35.0, 45.0])
    state = np.zeros((2, 5, 12))
    state[0, :, 0] = state[1, :, 3] = (0.0, -2.0, 0.0, 4.0, 0.0)
    state[1, :, 0] = (0.0, 0.0, -20.0, -20.0, 0.0)
    state[1, :, 2] = -5.0
    state[1, :, 8] = math.pi / 2.0
    motion = Trajectory(PPoly(state, joints_s), PPoly(np.zeros((1, 5, 4)), joints_s))
    phases = (Phase("takeoff", -10.0, 0.0), Phase("mission", 0.0, 35.0), Phase("landing", 35.0, 45.0))
    plan = Plan(scenario, motion, rigid(np.array([[0.0, 0.0, 0.0], [0.0, 10.0, 1.0]]), -10.0, 45.0), phases, 0.0)
    return {mission.sysid: mission for mission in build_missions(plan)}


def written(mission: VehicleMission, name: str) -> str:
    (row,) = (row for row in FORMATS if row.name == name)
    text = row.write(MissionFile("uav", Autopilot.ARDUPILOT, mission.home, mission.items, speed_mps=3.0))
    assert isinstance(text, str)
    return text


@pytest.mark.parametrize(("sysid", "home_deg"), [(1, WEST), (2, 7.000126826)])
def test_a_waypoints_file(missions: dict[int, VehicleMission], sysid: int, home_deg: float) -> None:
    header, home, *lines = written(missions[sysid], "waypoints").splitlines()
    assert header == "QGC WPL 110"
    columns = [float(column) for column in home.split("\t")]
    assert columns == pytest.approx([0, 1, HOME, WAYPOINT, 0, 0, 0, 0, NORTH, home_deg, 100.0, 1], rel=0, abs=1e-12)
    wanted = [[seq, 0, *values, 1] for seq, values in enumerate(BY_HAND[sysid], start=1)]
    assert [[float(column) for column in line.split("\t")] for line in lines] == wanted


@pytest.mark.parametrize("sysid", [1, 2])
def test_a_plan_file(missions: dict[int, VehicleMission], sysid: int) -> None:
    document = json.loads(written(missions[sysid], "plan"))
    assert (document["fileType"], document["version"], document["mission"]["version"]) == ("Plan", 1, 2)
    mission = document["mission"]
    assert (mission["firmwareType"], mission["vehicleType"]) == (3, 2)  # ArduPilot, a quadrotor
    *home_deg, home_m = mission["plannedHomePosition"]
    assert home_deg == pytest.approx([NORTH, BY_HAND[sysid][0][7]], rel=0, abs=1e-7)
    assert home_m == pytest.approx(100.0, rel=0, abs=1e-4)
    wanted = [
        {"frame": frame, "command": command, "params": list(numbers), "doJumpId": number, "autoContinue": True}
        for number, (frame, command, *numbers) in enumerate(BY_HAND[sysid], start=1)
    ]
    assert [{key: item[key] for key in wanted[0]} for item in mission["items"]] == wanted
    for item in mission["items"]:
        if item["frame"] == RELATIVE:
            assert (item["Altitude"], item["AltitudeMode"]) == (item["params"][6], 1)


def test_the_places_are_those_of_another_library() -> None:
    """PROJ, by an azimuthal projection about the origin: neither the closed form above nor the exporter's library."""
    plane = {"proj": "aeqd", "lat_0": 45.0, "lon_0": 7.0, "ellps": "WGS84"}
    lon_deg, lat_deg = rasterio.warp.transform(plane, "EPSG:4326", [0.0, 10.0], [-20.0, 0.0])
    assert (round(lat_deg[0], 7), round(lon_deg[1], 7)) == (SOUTH, EAST)
