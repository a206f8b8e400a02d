"""The page of the paper: printed from its records, its figures drawn, its sentences judged as they stand in docs."""

from __future__ import annotations

import json
import re
import string
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import image

from gcs.plan.trajectory.plan import Plan
from gcs.scenario.sources.load import load_scenario
from tools.paper import figures, page, peers, sentences, unstated
from tools.paper.swarm import POINTS, Search
from tools.paper.track import turns

PICTURE = re.compile(r"!\[[^]]*\]\(([^)]+)\)")
LINK = re.compile(r"(?<!!)\[[^]]*\]\((?!https?:)([^)#]+)\)")


@pytest.fixture(scope="module")
def record(repo_root: Path) -> dict[str, Any]:
    """What the page in docs was printed from."""
    found: dict[str, Any] = json.loads((repo_root / "docs" / "paper.json").read_text(encoding="utf-8"))
    return found


@pytest.fixture(scope="module")
def plans(plan_of: Callable[[str], Plan]) -> dict[str, Plan]:
    """Of every study, by the name that the page has for it."""
    files = {name: f"{name}/scenario.toml" for name in page.SIMULATIONS} | {name: name for name in page.WEIGHTS}
    return {name: plan_of(file) for name, file in files.items()}


def verdicts(found: dict[str, list[Any]]) -> dict[str, bool]:
    return {name: holds for name, (holds, *_) in found.items()}


def test_what_the_page_shows_is_there(repo_root: Path) -> None:
    text = (repo_root / "docs" / "paper.md").read_text(encoding="utf-8")
    pictures = PICTURE.findall(text)
    assert pictures == [f"paper/fig{number:02d}.png" for number in figures.CAPTIONS]
    assert {(repo_root / "docs" / name).exists() for name in pictures + LINK.findall(text)} == {True}


def test_the_page_and_the_readme_say_what_was_measured(record: dict[str, Any]) -> None:
    of = page.shown(record)
    for document, least in zip(page.DOCUMENTS, (50, 4), strict=True):
        text = document.read_text(encoding="utf-8")
        assert len(page.MARK.findall(text)) == text.count("<!-- paper:") >= least
        assert page.updated(text, of) == text
    assert list(record) == list(page.SECTIONS)


def test_a_number_and_a_table_that_differ_are_written_anew() -> None:
    text = "takes 1.30<!-- paper: time --> s\n\n<!-- paper: rows -->\n\n| 1 |\n\n<!-- end -->\n"
    assert page.updated(text, {"time": 1.304, "rows": "| 1 |"}) == text
    assert page.updated(text, {"time": 1.306, "rows": "| 2 |"}) == text.replace("1.30", "1.31").replace(
        "| 1 |", "| 2 |"
    )
    with pytest.raises(KeyError):
        page.updated(text, {"time": 1.3})


def test_every_benchmark_has_its_place_on_the_page(repo_root: Path) -> None:
    assert {file.stem.removeprefix("bench_") for file in repo_root.glob("tools/bench_*.py")} == set(peers.BENCHMARKS)


def test_every_sentence_is_judged_and_shows_what_was_measured(record: dict[str, Any]) -> None:
    found = {name: one for section in record.values() for name, one in section.get("found", {}).items()}
    assert list(sentences.TABLE) == list(sentences.JUDGES) == list(found)
    for name, sentence in sentences.TABLE.items():
        shown = [field for _, field, *_ in string.Formatter().parse(sentence.measured) if field is not None]
        assert len(shown) == len(found[name]) - 1, name
        assert {int(number) for number in sentence.figures.split(", ")} <= set(figures.CAPTIONS)


def test_a_sentence_that_holds_in_one_sense_says_in_which() -> None:
    read = sentences.Sentence("A1", "§4.1", "8", "it can", "can", "{:.1f} m", "why")
    plain = sentences.Sentence("A1", "§4.1", "8", "it can", "", "{:.1f} m", "why")
    assert "*read as:* can | 2.0 m | confirmed as read |" in read.row([True, 2.0], "a")
    assert plain.row([True, 2.0], "b") == "| A1 | §4.1: it can | 2.0 m | confirmed | why | b |"
    assert "| **not confirmed** |" in read.row([False, 2.0], "c")


def test_the_column_shows_where_a_sentence_holds() -> None:
    tried = [(10.0, [False, True]), (20.0, [True, True]), (30.0, None)]
    row = {"symbol": "h_r", "unit": "m", "chosen": 20.0, "tried": [{"value": v, "holds": h} for v, h in tried]}
    assert unstated.column([row], 0) == "h_r: holds at 20 m; not at 10"
    assert unstated.column([row], 1) == "none of them"
    assert unstated.summary(row) == "| h_r | 20 m | 10, 30 | 30 |"


def test_turning_points_are_counted_beyond_noise() -> None:
    t = np.linspace(0.0, 3.0, 3001)
    wave = np.sin(2.0 * np.pi * t)
    assert turns(wave) == 6
    assert turns(wave + 1e-3 * np.sin(300.0 * t)) == 6
    assert turns(t) == 0


def test_pso_keeps_its_constraints_and_sees_the_tracks_before(repo_root: Path) -> None:
    """Ends on the edge of the box are inside; on an earlier track it is too near, beside it it is not."""
    scenario = load_scenario(repo_root / "missions" / "simulation2")
    start, goal = np.array([0.0, 0.0, 3.0]), np.array([1198.0, 999.0, 2.0])
    level = np.r_[np.zeros(POINTS), np.full(POINTS, 14.0)][None]
    alone = Search(scenario, start, goal, [])
    places, t_s, load_factor = alone.paths(level)
    ground, *others = alone.violations(places, t_s, load_factor)[0]
    assert ground > 0.0 and others == [0.0] * 4  # the straight way is too low, and nothing else
    grid = np.arange(0.0, t_s[0, -1], 0.05)
    track = np.stack([np.interp(grid, t_s[0], places[0, :, axis]) for axis in range(3)], axis=1)
    for aside_m, near in ((0.0, True), (1.0, False)):
        behind = Search(scenario, start, goal, [track + np.array([0.0, 0.0, aside_m])])
        assert (behind.violations(*behind.paths(level))[0, 4] > 0.2) == near


def test_pso_flies_its_path_within_every_limit_and_a_detour_takes_longer(repo_root: Path) -> None:
    """Against the path sampled in time: speeds by differences, and a straight line worked out by hand."""
    scenario = load_scenario(repo_root / "missions" / "simulation2")
    search = Search(scenario, np.array([0.0, 0.0, 14.0]), np.array([1198.0, 999.0, 14.0]), [])
    aside = np.array([0.0, 150.0, -150.0, 150.0])[:, None] * np.ones(POINTS)
    aside[2:, ::2] *= -1.0
    places_m, t_s, _ = search.paths(np.hstack([aside, np.full((4, POINTS), 14.0)]))
    length_m, a = float(np.hypot(1198.0, 999.0)), search.accel_mps2
    v0, v = float(np.hypot(2.0, 2.0)), 5.0
    ramps_s, ramps_m = (v - v0) / a + v / a, (v**2 - v0**2 + v**2) / (2.0 * a)
    assert t_s[0, -1] == pytest.approx(ramps_s + (length_m - ramps_m) / v, abs=0.5)
    assert t_s[1, -1] > t_s[0, -1] + 1.0 and t_s[2, -1] > t_s[1, -1] + 1.0
    for t, places in zip(t_s, places_m, strict=True):
        speed = np.diff(places, axis=0) / np.diff(t)[:, None]
        assert np.all(np.abs(speed) <= np.array(scenario.limits.speed_ned_mps) + 1e-6)
        assert np.hypot(*speed[:, :2].T).max() <= 5.0 + 1e-6
        assert np.hypot(*speed[0, :2]) < 4.5 and np.hypot(*speed[-1, :2]) < 3.5  # from 2.8 m/s, and to rest


@pytest.mark.long
def test_the_sections_are_measured_as_in_docs(
    plans: dict[str, Plan], record: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All of it, with one value varied and PSO stopped early: verdicts are those of docs, and no figure is empty."""
    monkeypatch.setattr(page, "plan_of", plans.__getitem__)
    only = {key: value for key, value in unstated.VALUES.items() if key.endswith("force_N")}
    monkeypatch.setattr(unstated, "VALUES", only)
    measured = {name: section(tmp_path) for name, section in page.SECTIONS.items() if name != "swarms"}
    measured["swarms"] = page.swarms(tmp_path, seeds=1, generations=3)
    for name in ("weighting", "simulations"):
        assert verdicts(measured[name]["found"]) == verdicts(record[name]["found"])
        (row,), (docs_row,) = measured[name]["varied"], record[name]["varied"][-1:]
        assert row == docs_row
    assert measured["readings"]["m1"]["turn_radps2"] == pytest.approx(record["readings"]["m1"]["turn_radps2"])
    about = {"about": peers.about(), "took_s": 1.0}
    of = page.shown({name: about | section for name, section in measured.items()})
    assert page.updated(page.DOCUMENTS[0].read_text(encoding="utf-8"), of).count("not confirmed") >= 8
    for number in figures.CAPTIONS:
        assert np.ptp(image.imread(tmp_path / f"fig{number:02d}.png")[..., :3]) > 0.5, f"figure {number} is empty"
