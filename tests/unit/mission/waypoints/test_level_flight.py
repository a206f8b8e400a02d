"""A level line that was drawn is level where it leaves: above home, above the sea, and as setpoints, at 5 and 20 km.

Autopilots count heights from the level surface of home. The plane that touches it there is 1.96 m above it at 5 km, and
31 m at 20 km.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pymap3d.vincenty import vdist
from scipy.interpolate import PPoly

from gcs.autopilots.traits import Autopilot
from gcs.frames import Origin, geodetic_to_ned, ned_to_geodetic
from gcs.mission.drawings.route_formats import drawing_in
from gcs.mission.drawings.to_scenario.route_flight import route_flight
from gcs.mission.export.setpoint_stream import build_stream
from gcs.mission.flight_limits import surroundings_of
from gcs.mission.formats import qgc_wpl
from gcs.mission.formats.mission_file import MissionFile
from gcs.mission.formats.qgc_plan import read_mission, write_mission
from gcs.mission.model import Altitude, Command
from gcs.mission.predicted.planned_flight import fly
from gcs.mission.returns.fence_rally import build_safety
from gcs.mission.waypoints.mission_items import build_missions
from gcs.mission.waypoints.placement import Deviation
from gcs.mission.waypoints.timed_legs import TimedLegs
from gcs.plan.formation.shape import rigid
from gcs.plan.trajectory.phases import phases_of
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.trajectory import Trajectory
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.sources.template import scenario_text
from gcs.scenario.values.si import local_origin, offsets_ned_m
from tests.unit.mission.waypoints.small_flights import STEP

LAT_DEG, LON_DEG, SEA_M, UP_M = 46.1, 9.2, 500.0, 20.0
NEAR_M = 0.01


def drawn_plan(folder: Path, away_m: float, course_deg: float) -> Plan:
    """The straight flight along a line drawn at `UP_M` above home, from rest to rest, as it is written down."""
    course_rad = np.radians(course_deg)
    there_m = away_m * np.array([np.cos(course_rad), np.sin(course_rad), 0.0])
    end_lat, end_lon, _ = ned_to_geodetic(there_m, Origin(LAT_DEG, LON_DEG, SEA_M))
    places = ((0, LAT_DEG, LON_DEG, SEA_M), (3, LAT_DEG, LON_DEG, UP_M), (3, end_lat, end_lon, UP_M))
    rows = [f"{n} 0 {frame} 16 0 0 0 0 {lat:.7f} {lon:.7f} {up} 1" for n, (frame, lat, lon, up) in enumerate(places)]
    text = "\n".join(["QGC WPL 110", *(row.replace(" ", "\t") for row in rows)])
    flight = route_flight(drawing_in(text.encode(), "line.waypoints"))
    folder.mkdir(exist_ok=True)
    file = folder / "scenario.toml"
    text = scenario_text(folder, Origin(LAT_DEG, LON_DEG, SEA_M), flight=flight, template="template_route.toml")
    file.write_text(text, encoding="utf-8")
    scenario = load_scenario(file)
    begin, end_m = (np.array(end.position_m) * [1, 1, -1] for end in (scenario.start, scenario.end))
    assert begin[2] == end_m[2] == -UP_M  # what was drawn, to the last bit
    assert np.hypot(*(end_m - begin)[:2]) == pytest.approx(away_m, abs=NEAR_M)
    phases, flight_s = phases_of(scenario), scenario.time.flight_s
    joints = np.array([phases[0].start_s, 0.0, flight_s, phases[-1].end_s])
    state = np.zeros((6, 3, 12))
    state[5, :, :3] = begin, begin, end_m
    powers = np.arange(5.0, -1.0, -1.0)
    state[:, 1, :3] += (STEP / flight_s**powers)[:, None] * (end_m - begin)
    state[1:, 1, 3:6] = (state[:, 1, :3] * powers[:, None])[:-1]
    motion = Trajectory(PPoly(state, joints), PPoly(np.zeros((1, 3, 4)), joints))
    return Plan(scenario, motion, rigid(offsets_ned_m(scenario), joints[0], joints[-1]), phases, 0.0)


@pytest.fixture(params=[(5_000.0, 0.0), (20_000.0, 0.0), (20_000.0, 130.0)], ids=["5 km", "20 km", "20 km south-east"])
def plan(request: pytest.FixtureRequest, tmp_path: Path) -> Plan:
    return drawn_plan(tmp_path / "line", *request.param)


@pytest.mark.parametrize("firmware", Autopilot)
def test_items_are_at_the_drawn_height(plan: Plan, firmware: Autopilot) -> None:
    legs = TimedLegs(np.linspace(0.0, plan.flight_s, 9), Deviation(0.0, 0.0))
    for altitude, ground_m in ((Altitude.RELATIVE, 0.0), (Altitude.AMSL, SEA_M)):
        leader = build_missions(plan, legs, firmware=firmware, altitude=altitude)[plan.leader]
        file = MissionFile("x.plan", firmware, leader.home, leader.items)
        read = read_mission(write_mission(file), "x.plan")
        table = qgc_wpl.read_mission(qgc_wpl.write_mission(file).encode(), "x.waypoints", firmware)
        assert [item.alt_m for item in table.items] == [item.alt_m for item in read.items]
        assert read.home is not None
        assert read.home.alt_amsl_m == pytest.approx(SEA_M, abs=NEAR_M)
        *flown, landing = [item for item in read.items if item.lat_degE7]
        assert len(flown) == 9
        assert [item.alt_m for item in flown] == pytest.approx([ground_m + UP_M] * len(flown), abs=NEAR_M)
        assert (landing.command, landing.alt_m) == (Command.NAV_LAND, pytest.approx(ground_m, abs=NEAR_M))
        # And read again, as the check and the emulated vehicles do
        predicted = fly(read, surroundings_of(plan.scenario))
        crossing = (predicted.item > 0) & (predicted.item < len(read.items) - 1)
        heights_m = -predicted.ned_m[crossing, 2]
        assert heights_m == pytest.approx(np.full(len(heights_m), UP_M), abs=NEAR_M)


def test_setpoints_are_level_above_the_sea(plan: Plan) -> None:
    stream = build_stream(plan, 0.02)
    crossing = (stream.t_s >= 0.0) & (stream.t_s <= plan.flight_s)
    places_m = stream.position_ned_m[plan.leader, crossing]
    *_, alt_amsl_m = ned_to_geodetic(places_m, local_origin(plan.scenario))
    assert alt_amsl_m == pytest.approx(np.full(crossing.sum(), SEA_M + UP_M), abs=NEAR_M)
    pad_m = plan.pads_ned_m[plan.leader]
    assert pad_m[2] - places_m[:, 2] == pytest.approx(np.full(crossing.sum(), UP_M), abs=NEAR_M)  # as they are sent


@pytest.mark.slow
def test_returns_and_fence_are_where_they_count_from_home(plan: Plan) -> None:
    """Rally points above home, and a fence whose corners are beside the flight, seen from its ends."""
    safety = build_safety(plan, (Autopilot.ARDUPILOT,) * len(plan.sysids))
    origin = local_origin(plan.scenario)
    places_m = np.concatenate([plan.pads_ned_m, plan.landing_points_ned_m])[:, :2]
    for (rally,), alt_m in zip(safety.rally, safety.returns.altitudes_m, strict=True):
        north, east, down = geodetic_to_ned(*rally.place.place_deg, SEA_M + rally.alt_m, origin)
        assert np.hypot(*(places_m - [north, east]).T).min() < 2.0 * NEAR_M  # degE7 has its own centimetre
        assert -down == pytest.approx(rally.alt_m, abs=NEAR_M)
        assert rally.alt_m == pytest.approx(alt_m, abs=NEAR_M)
    (polygon,) = (one for one in safety.fence.geofence.polygons if one.inclusion)
    corners = np.array([point.place_deg for point in polygon.points])
    for lat, lon in (ned_to_geodetic(np.append(place, 0.0), origin)[:2] for place in places_m):
        away_m, _ = vdist(lat, lon, corners[:, 0], corners[:, 1])
        ne_m = geodetic_to_ned(corners[:, 0], corners[:, 1], SEA_M, origin)[:, :2]
        near = away_m < 1000.0  # at 20 km from home, metres of the frame are metres on Earth
        here_m = geodetic_to_ned(lat, lon, SEA_M, origin)[:2]
        assert np.hypot(*(ne_m - here_m).T)[near] == pytest.approx(away_m[near], rel=2e-4)


def test_pads_of_level_ground_are_level(plan: Plan) -> None:
    ends_m = np.stack([plan.pads_ned_m[plan.leader], plan.landing_points_ned_m[plan.leader]])
    *_, alt_amsl_m = ned_to_geodetic(ends_m, local_origin(plan.scenario))
    assert alt_amsl_m == pytest.approx(np.full(2, SEA_M), abs=NEAR_M)
