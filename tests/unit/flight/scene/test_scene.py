"""Scenes of a plan, of a recorded flight and of a scenario: what stands in them is what was planned and flown."""

from __future__ import annotations

import base64
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from gcs.flight.assessment.judge import Tracks
from gcs.flight.monitoring.progress import ALL_VEHICLES, Action, Event
from gcs.flight.recording.recording import Recording, VehicleTrack
from gcs.flight.scene.plan_scene import scene_of_plan, zones_of
from gcs.flight.scene.recording_scene import scene_of_recording
from gcs.flight.scene.scene_curves import course_rad, instants_s, neighbours
from gcs.flight.scene.scene_json import scene_json
from gcs.flight.scene.scene_model import Scene, SceneKind
from gcs.mission.returns.fence_areas import inside_m
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.environment.no_fly import outline
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.schema.places import NoFlyZone
from tests.real_flights import plan_of

NAME = "px4-1.17dev-stream"
GUIDED, LAND = 4, 9


@pytest.fixture(scope="module")
def plan() -> Plan:
    return plan_of(NAME)


@pytest.fixture(scope="module")
def replay(plan: Plan) -> Scene:
    return scene_of_recording(recording_of(plan), 0.0, 79.5)


def recording_of(plan: Plan, aside_m: float = 2.0) -> Recording:
    """Every vehicle as planned, the third off to the east; the second is silent for a while, and lands at 50 s."""
    t_s = np.arange(0.0, 80.0, 0.5)
    states = plan.states(t_s)
    tracks = []
    for row, sysid in enumerate(plan.sysids):
        heard = ~((t_s > 20.0) & (t_s < 30.0)) if row == 1 else np.full(len(t_s), True)
        places = states[row, :, POSITION] + (0.0, aside_m if row == 2 else 0.0, 0.0)
        mode = np.where(t_s < 50.0, GUIDED, LAND)
        battery = np.full(len(t_s), 70 - row)
        tracks.append(
            VehicleTrack(
                sysid,
                3,
                t_s[heard],
                places[heard],
                states[row, heard, VELOCITY],
                t_s[heard] >= 0.0,
                mode[heard],
                battery[heard],
            )
        )
    events = (Event(math.nan, 40.0, 3, "is told to land", "lost"), Event(math.nan, 99.0, 3, "later"))
    return Recording("field, landed", tuple(tracks), events, (Event(math.nan, 10.0, 1, "is in LAND"),), plan)


def test_curves_of_emulated_vehicles_are_true_beside_what_they_reported(plan: Plan) -> None:
    """In truth the second vehicle flies 1 m beside the first, while both report their places in the formation."""
    t_s = np.arange(-5.0, 85.0, 0.25)
    places = plan.states(np.clip(t_s, 0.0, 80.0))[..., POSITION].copy()
    places[1] = places[0] + (0.0, 1.0, 0.0)
    whole = recording_of(plan)
    scene = scene_of_recording(replace(whole, truth=Tracks(t_s, places)), 0.0, 79.5)
    curves = {curve.name: curve for curve in scene.curves}
    apart = curves["least separation"]
    assert apart.true is not None and apart.flown is not None
    np.testing.assert_allclose(apart.true, 1.0, atol=1e-6)
    assert apart.flown.min() > 2.0 and (apart.vehicles == plan.sysids[:2]).all()
    error = curves["greatest position error"].true
    off_m = np.linalg.norm(places[1] - plan.states(np.clip(t_s, 0.0, 80.0))[1, :, POSITION], axis=1)
    assert error is not None and error[0] == pytest.approx(off_m[20], abs=0.1)
    assert curves["formation error"].true is not None and curves["greatest speed"].true is not None
    assert all(curve.true is None for curve in scene_of_recording(whole, 0.0, 79.5).curves)


def test_the_landing_begins_when_the_last_vehicle_is_ordered_down(plan: Plan) -> None:
    def ordered(t_s: float, sysid: int, action: Action) -> Event:
        return Event(math.nan, t_s, sysid, "does as told", action=action)

    def lands_s(*events: Event) -> float:
        return scene_of_recording(replace(recording_of(plan), events=events), 0.0, 79.5).lands_s

    assert lands_s() == plan.landing_s
    assert lands_s(ordered(40.0, 3, Action.LAND)) == plan.landing_s, "the others fly on"
    assert lands_s(ordered(41.0, ALL_VEHICLES, Action.LAND)) == 41.0
    all_but_one = [ordered(30.0 + row, sysid, Action.LAND) for row, sysid in enumerate(plan.sysids[:-1])]
    for away in (Action.RETURN, Action.DIVERT):
        leaves = ordered(50.0, plan.sysids[-1], away)
        assert lands_s(*all_but_one, leaves) == pytest.approx(79.5, abs=0.2), "it was never low again"


def test_a_vehicle_that_left_the_plan_or_was_lost_has_no_error_and_does_not_keep_the_flight_aloft(plan: Plan) -> None:
    """The first is told to land, the last is never heard again, and falls; its place in the plan flies on."""
    whole = recording_of(plan)
    *others, last = whole.tracks
    heard = last.t_s <= 45.0
    fields = ("t_s", "position_ned_m", "velocity_ned_mps", "armed", "mode", "battery_pct")
    lost = replace(last, **{name: getattr(last, name)[heard] for name in fields})
    t_s = np.arange(0.0, 80.0, 0.25)
    places = plan.states(t_s)[..., POSITION].copy()
    places[-1, t_s > 45.0, 2] = 0.0
    land = [Event(math.nan, 50.0, sysid, "ordered to land", "x", action=Action.LAND) for sysid in plan.sysids[:-1]]
    recording = replace(whole, tracks=(*others, lost), events=tuple(land), truth=Tracks(t_s, places))
    scene = scene_of_recording(recording, 0.0, 79.0)
    assert scene.lands_s == 50.0 and scene.reported is not None
    late, early = scene.t_s >= 50.0, scene.t_s < 45.0
    assert np.isnan(scene.reported.error_m[:, late]).all() and np.isfinite(scene.reported.error_m[0, early]).all()
    curves = {curve.name: curve for curve in scene.curves}
    for name in ("greatest position error", "formation error"):
        true = curves[name].true
        assert true is not None and np.isnan(true[late]).all() and np.isfinite(true[early]).all(), name
    back = Event(math.nan, 60.0, plan.sysids[0], "ordered to rejoin", "x", action=Action.REJOIN)
    again = scene_of_recording(replace(recording, events=(*land, back)), 0.0, 79.0).reported
    assert again is not None and np.isfinite(again.error_m[0, scene.t_s > 60.5]).all()


def test_what_is_no_incident_and_no_order_is_not_marked_as_one(plan: Plan) -> None:
    start = Event(math.nan, -10.0, ALL_VEHICLES, "start their missions at 12:00:39 UTC")
    told = Event(math.nan, 5.0, ALL_VEHICLES, "asked to hold", data={"order": "hold"})
    silent = Event(math.nan, 6.0, 2, "link lost")
    scene = scene_of_recording(replace(recording_of(plan), events=(start, told, silent), remarks=()), -20.0, 20.0)
    assert [one.is_bad for one in scene.events] == [False, True, True]


def test_a_plan_is_shown_where_it_flies(plan: Plan) -> None:
    scene = scene_of_plan(plan)
    assert scene.planned is not None and scene.flown is None and scene.kind is SceneKind.PLAN
    assert (scene.t_s[0], scene.t_s[-1]) == (plan.t_start_s, plan.t_end_s)
    inside_s = np.clip(scene.t_s, plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf))
    np.testing.assert_array_equal(scene.planned.places_ned_m, plan.states(inside_s)[..., POSITION])
    north, east, down = np.moveaxis(scene.planned.places_ned_m, -1, 0)
    above_m = -down - ground_height_m(plan.scenario.terrain, north, east)
    np.testing.assert_allclose(scene.planned.above_ground_m, above_m)
    assert [(p.name, p.begin_s, p.end_s) for p in scene.phases] == [(p.name, p.start_s, p.end_s) for p in plan.phases]
    assert (scene.sysids, scene.leader) == (plan.sysids, plan.scenario.formation.leader)


def test_the_ground_of_a_scene_is_that_of_the_scenario_and_lies_below_every_track(plan: Plan) -> None:
    scene = scene_of_plan(plan)
    ground, motion = scene.ground, scene.planned
    assert ground is not None and motion is not None
    grid = np.meshgrid(ground.north_m, ground.east_m, indexing="ij")
    np.testing.assert_allclose(ground.height_m, ground_height_m(plan.scenario.terrain, *grid))
    flat = motion.places_ned_m[..., :2]
    assert (flat.min(axis=(0, 1)) > (ground.north_m[0], ground.east_m[0])).all()
    assert (flat.max(axis=(0, 1)) < (ground.north_m[-1], ground.east_m[-1])).all()


def test_curves_of_a_plan_hold_the_values_of_its_verification(plan: Plan) -> None:
    scene = scene_of_plan(plan)
    curves = {curve.name: curve for curve in scene.curves}
    separation = curves["least separation"]
    assert separation.planned is not None and separation.limit == plan.scenario.limits.separation_min_m
    inside_s = np.clip(scene.t_s, plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf))
    np.testing.assert_allclose(separation.planned, plan.separations_m(inside_s))
    at = int(np.argmin(separation.planned))
    places = plan.states(inside_s[at : at + 1])[:, 0, POSITION]
    first, second = (plan.sysids.index(sysid) for sysid in separation.vehicles[at].tolist())
    assert np.linalg.norm(places[first] - places[second]) == pytest.approx(separation.planned[at])


def test_a_zone_is_shown_with_its_way(plan: Plan) -> None:
    corners = ((300.0, -60.0), (340.0, -60.0), (320.0, -20.0))
    moving = NoFlyZone(polygon_m=corners, moves=((0.0, 0.0, 0.0), (100.0, 60.0, -40.0)))
    scenario = plan.scenario.model_copy(update={"no_fly": (*plan.scenario.no_fly, moving)})
    *disks, last = zones_of(scenario)
    np.testing.assert_array_equal(last.t_s, [0.0, 100.0])
    np.testing.assert_array_equal(last.moved_m, [[0.0, 0.0], [60.0, -40.0]])
    assert set(map(tuple, last.corners_m.tolist())) == set(corners)
    for disk, zone in zip(disks, plan.scenario.no_fly, strict=True):
        away_m = [outline(zone).exterior.hausdorff_distance(type(outline(zone))(disk.corners_m).exterior)]
        assert max(away_m) < 0.1 and not disk.keep_in


def test_a_replay_holds_what_was_reported_and_how_far_off_it_was(plan: Plan, replay: Scene) -> None:
    flown, planned, told = replay.flown, replay.planned, replay.reported
    assert flown is not None and planned is not None and told is not None
    np.testing.assert_allclose(told.error_m[2], 2.0, atol=0.1)
    np.testing.assert_allclose(told.error_m[0], 0.0, atol=0.2)  # reports are 0.5 s apart
    at = [int(np.argmin(np.abs(replay.t_s - t_s))) for t_s in (10.0, 25.0, 60.0)]
    assert [told.words[mode] for mode in told.mode[0, at]] == ["GUIDED", "GUIDED", "LAND"]
    assert told.battery_pct[:, at[0]].tolist() == [70, 69, 68, 67, 66, 65]
    assert np.isnan(flown.places_ned_m[1, at[1]]).all(), "the silent vehicle is nowhere"
    assert told.age_s[1, at[1]] == pytest.approx(replay.t_s[at[1]] - 20.0)
    assert [(one.t_s, one.sysid, one.is_bad) for one in replay.events] == [(10.0, 1, False), (40.0, 3, True)]


def test_curves_of_a_replay_name_the_vehicles_behind_them(plan: Plan, replay: Scene) -> None:
    curves = {curve.name: curve for curve in replay.curves}
    error, separation, formation = (
        curves[name] for name in ("greatest position error", "least separation", "formation error")
    )
    assert set(error.vehicles[:, 0].tolist()) == {plan.sysids[2]}
    assert replay.flown is not None and separation.flown is not None and formation.flown is not None
    for at in (3, 120, 300):
        known = np.isfinite(replay.flown.places_ned_m[:, at, 0])
        places = replay.flown.places_ned_m[known, at]
        between = cdist(places, places) + np.diag(np.full(len(places), np.inf))
        assert separation.flown[at] == pytest.approx(between.min())
        ids = np.array(plan.sysids)[known]
        assert separation.vehicles[at].tolist() == sorted(ids[list(np.unravel_index(between.argmin(), between.shape))])
    known = np.isfinite(formation.flown)
    assert known.any() and formation.flown[known] == pytest.approx(2.0 * 5.0 / 6.0, abs=0.1)


def test_a_log_without_a_plan_has_a_scene_too(plan: Plan) -> None:
    whole = recording_of(plan)
    scene = scene_of_recording(Recording("any.tlog", whole.tracks, (), (), None), 0.0, 30.0)
    assert scene.ground is None and scene.planned is None and scene.flown is not None
    assert [curve.name for curve in scene.curves] == ["least separation", "greatest speed"]
    assert json.loads(scene_json(scene))["ground"] is None


def test_json_has_every_number_and_nothing_that_json_does_not_know(replay: Scene) -> None:
    data = json.loads(scene_json(replay))
    packed = data["flown"]["places_ned_m"]
    values = np.frombuffer(base64.b64decode(packed["f4"]), "<f4").reshape(packed["shape"])
    assert replay.flown is not None
    np.testing.assert_allclose(values, replay.flown.places_ned_m, rtol=1e-6, atol=1e-4)
    rows = np.frombuffer(base64.b64decode(data["flown"]["neighbour"]["i2"]), "<i2")
    assert rows.tolist() == replay.flown.neighbour.ravel().tolist()
    assert data["kind"] == "replay" and data["events"][0]["text"] == "is in LAND"


@given(st.integers(2, 12), st.integers(0, 2**32 - 1))
def test_each_vehicle_gets_its_nearest_neighbour(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    places = rng.integers(-3, 3, (count, 2, 3)).astype(float)  # several at one place
    places[rng.random((count, 2)) < 0.2] = np.nan
    away_m, rows = neighbours(places)
    for instant in range(2):
        known = np.flatnonzero(np.isfinite(places[:, instant, 0]))
        for row in range(count):
            others = known[known != row]
            if row not in known or not len(others):
                assert np.isnan(away_m[row, instant]) and rows[row, instant] == -1
                continue
            least_m = np.linalg.norm(places[others, instant] - places[row, instant], axis=1).min()
            assert away_m[row, instant] == pytest.approx(least_m)
            assert rows[row, instant] != row
            found = places[rows[row, instant], instant]
            assert np.linalg.norm(found - places[row, instant]) == pytest.approx(least_m)


def test_a_course_counts_clockwise_from_north_and_a_hover_has_none() -> None:
    rates = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [-1.0, 0.0, 0.0], [0.1, 0.1, 9.0]])
    assert course_rad(rates) == pytest.approx([0.0, math.pi / 2, math.pi, math.nan], nan_ok=True)


@given(st.floats(0.1, 4000.0), st.integers(1, 1000))
def test_a_scene_has_few_enough_instants_to_be_sent_at_once(length_s: float, vehicles: int) -> None:
    t_s = instants_s(5.0, 5.0 + length_s, vehicles)
    assert (t_s[0], t_s[-1]) == (5.0, 5.0 + length_s) and (np.diff(t_s) > 0.0).all()
    assert len(t_s) <= 1500 and len(t_s) * vehicles <= 400_000


def test_the_fence_of_the_vehicles_is_shown_round_all_they_fly(plan: Plan, replay: Scene) -> None:
    for scene in (scene_of_plan(plan), replay):
        (fence,) = (zone for zone in scene.zones if zone.name == "fence")
        assert fence.keep_in and scene.planned is not None
        known = scene.planned.places_ned_m[..., :2].reshape(-1, 2)
        margin_m = inside_m(fence.corners_m[:-1], known[~np.isnan(known[:, 0])])
        assert 9.0 < margin_m.min() < 12.0  # the export's margin is 10 m


def test_the_largest_control_is_shown_with_its_vehicle_and_rally_points_are_those_of_the_returns() -> None:
    plan = plan_of(NAME)
    scene = scene_of_plan(plan)
    curves = [one for one in scene.curves if one.on_demand]
    assert [one.name for one in curves] == [f"{name}, largest" for name in ("U1", "U2", "U3", "U4")]
    instant = len(scene.t_s) // 2
    controls = plan.controls(scene.t_s[instant : instant + 1])[:, 0]
    for column, curve in enumerate(curves):
        worst = int(np.abs(controls[:, column]).argmax())
        assert curve.planned is not None and curve.planned[instant] == pytest.approx(controls[worst, column])
        assert curve.vehicles[instant, 0] == plan.sysids[worst]
    assert scene.rally_ned_m is not None
    np.testing.assert_allclose(scene.rally_ned_m[:, 0], plan.landing_points_ned_m, atol=1e-6)
