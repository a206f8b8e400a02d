"""What a scene has of missions on board, of a survey and of the battery: what was predicted, drawn and planned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.flight.monitoring.predicted_tracks import PredictedTracks
from gcs.flight.scene.plan_scene import needed_pct, points_of, scene_of_plan, survey_of
from gcs.flight.scene.predicted_band import band_of, in_band
from gcs.frames import geodetic_to_ned
from gcs.physics.states import POSITION
from gcs.plan.trajectory.energy import battery_model
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.places import RoutePoint, SurveyTable
from gcs.scenario.values.si import local_origin
from tests.real_flights import plan_of


@pytest.fixture(scope="module")
def plan() -> Plan:
    return plan_of("px4-1.17dev-stream")


def test_a_band_lies_on_the_predicted_track_between_t0_and_the_arrival(plan: Plan) -> None:
    tracks, t_s = PredictedTracks.of_plan(plan), np.array([-1.0, 0.0, 50.0, plan.flight_s, plan.flight_s + 0.1])
    band = band_of(tracks, plan, t_s)
    np.testing.assert_allclose(band.places_ned_m[:, 1:4], plan.states(t_s[1:4])[..., POSITION], atol=0.01)
    assert np.isnan(band.places_ned_m[:, [0, 4]]).all() and (band.off_m, *band.late_s) == (
        tracks.band_m,
        *tracks.band_s,
    )


def test_a_vehicle_is_outside_while_it_is_beside_its_band_and_unknown_while_silent(plan: Plan) -> None:
    tracks, t_s = PredictedTracks.of_plan(plan), np.arange(-5.0, 60.0, 0.5)
    places = plan.states(t_s)[..., POSITION]
    places[2, (t_s > 20.0) & (t_s < 30.0), 2] -= tracks.band_m + 1.0
    places[3, t_s > 40.0] = np.nan
    late = np.clip(t_s - 4.0, plan.t_start_s, None)  # the second is late by more than its band from 10 s on
    places[1, t_s > 10.0] = plan.states(late)[1, t_s > 10.0, POSITION]
    found = in_band(tracks, plan, t_s, places)
    assert (found[:, t_s < 0.0] == -1).all() and (found[0, t_s >= 0.0] == 1).all()
    assert (found[2, (t_s > 20.0) & (t_s < 30.0)] == 0).all() and (found[2, t_s >= 30.0] == 1).all()
    assert (found[3, t_s > 40.0] == -1).all() and (found[1, t_s > 10.0] == 0).all()


def test_the_rest_of_a_plan_needs_what_its_battery_model_says(plan: Plan) -> None:
    t_s = np.array([plan.t_start_s, 60.0, plan.t_end_s])
    needed, model = needed_pct(plan, t_s), battery_model(plan)
    assert needed is not None and needed[:, 2] == pytest.approx(0.0, abs=1e-9)
    expected = [100.0 * model.planned_use(row, 60.0, plan.t_end_s) for row in range(len(plan.sysids))]
    assert needed[:, 1] == pytest.approx(expected)
    vehicle = plan.scenario.vehicle.model_copy(update={"power": None})
    bare = replace(plan, scenario=plan.scenario.model_copy(update={"vehicle": vehicle}))
    assert needed_pct(bare, t_s) is None


def test_a_survey_has_its_edge_its_holes_and_each_pass_by_name_once(plan: Plan) -> None:
    hole = {"polygon_m": [(20.0, 20.0), (30.0, 20.0), (30.0, 30.0)]}
    corners = ((0.0, 0.0), (90.0, 0.0), (90.0, 90.0))
    table = SurveyTable.model_validate({"swath_m": 12.0, "polygon_m": corners, "hole": [hole]})
    names = ("before pass 1", "pass 1", "pass 1 end", None, "pass 2")
    route = tuple(RoutePoint(name=name, position_m=(n, 2.0, 20.0)) for n, name in enumerate(names))
    scenario = plan.scenario.model_copy(update={"survey": table, "route": route})
    survey = survey_of(replace(plan, scenario=scenario))
    assert survey is not None and (survey.swath_m, survey.seen_from_m, survey.until_s) == (12.0, None, plan.flight_s)
    assert [ring.tolist() for ring in survey.rings_m] == [
        [list(one) for one in (*corners, corners[0])],
        [list(one) for one in (*hole["polygon_m"], hole["polygon_m"][0])],
    ]
    points = points_of(scenario)
    assert [one.name for one in points] == ["1", "2 pass 1", "3", "4", "5 pass 2"]
    assert points[4].place_ned_m.tolist() == [4.0, 2.0, -20.0]
    assert survey_of(plan) is None and points_of(plan.scenario) == ()


def test_the_corners_of_the_ground_lie_on_the_square_map_of_the_web(plan: Plan) -> None:
    ground = scene_of_plan(plan).ground
    assert ground is not None and len(ground.mercator) == 4
    x, y = np.array(ground.mercator).T
    lat_deg = np.degrees(np.arctan(np.sinh(np.pi * (1.0 - 2.0 * y))))
    origin = local_origin(plan.scenario)
    places = geodetic_to_ned(lat_deg, 360.0 * x - 180.0, np.full(4, origin.alt_amsl_m), origin)
    expected = [(north, east) for north in ground.north_m[[0, -1]] for east in ground.east_m[[0, -1]]]
    np.testing.assert_allclose(places[:, :2], expected, atol=0.01)
