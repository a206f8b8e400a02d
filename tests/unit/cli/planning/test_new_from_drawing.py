"""`gcs new --route`: the scenario is written, and what is not carried over is printed."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from gcs.cli import main
from gcs.scenario.sources.load import load_scenario

DRAWN = Path(__file__).parents[2] / "mission" / "drawings" / "files"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_drawing_becomes_a_scenario_and_its_losses_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        main.run(["new", "plans/valley", "--route", str(DRAWN / "valley.plan"), "--count", "4", "--shape", "line"]) == 0
    )
    out = capsys.readouterr().out
    assert "6 points, and back to the start" in out
    assert "1 area to stay in, 1 no-fly zone" in out
    assert re.search(r"  item 5 \(DO_SET_ROI\), line [0-9]+: where cameras look is not carried over\n", out)
    scenario = load_scenario("plans/valley")
    assert len(scenario.formation.sysids) == 4
    assert scenario.end.position_m == scenario.start.position_m


def test_one_vehicle_flies_in_no_formation(capsys: pytest.CaptureFixture[str]) -> None:
    one = ["new", "mast", "--route", str(DRAWN / "valley.plan"), "--count", "1", "--spacing", "3"]
    assert main.run(one) == 0
    assert load_scenario("mast").title == "mast: one quadrotor along valley.plan"
    assert "separation_min_m" not in capsys.readouterr().out


def test_the_separation_beside_a_typed_spacing_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    near = ["new", "near", "--route", str(DRAWN / "valley.plan"), "--count", "3", "--spacing", "3"]
    assert main.run(near) == 0
    limit_m = load_scenario("near").limits.separation_min_m
    assert limit_m < 3.0
    assert f"vehicles stand 3 m apart; separation_min_m is {limit_m:g} m, less" in capsys.readouterr().out


def test_programs_get_every_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run(["new", "pond", "--route", str(DRAWN / "pond.kml"), "--at", "47.4,8.5,500", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["scenario"] == "pond/scenario.toml"
    assert [sentence.partition(":")[0] for sentence in result["left_out"]] == [
        'Placemark 3 ("Far away"), line 24',
        'Placemark 5 ("Barn"), line 40',
    ]
    assert load_scenario("pond").origin.alt_amsl_m == 500.0


@pytest.mark.parametrize(
    ("options", "code", "reason"),
    [
        (["--route", "no.kml"], 6, "no.kml: No such file"),
        (["--route", str(DRAWN / "pond.kml"), "--course", "north"], 2, "--route and --course exclude each other"),
        (["--route", str(DRAWN / "pond.kml"), "--full"], 2, "--route and --full exclude each other"),
        (["--route", str(DRAWN / "pond.kml"), "--at", "47.4,8.5,600"], 6, "is -80.0 m above the origin"),
    ],
)
def test_what_makes_no_route_writes_nothing(
    options: list[str], code: int, reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.run(["new", "drawn", *options]) == code
    assert reason in capsys.readouterr().err.replace("\n", " ")
    assert not Path("drawn").exists()
