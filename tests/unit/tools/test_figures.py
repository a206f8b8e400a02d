"""The pictures of the documents can be drawn from plans, and what they measure is what the verifier measures."""

from __future__ import annotations

import base64
import io
import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib import image
from PIL import Image

import gcs
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from tools import figures
from tools.pictures.change import draw_change
from tools.pictures.film import write_film
from tools.pictures.flight import draw_flight
from tools.pictures.measures import clearance_m, nearest_m, size
from tools.pictures.page_film import save_film, smaller
from tools.pictures.scenery import chain_lines, save
from tools.pictures.tutorial import commands, draw_exported, waypoints_deg
from tools.pictures.view import HEIGHT, WIDTH, Camera, camera_near, draw_view, ground_image, hidden


@pytest.fixture(scope="module")
def changing(plan_of: Callable[[str], Plan]) -> Plan:
    return plan_of("changes/scenario.toml")


def is_drawn(path: Path) -> bool:
    """More than a page of one colour."""
    return bool(np.ptp(image.imread(path)[..., :3]) > 0.5)


@pytest.mark.slow
def test_flight_and_every_change_are_drawn(changing: Plan, tmp_path: Path) -> None:
    assert is_drawn(save(draw_flight(changing, changing), tmp_path / "map.png"))
    for move in (changing.moves[1], changing.moves[-1]):
        assert is_drawn(save(draw_change(changing, move), tmp_path / "change.png"))


@pytest.mark.slow
def test_changes_of_height_get_a_panel(changing: Plan) -> None:
    across, in_lanes = (len(draw_change(changing, move).axes) for move in (changing.moves[1], changing.moves[-1]))
    assert changing.moves[-1].way == "in one altitude lane"
    assert in_lanes == across + 1


@pytest.mark.slow
def test_a_formation_is_drawn_close_up(changing: Plan, tmp_path: Path) -> None:
    camera = camera_near(changing, 60.0, (30.0, 10.0, 8.0))
    assert is_drawn(save(draw_view(changing, 60.0, camera, samples=1), tmp_path / "close_up.png"))


@pytest.mark.slow
def test_the_camera_sees_the_formation_before_itself(changing: Plan) -> None:
    camera = camera_near(changing, 60.0, (30.0, 10.0, 8.0))
    places = changing.states(np.array([60.0]))[:, 0, :3] * (1.0, 1.0, -1.0)
    pixels, ahead = camera.pixels(places.mean(axis=0))
    assert float(ahead) == pytest.approx(np.hypot(30.0, 10.0), rel=1e-6)
    assert float(pixels[0]) == pytest.approx(0.5 * WIDTH)
    assert float(pixels[1]) == pytest.approx(camera.horizon * HEIGHT - camera.focal * WIDTH * 8.0 / float(ahead))


@pytest.mark.slow
def test_ground_hides_what_is_behind_it_and_nothing_else(repo_root: Path) -> None:
    """From the south of Simulation 1's 48 m mountain: the sky is above it, and a place behind it is not seen."""
    terrain = gcs.load_scenario(repo_root / "missions" / "simulation1").terrain
    camera = Camera(np.array([460.0, 750.0, 10.0]), 0.0, horizon=0.3)
    behind, before, above = np.array([[1060.0, 750.0, 10.0], [560.0, 750.0, 10.0], [1060.0, 750.0, 120.0]])
    assert hidden(terrain, camera, np.array([behind, before, above])).tolist() == [True, False, False]
    image = ground_image(terrain, camera)
    assert image.shape == (HEIGHT, WIDTH, 3)
    top = int(camera.pixels(np.array([760.0, 750.0, 48.0]))[0][1])
    below, over = image[top - 12, WIDTH // 2], image[top + 12, WIDTH // 2]
    assert over[2] > over[0] + 0.05 and below[2] < below[0] + 0.05  # blue above the top, ground below it


@pytest.mark.long
def test_film_has_a_frame_for_every_step(changing: Plan, tmp_path: Path) -> None:

    path = write_film(changing, tmp_path / "film.gif", frame_s=75.0)
    with Image.open(path) as film:
        assert film.n_frames == np.ceil(changing.flight_s / 75.0)


@pytest.mark.long
def test_measures_are_the_verifiers(changing: Plan) -> None:
    t_s = np.arange(0.0, changing.flight_s, 0.05)
    report = verify(changing)
    # The report has bounds, which are at most 2 % of a margin below what is flown; a height is no less than a distance.
    assert report.clearance_min_m <= clearance_m(changing, t_s).min() <= 1.05 * report.clearance_min_m
    assert report.separation_min_m is not None
    assert report.separation_min_m <= nearest_m(changing, t_s).min() <= 1.05 * report.separation_min_m


@pytest.mark.slow
def test_size_is_the_formations_not_its_heading(changing: Plan) -> None:
    _, rotation, shrinking, back = changing.moves
    during = size(changing, np.linspace(rotation.start_s, rotation.end_s, 20))
    np.testing.assert_allclose(during, 1.0, atol=1e-9)
    assert size(changing, np.array([0.0, shrinking.end_s, back.end_s])) == pytest.approx([1.0, 0.6, 1.0])


def test_chain_is_the_shortest_that_joins_all() -> None:
    vee = np.array([[0.0, 0.0], [-1.0, 1.0], [-1.0, -1.0], [-2.0, 2.0], [-2.0, -2.0]])
    places = np.column_stack([vee, np.zeros(5)])
    north, east = chain_lines(places)
    lines = np.column_stack([north, east]).reshape(-1, 3, 2)
    assert np.isnan(lines[:, 2]).all()
    assert np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1) == pytest.approx(np.full(4, np.sqrt(2.0)))


@pytest.mark.slow
def test_rigid_scenario_differs_in_its_changes_alone(changing: Plan) -> None:
    rigid = figures.rigid(changing.scenario)
    assert rigid.formation.change == ()
    assert (
        rigid.formation.model_copy(update={"change": changing.scenario.formation.change}) == changing.scenario.formation
    )
    assert rigid.limits == changing.scenario.limits


def test_the_tutorials_commands_are_typed_without_the_set_up() -> None:
    text = "```sh\n./tools/run gcs new a\ncat >> a\n```\n```python\nx\n```\n```sh\n./tools/run gcs b\n```\n"
    assert commands(text) == ["gcs new a\ncat >> a\n", "gcs b\n"]


def test_exported_missions_are_drawn(repo_root: Path, tmp_path: Path) -> None:
    folder = repo_root / "missions" / "simulation1" / "expected"
    files = sorted(folder.glob("*.plan"))
    figure = draw_exported(folder)
    assert is_drawn(save(figure, tmp_path / "exported.png"))
    assert [line.get_label() for line in figure.axes[0].lines if line.get_label() in {f.name for f in files}]
    track = waypoints_deg(json.loads(files[0].read_text(encoding="utf-8")))
    assert track.shape[1] == 2 and np.ptp(track, axis=0) == pytest.approx([0.0109, 0.0135], rel=0.03)


def test_pictures_of_the_tutorial_are_its_own(repo_root: Path) -> None:
    shown = re.findall(
        r"pictures/tutorial/(\w+\.png)", (repo_root / "docs" / "tutorial.md").read_text(encoding="utf-8")
    )
    assert sorted(shown) == sorted(file.name for file in (repo_root / "docs" / "pictures" / "tutorial").iterdir())


def test_pictures_belong_to_missions(repo_root: Path) -> None:
    for name in figures.PICTURES:
        assert (repo_root / "missions" / name / "scenario.toml").is_file()


def test_the_film_of_the_page_has_every_picture_in_its_colours_and_rests_on_the_last(tmp_path: Path) -> None:
    pictures = []
    for left in (100, 500, 900):
        window = Image.new("RGB", (1200, 750), "#dfe7ef")
        window.paste("#d55e00", (left, 300, left + 60, 360))
        packed = io.BytesIO()
        window.save(packed, "PNG")
        pictures.append(smaller(base64.b64encode(packed.getvalue()).decode()))
    path = save_film(pictures, tmp_path / "flight.gif")
    with Image.open(path) as film:
        assert (film.size, film.n_frames) == ((800, 500), 3)
        shown_ms = []
        for number, left in enumerate((100, 500, 900)):
            film.seek(number)
            shown_ms.append(film.info["duration"])
            marker = film.convert("RGB").getpixel((int((left + 30) / 1.5), 220))
            assert isinstance(marker, tuple) and marker == pytest.approx((213, 94, 0), abs=8)
    assert shown_ms[-1] > 5 * shown_ms[0] > 0
