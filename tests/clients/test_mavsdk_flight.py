"""MAVSDK 4 does with either autopilot what its users do: parameters, fence, mission, offboard, landing."""

from __future__ import annotations

import mavsdk
import pytest
from mavsdk.plugins.action import Action
from mavsdk.plugins.failure import Failure, FailureType, FailureUnit
from mavsdk.plugins.geofence import Circle, FenceType, Geofence, GeofenceData, Point, Polygon
from mavsdk.plugins.mission_raw import MissionRaw
from mavsdk.plugins.offboard import Offboard, PositionNedYaw, VelocityNedYaw
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import FlightMode, LandedState, Telemetry

from gcs.autopilots.traits import Autopilot
from gcs.link.protocols.mission.item_messages import with_home
from gcs.link.protocols.mission.read_back import compare_missions
from gcs.mission.model import Home, MissionItem
from sim_bridge import Fleet
from sim_bridge.fleet import plain_scenario
from tests.clients.sdk import client, from_raw, to_raw, wait
from tests.fleets import free_port

VEHICLES = 6
HOME = Home(**plain_scenario(1).origin.model_dump())
MAKE = {"ardupilot": mavsdk.Autopilot.ARDUPILOT, "px4": mavsdk.Autopilot.PX4}
PARAMS = {  # a float, an int, and values for them
    "ardupilot": (("WPNAV_SPEED", 420.0), ("RTL_ALT", 1800)),
    "px4": (("MPC_XY_CRUISE", 4.5), ("COM_OBL_RC_ACT", 1)),
}
autopilots = pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])


def items(sysid: int) -> tuple[MissionItem, ...]:
    """Take-off, two legs at a speed of their own, landing; different for every vehicle."""
    lat, lon = round(HOME.lat_deg * 1e7), round(HOME.lon_deg * 1e7) + 500 * sysid
    return (
        MissionItem(22, 3, (0.0,) * 4, lat, lon, 4.0),
        MissionItem(16, 3, (0.0,) * 4, lat + 1500, lon, 5.0 + 0.25 * sysid),
        MissionItem(178, 2, (1.0, 2.0 + 0.25 * sysid, -1.0, 0.0), 0, 0, 0.0),
        MissionItem(16, 3, (1.0, 0.0, 0.0, 0.0), lat + 1500, lon + 1500, 6.0),
        MissionItem(21, 3, (0.0,) * 4, lat, lon, 0.0),
    )


def fence(sysid: int) -> GeofenceData:
    lat, lon, d = HOME.lat_deg, HOME.lon_deg + 1e-5 * sysid, 0.005
    corners = [Point(lat + n * d, lon + e * d) for n, e in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    hole = Circle(Point(lat + 0.003, lon), 20.0 + sysid, FenceType.EXCLUSION)
    return GeofenceData([Polygon(corners, FenceType.INCLUSION)], [hole])


def fence_numbers(data: GeofenceData) -> list[float]:
    found: list[float] = []
    for polygon in data.polygons:
        found += [int(polygon.fence_type), *(v for p in polygon.points for v in (p.latitude_deg, p.longitude_deg))]
    for circle in data.circles:
        found += [int(circle.fence_type), circle.point.latitude_deg, circle.point.longitude_deg, circle.radius]
    return found


@autopilots
@pytest.mark.parametrize("calls", ["vehicles call", "the client calls"])
def test_six_systems_on_one_port(autopilot: str, calls: str) -> None:
    port = free_port()
    link = f"udpout:127.0.0.1:{port}" if calls == "vehicles call" else "udpin:0"
    with Fleet(vehicles=VEHICLES, autopilot=autopilot, links=[link], one_port=True, speedup=5.0) as fleet:
        url = f"udpin://127.0.0.1:{port}" if calls == "vehicles call" else "udpout://{}:{}".format(*fleet.address(1))
        with client(url, VEHICLES) as systems:
            assert set(systems) == set(fleet.sysids)
            assert {system.autopilot_type() for system in systems.values()} == {MAKE[autopilot]}


@autopilots
def test_parameters_missions_and_fences_of_all_six(autopilot: str) -> None:
    port = free_port()
    with (
        Fleet(vehicles=VEHICLES, autopilot=autopilot, links=[f"udpout:127.0.0.1:{port}"], speedup=5.0),
        client(f"udpin://127.0.0.1:{port}", VEHICLES) as systems,
    ):
        (float_name, float_value), (int_name, int_value) = PARAMS[autopilot]
        for sysid, system in systems.items():
            params = Param(system)
            params.set_param_float(float_name, float_value + sysid)
            params.set_param_int(int_name, int_value)
            assert params.get_param_float(float_name) == float_value + sysid
            assert params.get_param_int(int_name) == int_value
            listed = params.get_all_params()
            assert float_name in {p.name for p in listed.float_params}
            assert int_name in {p.name for p in listed.int_params}

            missions, home_first = MissionRaw(system), autopilot == "ardupilot"
            sent = with_home(items(sysid), HOME) if home_first else items(sysid)
            missions.upload_mission([to_raw(seq, item) for seq, item in enumerate(sent)])
            back = [from_raw(raw) for raw in missions.download_mission()]
            assert compare_missions(sent[home_first:], back[home_first:], autopilot=Autopilot.ARDUPILOT) == []

            fences = Geofence(system)
            fences.upload_geofence(fence(sysid))
            back_numbers = fence_numbers(fences.download_geofence())
            assert back_numbers == pytest.approx(fence_numbers(fence(sysid)), abs=1e-6)
            fences.clear_geofence()
            missions.clear_mission()


@pytest.mark.slow
@autopilots
def test_take_off_offboard_mission_and_landing(autopilot: str) -> None:
    port, sysid = free_port(), 1
    with (
        Fleet(vehicles=2, autopilot=autopilot, links=[f"udpout:127.0.0.1:{port}"], speedup=8.0, seed=2) as fleet,
        client(f"udpin://127.0.0.1:{port}", 2) as systems,
    ):
        system = systems[sysid]
        action, telemetry = ready(system)
        missions = MissionRaw(system)
        home_first = autopilot == "ardupilot"
        sent = with_home(items(sysid), HOME) if home_first else items(sysid)
        missions.upload_mission([to_raw(seq, item) for seq, item in enumerate(sent)])

        action.set_takeoff_altitude(4.0)
        action.arm()
        action.takeoff()
        pad = fleet.state(sysid).position_ned_m
        fleet.wait_until(lambda: pad[2] - fleet.state(sysid).position_ned_m[2] > 3.7)
        wait(telemetry.in_air, "telemetry to say so")
        if autopilot == "px4":
            wait(lambda: telemetry.flight_mode() == FlightMode.HOLD, "the take-off to end")

        offboard = Offboard(system)
        offboard.set_position_ned(PositionNedYaw(3.0, 1.0, -5.0, 0.0))
        wait(_passed(fleet, 2.0), "two seconds of stream")
        offboard.start()
        wait(lambda: telemetry.flight_mode() == FlightMode.OFFBOARD, "offboard mode")
        fleet.wait_until(lambda: abs(fleet.state(sysid).position_ned_m - pad - (3.0, 1.0, -5.0)).max() < 0.3)
        offboard.set_velocity_ned(VelocityNedYaw(0.0, 1.0, 0.0, 0.0))
        fleet.wait_until(lambda: abs(fleet.state(sysid).velocity_ned_mps[1] - 1.0) < 0.15)
        offboard.stop()
        fleet.wait_until(lambda: abs(fleet.state(sysid).velocity_ned_mps).max() < 0.15)

        seen: list[tuple[int, int]] = []
        handle = missions.subscribe_mission_progress(lambda p, *_: seen.append((p.current, p.total)))
        missions.start_mission()
        wait(lambda: not telemetry.armed(), "the end of the mission", patience_s=60.0)
        missions.unsubscribe_mission_progress(handle)
        currents = [current for current, _ in seen]
        assert {total for _, total in seen} == {len(sent)}
        first, second, land = (1 + home_first, 3 + home_first, 4 + home_first)
        assert [c for c in currents if c in (first, second, land)][:3] == [first, second, land]
        wait(lambda: telemetry.landed_state() == LandedState.ON_GROUND, "word of the ground, a stream's turn later")
        assert fleet.state(sysid).landed


@pytest.mark.parametrize("autopilot", [pytest.param("ardupilot", marks=pytest.mark.slow), "px4"])
def test_failures_by_name_and_a_landing_where_it_is(autopilot: str) -> None:
    port, sysid = free_port(), 2
    with (
        Fleet(vehicles=2, autopilot=autopilot, links=[f"udpout:127.0.0.1:{port}"], speedup=8.0) as fleet,
        client(f"udpin://127.0.0.1:{port}", 2) as systems,
    ):
        action, telemetry = ready(systems[sysid])
        action.set_takeoff_altitude(4.0)
        action.arm()
        action.takeoff()
        fleet.wait_until(lambda: fleet.state(sysid).position_ned_m[2] < -3.7)
        failures = Failure(systems[sysid])
        failures.inject(FailureUnit.SENSOR_GPS, FailureType.OFF, 0)
        wait(lambda: telemetry.gps_info().num_satellites == 0, "the receiver to lose its satellites")
        failures.inject(FailureUnit.SENSOR_GPS, FailureType.OK, 0)
        wait(lambda: telemetry.gps_info().num_satellites > 5, "the receiver to find them again")
        action.land()
        wait(lambda: not telemetry.armed(), "the landing")
        assert fleet.state(sysid).landed
        assert not fleet.state(1).armed


def ready(system: mavsdk.System) -> tuple[Action, Telemetry]:
    """The system's plugins, once it can be armed. An ArduPilot sends nothing but HEARTBEAT unasked."""
    telemetry = Telemetry(system)
    for ask in (
        telemetry.set_rate_health,
        telemetry.set_rate_position,
        telemetry.set_rate_in_air,
        telemetry.set_rate_landed_state,
        telemetry.set_rate_gps_info,
        telemetry.set_rate_position_velocity_ned,
    ):
        ask(10.0)
    wait(lambda: telemetry.health().is_armable, "the vehicle to be ready")
    return Action(system), telemetry


def _passed(fleet: Fleet, seconds: float):
    end_s = fleet.t_s + seconds
    return lambda: fleet.t_s > end_s
