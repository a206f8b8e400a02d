"""What was seen of a survey, by tracks of known places."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from gcs.flight.assessment.flown_coverage import FlownCoverage, flown_coverage
from gcs.flight.assessment.route_passing import Track
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.sources.survey_flight import SurveyOrder
from tests.unit.plan.surveyed import FIELD, SWATH_M, corners_of, flown, scenario_of


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    scenario = scenario_of(SurveyOrder(FIELD, SWATH_M), tmp_path_factory.mktemp("survey"))
    return flown(scenario, corners_of(scenario))


def tracks_of(plan: Plan) -> dict[int, Track]:
    t_s = np.arange(-5.0, plan.flight_s + 5.0, 0.2)
    places = plan.states(t_s)[..., POSITION]
    return {sysid: (t_s, track) for sysid, track in zip(plan.sysids, places, strict=True)}


def seen(plan: Plan, tracks: dict[int, Track]) -> FlownCoverage:
    found = flown_coverage(plan, tracks)
    assert found is not None
    return found


def test_who_flies_as_planned_sees_everything(plan: Plan) -> None:
    found = seen(plan, tracks_of(plan))
    assert (found.share, found.missed) == (1.0, ())
    assert found.data() == {"share": 1.0, "missed": []}


def test_a_vehicle_that_is_missing_leaves_its_strips_out(plan: Plan) -> None:
    tracks = tracks_of(plan)
    gone = plan.sysids[2]
    _, track = tracks.pop(gone)
    found = seen(plan, tracks)
    strip = shapely.LineString(track[:, :2]).buffer(0.5 * SWATH_M)
    assert found.share < 0.95
    assert all(strip.buffer(0.1).contains(shapely.Point(north, east)) for north, east, _ in found.missed)
    assert found.missed[0][2] == max(m2 for _, _, m2 in found.missed)
    assert found.share == pytest.approx(1.0 - sum(m2 for _, _, m2 in found.missed) / FIELD.area)


def test_what_is_not_known_to_have_been_flown_was_not_seen(plan: Plan) -> None:
    """Positions are missing for 20 s on a pass, or come from before T0 alone."""
    every = tracks_of(plan)
    t_s, track = every[plan.sysids[plan.leader]]
    inside_s = t_s[np.linalg.norm(track[:, :2] - np.array(FIELD.centroid.coords[0]), axis=1).argmin()]
    known = np.abs(t_s - inside_s) > 10.0
    holes = {sysid: (t_s[known], track[known]) for sysid, (_, track) in every.items()}
    found = seen(plan, holes)
    assert 0.7 < found.share < 0.8  # 20 s of a line of six, 12 m each
    early = {sysid: (t_s - 1000.0, track) for sysid, (t_s, track) in tracks_of(plan).items()}
    assert seen(plan, early).share == 0.0


def test_without_a_survey_nothing_is_said(plan: Plan) -> None:
    bare = plan.scenario.model_copy(update={"survey": None})
    assert flown_coverage(replace(plan, scenario=bare), tracks_of(plan)) is None
