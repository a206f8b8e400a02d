"""The page of the paper can be made again: a short run has every section and figure of the page in docs.

Verdicts are checked against the paper's own numbers in `test_paper_sentences`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import image

from gcs.plan.trajectory.plan import Plan
from gcs.scenario.load import load_scenario
from tools.paper import book
from tools.paper.peers import ALL
from tools.paper.readme import MARK, updated
from tools.paper.run import Run
from tools.paper.speed_model import path_limits
from tools.paper.swarm import POINTS, Search
from tools.paper.track import turns
from tools.paper.weighting import FLIGHTS

PICTURE = re.compile(r"!\[[^]]*\]\(([^)]+)\)")
LINK = re.compile(r"(?<!!)\[[^]]*\]\((?!https?:)([^)#]+)\)")


@pytest.fixture(scope="module")
def docs(repo_root: Path) -> Path:
    return repo_root / "docs"


@pytest.fixture(scope="module")
def record(docs: Path) -> dict[str, Any]:
    """What the page in docs was printed from."""
    found: dict[str, Any] = json.loads((docs / book.JSON).read_text(encoding="utf-8"))
    return found


@pytest.fixture(scope="module")
def run(plan_of: Callable[[str], Plan], tmp_path_factory: pytest.TempPathFactory) -> Run:
    plans = {f"terminal_weighting/{name}.toml": plan_of(f"terminal_weighting/{name}.toml") for name in FLIGHTS.values()}
    plans |= {name: plan_of(f"{name}/scenario.toml") for name in ("simulation1", "simulation2")}
    return Run(tmp_path_factory.mktemp("paper"), short=True, log=lambda _: None, plans=plans)


@pytest.fixture(scope="module")
def short(run: Run) -> dict[str, Any]:
    return book.make(run, list(book.SECTIONS))


@pytest.mark.slow
def test_every_section_is_measured_and_printed(short: dict[str, Any], run: Run) -> None:
    text = (run.folder / book.PAGE).read_text(encoding="utf-8")
    assert list(short) == list(book.SECTIONS)
    headings = re.findall(r"^## (.+)$", text, re.M)
    assert headings == [section.TITLE for section in book.SECTIONS.values()]
    assert json.loads((run.folder / book.JSON).read_text(encoding="utf-8")) == short


@pytest.mark.slow
def test_every_figure_is_drawn(short: dict[str, Any], run: Run) -> None:
    text = (run.folder / book.PAGE).read_text(encoding="utf-8")
    pictures = set(PICTURE.findall(text))
    assert {f"paper/fig{number:02d}.png" for number in range(6, 23)} <= pictures
    for name in pictures:
        assert np.ptp(image.imread(run.folder / name)[..., :3]) > 0.5, f"{name} is empty"


@pytest.mark.slow
def test_a_simulation_can_be_turned_without_a_network(short: dict[str, Any], run: Run) -> None:
    for name in ("simulation1", "simulation2"):
        text = (run.pictures / f"{name}.html").read_text(encoding="utf-8")
        assert "Plotly.newPlot" in text and text.count('"scatter3d"') >= 6
        assert not re.search(r"<script[^>]* src=", text)


def test_no_number_of_the_page_is_typed_by_hand(record: dict[str, Any], docs: Path) -> None:
    assert (docs / book.PAGE).read_text(encoding="utf-8") == book.page(record)
    assert list(record) == list(book.SECTIONS)


def test_what_the_page_shows_is_there(docs: Path) -> None:
    text = (docs / book.PAGE).read_text(encoding="utf-8")
    for name in PICTURE.findall(text) + LINK.findall(text):
        assert (docs / name).is_file(), name


def test_every_benchmark_has_its_place_on_the_page(repo_root: Path) -> None:
    assert {file.stem.removeprefix("bench_") for file in repo_root.glob("tools/bench_*.py")} == set(ALL)


def test_turning_points_are_counted_beyond_noise() -> None:
    t = np.linspace(0.0, 3.0, 3001)
    wave = np.sin(2.0 * np.pi * t)
    assert turns(wave) == 6
    assert turns(wave + 1e-3 * np.sin(300.0 * t)) == 6
    assert turns(t) == 0


def test_the_readme_says_what_was_measured(record: dict[str, Any], repo_root: Path) -> None:
    text = (repo_root / "README.md").read_text(encoding="utf-8")
    assert len(MARK.findall(text)) == text.count("<!-- paper:") >= 4
    assert updated(text, record) == text


def test_a_number_that_differs_is_seen() -> None:
    text = "takes 1.30<!-- paper: scale.ratio.time --> times as long as 6 vehicles"
    assert updated(text, {"scale": {"ratio": {"time": 1.304}}}) == text
    assert "1.31<!--" in updated(text, {"scale": {"ratio": {"time": 1.306}}})
    with pytest.raises(KeyError):
        updated(text, {"scale": {}})


def test_a_swarm_keeps_its_constraints_and_sees_the_tracks_before(repo_root: Path) -> None:
    """Ends on the edge of the box are inside; on an earlier track it is too near, beside it it is not."""
    scenario = load_scenario(repo_root / "missions" / "simulation2")
    start, goal = np.array([0.0, 0.0, 3.0]), np.array([1198.0, 999.0, 2.0])
    level = np.r_[np.zeros(POINTS), np.full(POINTS, 14.0)][None]
    alone = Search(scenario, start, goal, [])
    path = alone.paths(level)
    ground, *others = alone.violations(path)[0]
    assert ground > 0.0 and others == [0.0] * 4  # the straight way is too low, and nothing else
    grid = np.arange(0.0, path.t_s[0, -1], 0.05)
    track = np.stack([np.interp(grid, path.t_s[0], path.places_m[0, :, axis]) for axis in range(3)], axis=1)
    assert Search(scenario, start, goal, [track]).violations(path)[0, 4] > 0.2
    assert Search(scenario, start, goal, [track + np.array([0.0, 0.0, 1.0])]).violations(path)[0, 4] == 0.0


def test_the_speed_of_a_swarms_path_keeps_every_limit_and_a_detour_takes_longer(repo_root: Path) -> None:
    """Against the path sampled in time: speeds by differences, and a straight line worked out by hand."""
    scenario = load_scenario(repo_root / "missions" / "simulation2")
    start, goal = np.array([0.0, 0.0, 14.0]), np.array([1198.0, 999.0, 14.0])
    search, limits = Search(scenario, start, goal, []), path_limits(scenario)
    aside = np.array([0.0, 150.0, -150.0, 150.0])[:, None] * np.ones(POINTS)
    aside[2:, ::2] *= -1.0
    paths = search.paths(np.hstack([aside, np.full((4, POINTS), 14.0)]))
    length_m, a = float(np.hypot(1198.0, 999.0)), limits.changing_mps2
    v0, v = float(np.hypot(2.0, 2.0)), 5.0
    ramps_s, ramps_m = (v - v0) / a + v / a, (v**2 - v0**2 + v**2) / (2.0 * a)
    assert paths.t_s[0, -1] == pytest.approx(ramps_s + (length_m - ramps_m) / v, abs=0.5)
    assert paths.t_s[1, -1] > paths.t_s[0, -1] + 1.0 and paths.t_s[2, -1] > paths.t_s[1, -1] + 1.0
    for t, places in zip(paths.t_s, paths.places_m, strict=True):
        speed = np.diff(places, axis=0) / np.diff(t)[:, None]
        assert np.all(np.abs(speed) <= np.array(scenario.limits.speed_ned_mps) + 1e-6)
        assert np.hypot(*speed[:, :2].T).max() <= 5.0 + 1e-6
        assert np.hypot(*speed[0, :2]) < 4.5 and np.hypot(*speed[-1, :2]) < 3.5  # from 2.8 m/s, and to rest
