"""What `gcs new` writes plans: whatever is typed, the times, speeds, distances and the battery leave room for it."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.cli import main
from gcs.plan.formation.schedule_fit import check_schedule
from gcs.plan.formation.timeline import made_changes
from gcs.plan.plan_file import load_plan
from gcs.plan.trajectory.energy import charge_needed
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.values.battery_estimate import battery_estimate
from gcs.scenario.values.si import route_points
from tests.unit.cli.planning.new_lines import options

KINDS = ("first", "sheets", "route", "survey")
WIND = "\n[wind]\nspeed_mps = 6.0\nfrom_deg = 240.0\n"
ROOM = 0.9  # of a speed limit, for what is at rest at both ends


def gcs(*words: str) -> int:
    return main.run(list(words))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("kind", KINDS)
@settings(deadline=None, max_examples=12)
@given(seed=st.integers(0, 10_000))
def test_whatever_is_typed_leaves_room_for_a_plan(kind: str, seed: int) -> None:
    before = Path.cwd()
    with TemporaryDirectory() as place:
        os.chdir(place)
        try:
            line = options(kind, Random(seed))
            written = gcs("new", "x", *line)
            assert written in (0, 2), line
            if written == 0:
                leaves_room(load_scenario("x"))
                with Path("x/scenario.toml").open("a", encoding="utf-8") as file:
                    file.write(WIND)
                load_scenario("x")  # refuses a take-off or a landing that is too short
        finally:
            os.chdir(before)


def leaves_room(scenario: Scenario) -> None:
    """Check conditions that every plan needs."""
    limits, flight_s = scenario.limits, scenario.time.flight_s
    if scenario.survey is None:  # a survey that needs more is written with a warning
        assert battery_estimate(scenario).is_enough
    points = route_points(scenario)
    stops = [scenario.start.position_m, *(point.position_m for point in points), scenario.end.position_m]
    legs_s = (np.abs(np.diff(stops, axis=0)) / limits.speed_ned_mps).max(axis=1)
    held_s = sum(point.hold_s or 0.0 for point in points)
    check_schedule(scenario, flight_s)
    changes = made_changes(scenario)
    # A vehicle that changes its place may need the whole speed limit for that.
    assert legs_s.sum() <= ROOM * (flight_s - held_s - sum(change.duration_s for change in changes))
    for leg, seconds in (leg for change in changes for leg in change.legs):
        climb_mps = np.abs(leg.offsets(np.linspace(0.0, 1.0, 201)[:-1], 1)[..., 2]).max() / seconds
        assert climb_mps <= ROOM * limits.speed_ned_mps[2] * (1.0 + 1e-6)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("--count 4 --distance 5000", "take-off to touch-down, about 105% of a battery; one of quad500 lasts 890 s"),
        ("--count 2 --distance 100 --height 600", "with 25% of it in reserve"),
        ("--shape line --height 600", "with 25% of it in reserve"),
        ("--height 500 --distance 4000", "with 25% of it in reserve"),
        ("--at 47.39,8.54,4000 --end 47.42,8.54", "an --end "),
    ],
)
def test_a_battery_that_is_not_enough_is_told_with_what_would_fit(
    line: str, says: str, folder: None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert gcs("new", "far", *line.split()) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert says in told
    assert not Path("far").exists()
    proposed = re.findall(r"--(?:distance|height) \d+", told.split("next: give ")[1])
    if "--end" not in line:
        words = [word for one in proposed for word in one.split()]
        kept = [word for word in re.findall(r"--\S+ \S+", line) if word.split()[0] not in words]
        assert gcs("new", "far", *(part for one in kept for part in one.split()), *words) == 0


def test_a_drawing_that_needs_more_than_a_battery_is_written_with_a_warning(
    folder: None, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = ["QGC WPL 110"] + [
        f"{n} {int(n == 0)} {0 if n == 0 else 3} 16 0 0 0 0 {47.39 + 0.045 * (n > 1)} 8.54 {20 * (n > 0)} 1"
        for n in range(3)
    ]
    Path("far.waypoints").write_text("\n".join(rows).replace(" ", "\t").replace("\t", " ", 2) + "\n", encoding="utf-8")
    assert gcs("new", "far", "--route", "far.waypoints", "--count", "1", "--shape", "line") == 0
    assert load_scenario("far").end.position_m[0] == pytest.approx(5000.0, abs=10.0)
    told = " ".join(capsys.readouterr().out.split())
    assert "% of a battery; one lasts" in told
    assert "the plan will fail verification. To fit, draw about " in told


def test_a_long_flight_is_flown_faster_where_one_battery_is_then_enough(folder: None) -> None:
    assert gcs("new", "long", "--distance", "3000", "--count", "3") == 0
    scenario = load_scenario("long")
    assert scenario.end.position_m[0] == 3000.0
    assert scenario.time.flight_s < 750.0
    assert gcs("new", "short", "--distance", "1000", "--count", "3") == 0
    assert load_scenario("short").time.flight_s == 300.0


def test_how_many_batteries_the_flight_needs_is_printed(folder: None, capsys: pytest.CaptureFixture[str]) -> None:
    assert gcs("new", "five", "--count", "5") == 0
    told = capsys.readouterr().out
    assert "batteries: 5, one for each vehicle; about 13% of it used in 152 s, 25% stays in reserve" in told
    assert gcs("new", "alone", "--count", "1", "--json") == 0
    assert json.loads(capsys.readouterr().out)["battery_share_estimate"] == pytest.approx(0.126, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2))])
@pytest.mark.parametrize("kind", KINDS)
def test_what_new_writes_is_planned_and_verified(
    kind: str, seed: int, folder: None, capsys: pytest.CaptureFixture[str]
) -> None:
    line = options(kind, Random(seed))
    if gcs("new", "x", *line) == 2:
        return  # refused, with what would fit
    capsys.readouterr()
    assert gcs("plan", "x", "--to", "x.skein", "--json") == 0, line
    assert len(json.loads(capsys.readouterr().out)["mesh"]) <= 5
    plan, _ = load_plan(Path("x.skein"))
    estimate = battery_estimate(plan.scenario).share
    assert charge_needed(plan).max() <= estimate <= 1.05 * charge_needed(plan).max()
