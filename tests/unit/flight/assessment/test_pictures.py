"""Every kind of picture of a flight: what stands in it, that no label is cut, and that none covers another."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.patches import Polygon
from matplotlib.text import Text

from gcs.flight.monitoring.progress import Event
from gcs.flight.plots.flight_plot import draw_formation, draw_map
from gcs.flight.plots.overview_plot import draw_plan, draw_scenario, seen, shapes_of
from gcs.flight.plots.replay_plot import draw_recording
from gcs.flight.plots.tracks_view import close_ups, draw_tracks
from gcs.flight.recording.recording import Recording, VehicleTrack
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.formation.timeline import Move
from gcs.plan.plan_file import load_plan
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.places import NoFlyZone
from gcs.scenario.schema.scenario import PlannedWind
from tests.real_flights import FOLDER

CHANGE = Move("shrink", "shrink to 0.5", "at 60 s", 60.0, 70.0, 5.0, "speed", "straight", 2.0)


@pytest.fixture(scope="module")
def plan() -> Plan:
    """A plan past two disks over hills, with wind, a polygon that moves, and a long title that has dollars in it."""
    plan, _ = load_plan(FOLDER / "px4-1.17dev-stream" / "plan.skein")
    corners = ((300.0, -60.0), (340.0, -60.0), (320.0, -20.0))
    moving = NoFlyZone(polygon_m=corners, moves=((0.0, 0.0, 0.0), (100.0, 60.0, -40.0)))
    wind = PlannedWind(speed_mps=4.0, from_deg=270.0)
    title = "six vehicles that cost $3 and $4 each " * 5
    changed = {"title": title, "no_fly": (*plan.scenario.no_fly, moving), "wind": wind}
    object.__setattr__(plan, "scenario", plan.scenario.model_copy(update=changed))
    return plan


@pytest.fixture(scope="module")
def drawn(plan: Plan) -> Iterator[dict[str, Any]]:
    """A figure of each kind, drawn once; its canvas has the texts that it shows."""
    t_s = np.arange(plan.t_start_s, plan.t_end_s, 0.5)
    states = plan.states(t_s)
    places = states[..., POSITION]
    flown = places + np.random.default_rng(4).normal(0.0, 0.3, places.shape)
    scenario, sysids = plan.scenario, plan.sysids
    tracks = tuple(_reports(sysid, t_s, flown[row], states[row]) for row, sysid in enumerate(sysids))
    events = tuple(Event(float("nan"), 40.0 + 0.5 * sysid, sysid, "told to land") for sysid in sysids)
    recording = Recording("field, landed", tracks, events, (), plan)
    figures = {
        "scenario": draw_scenario(scenario),
        "plan": draw_plan(plan),
        "changing": draw_plan(replace(plan, moves=(CHANGE,))),
        "map": draw_map(scenario, sysids, t_s, flown, places),
        "tracks": draw_tracks(scenario, sysids, t_s, flown, (CHANGE,)),
        "formation": draw_formation(scenario, sysids, t_s, flown),
        "replay": draw_recording(recording, float(t_s[0]), float(t_s[-1])),
    }
    own = Text.draw
    try:
        for figure in figures.values():
            figure.shown = []

            def note(text: Text, *given: Any, figure: Any = figure, **named: Any) -> None:
                figure.shown.append(text)
                own(text, *given, **named)

            Text.draw = note  # type: ignore[method-assign]
            figure.draw_without_rendering()
    finally:
        Text.draw = own  # type: ignore[method-assign]
    yield figures
    plt.close("all")


def _reports(sysid: int, t_s: Any, places: Any, states: Any) -> VehicleTrack:
    """Reports from which a vehicle was silent for some time."""
    heard = (t_s < 65.0) | (t_s > 85.0)
    none = np.zeros(int(heard.sum()), dtype=np.int64)
    return VehicleTrack(sysid, 12, t_s[heard], places[heard], states[heard, VELOCITY], none > 0, none, none)


def boxes(figure: Any) -> list[tuple[str, Any]]:
    """The texts that a figure shows, with their extents."""
    renderer = figure.canvas.get_renderer()
    texts = {id(text): text for text in figure.shown if text.get_visible() and text.get_text().strip()}
    return [(text.get_text(), Text.get_window_extent(text, renderer)) for text in texts.values()]


def words(figure: Any) -> str:
    return "\n".join(text for text, _ in boxes(figure))


KINDS = ("scenario", "plan", "changing", "map", "tracks", "formation", "replay")


@pytest.mark.parametrize("kind", [pytest.param(KINDS[0], marks=pytest.mark.slow), *KINDS[1:]])
def test_no_label_is_cut(drawn: dict[str, Any], kind: str) -> None:
    page = drawn[kind].bbox.padded(1.0)
    found = boxes(drawn[kind])
    assert len(found) > 10
    cut = [text for text, box in found if not (page.contains(box.x0, box.y0) and page.contains(box.x1, box.y1))]
    assert cut == []


@pytest.mark.parametrize("kind", KINDS)
def test_no_label_covers_another(drawn: dict[str, Any], kind: str) -> None:
    """A pixel of touching is none."""
    found = [(text, box.padded(-1.0)) for text, box in boxes(drawn[kind])]
    over = [(first, second) for (first, one), (second, other) in combinations(found, 2) if one.overlaps(other)]
    assert over == []


@pytest.mark.parametrize("kind", ["scenario", "plan", "map", "tracks", "replay"])
def test_every_map_has_zones_and_the_wind(drawn: dict[str, Any], kind: str) -> None:
    told = words(drawn[kind])
    assert "no-fly zone" in told
    assert "wind 4 m/s from 270°" in told


@pytest.mark.parametrize("kind", ["plan", "map", "replay"])
def test_every_map_of_tracks_has_course_time_marks_and_where_a_zone_is_when(drawn: dict[str, Any], kind: str) -> None:
    told = words(drawn[kind]).splitlines()
    assert {"course", "vehicle 1 every 60 s", "0 s", "60 s", "120 s", "zone at 0 s", "zone at 100 s"} <= set(told)
    axes = drawn[kind].axes[0] if kind != "replay" else next(a for a in drawn[kind].axes if a.get_xlabel() == "east, m")
    assert sum(isinstance(patch, Polygon) for patch in axes.patches) == 2 * 2 + 4  # two disks; two places of the third


@pytest.mark.parametrize("kind", ["map", "replay"])
def test_the_plan_lies_beneath_what_was_flown(drawn: dict[str, Any], kind: str) -> None:
    assert "planned" in words(drawn[kind]).splitlines()
    axes = next(a for a in drawn[kind].axes if a.get_xlabel() == "east, m")
    long = [line for line in axes.lines if len(line.get_xdata()) > 100]
    planned, flown = [line for line in long if line.get_lw() > 3.0], [line for line in long if line.get_lw() < 3.0]
    assert len(planned) == len(flown) == 6
    assert max(line.get_zorder() for line in planned) < min(line.get_zorder() for line in flown)


def test_what_is_not_planned_says_so_and_has_no_tracks(drawn: dict[str, Any]) -> None:
    assert "field: not planned" in words(drawn["scenario"])
    (axes,) = (a for a in drawn["scenario"].axes if a.get_xlabel() == "east, m")
    assert max(len(line.get_xdata()) for line in axes.lines) == 1


@pytest.mark.parametrize(("kind", "others"), [("plan", "least height"), ("replay", "height, m")])
def test_curves_of_speed_and_of_distance_to_zones_stand_beside_height_and_separation(
    drawn: dict[str, Any], kind: str, others: str
) -> None:
    names = [axes.get_ylabel().replace("\n", " ") for axes in drawn[kind].axes]
    for name in ("speed, m/s", "least separation, m", "least distance to a zone, m", others):
        assert sum(one.startswith(name) for one in names) == 1


def test_close_ups_are_where_something_happens(plan: Plan, drawn: dict[str, Any]) -> None:
    t_s = np.arange(0.0, plan.flight_s, 0.5)
    places = plan.states(t_s)[..., POSITION].copy()
    near = int(np.argmin(np.abs(t_s - 33.0)))
    places[2, near] = places[1, near] + (0.0, 1.25, 0.0)
    changed, call, zone = close_ups(plan.scenario, plan.sysids, t_s, places, (CHANGE,))
    assert (changed.begin_s, changed.end_s) == (60.0, 70.0)
    assert call.title == "nearest call: vehicles 2 and 3, 1.25 m"
    assert call.at_s == t_s[near]
    away_m = plan.zone_distances_m(t_s, places).min(axis=0)
    assert zone.at_s == t_s[int(np.argmin(away_m))]
    assert "a no-fly zone" in zone.title
    told = words(drawn["tracks"])
    assert "shrink to 0.5, t = 60 to 70 s" in told
    assert "nearest call: vehicles" in told


def test_the_formation_fills_its_panels_and_shows_its_course(plan: Plan, drawn: dict[str, Any]) -> None:
    figure = drawn["formation"]
    assert "course" in words(figure)
    filled = sum(axes.get_window_extent().width * axes.get_window_extent().height for axes in figure.axes)
    assert filled > 0.6 * figure.bbox.width * figure.bbox.height
    for axes in figure.axes:
        places = np.array([line.get_xydata()[0] for line in axes.lines])
        spans = np.ptp(places, axis=0) / (np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()))
        assert spans.max() > 0.6


def test_each_shape_of_a_plan_has_a_panel_beneath_the_map(plan: Plan, drawn: dict[str, Any]) -> None:
    assert shapes_of(plan) == ()
    assert "from above" not in words(drawn["plan"])
    told = words(drawn["changing"])
    assert "start\nt = 0 s, from above" in told
    assert "shrink to 0.5\nt = 70 s, from above" in told
    panels = [axes for axes in drawn["changing"].axes if "from above" in axes.get_title()]
    places = np.array([line.get_xydata()[0] for line in panels[1].lines])  # east and north
    offsets = plan.offsets(np.array([70.0]))[:, 0, 1::-1]
    assert places - places[0] == pytest.approx(offsets - offsets[0])
    assert panels[0].get_xlim() == panels[1].get_xlim() == panels[1].get_ylim()


@pytest.mark.parametrize(("bearing_deg", "to_the_right"), [(90.0, "east"), (0.0, "north"), (240.0, "60°")])
def test_a_ring_that_stands_upright_is_seen_from_the_side(bearing_deg: float, to_the_right: str) -> None:
    turns = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    along, bearing = 20.0 * np.cos(turns), np.radians(bearing_deg)
    ring = np.stack([along * np.cos(bearing), along * np.sin(bearing), -20.0 * np.sin(turns)], axis=1)
    shape = seen("ring", 60.0, ring + 7.0)
    assert shape.view.labels == (to_the_right, "up")
    assert np.linalg.norm(shape.right_up_m, axis=1) == pytest.approx(np.full(40, 20.0))
    low = seen("stairs", 60.0, ring * [1.0, 1.0, 0.1])
    assert low.view.labels == ("east", "north")


def test_a_flown_ring_of_forty_that_stands_upright_is_drawn_round_and_without_forty_numbers(plan: Plan) -> None:
    """From above it is a line, on which no number could be read."""
    turns = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    ring = np.stack([np.zeros(40), 12.0 * np.cos(turns), -60.0 - 12.0 * np.sin(turns)], axis=1)
    t_s, sysids = np.arange(0.0, 20.0, 0.5), tuple(range(1, 41))
    tracks = np.repeat(ring[:, None], len(t_s), axis=1)
    formation = draw_formation(plan.scenario, sysids, t_s, tracks, (0.0, 10.0))
    space = draw_tracks(plan.scenario, sysids, t_s, tracks, (Move(**{**vars(CHANGE), "start_s": 5.0, "end_s": 10.0}),))
    close_up = next(axes for axes in space.axes if "shrink" in axes.get_title())
    for axes in (*formation.axes, close_up):
        assert "from the side" in axes.get_title()
        places = np.array([line.get_xydata()[-1] for line in axes.lines if len(line.get_xydata()) == 1])
        assert np.ptp(places, axis=0) == pytest.approx([24.0, 24.0])
        assert axes.get_aspect() == 1.0
        assert not any(text.get_text().isdigit() for text in axes.texts)
    assert "(true to scale)" in space.axes[0].get_title()
    plt.close(formation)
    plt.close(space)
