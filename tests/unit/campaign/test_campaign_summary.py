"""The report of a campaign: strata, quantiles, effects and the worst flights of a folder, and how it is shown."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from gcs.campaign.campaign_options import CampaignOptions
from gcs.campaign.campaign_summary import summarise
from gcs.campaign.design import draw, parse_fault
from gcs.campaign.records import CampaignFolder
from gcs.cli.main import run

FLIGHTS = 60


def campaign(path: Path, ended: int, until: str | None = None) -> CampaignFolder:
    """Flights with much wind come near each other; one with a fault is aborted; the machine fails the last one."""
    asked = CampaignOptions(FLIGHTS, 7, "0..6@any", "light,moderate", faults=("20%:1:die@10",), until=until)
    rows = draw(asked.factors, asked.fault_factors((1, 2), 50.0), asked.seed, asked.flights)
    folder = CampaignFolder(path)
    record = {"mission": "field", "flights": FLIGHTS, "seed": 7, "until": until, "plan_hash": "ab"}
    folder.begin(record, rows)
    results = []
    for row in rows[:ended]:
        result = {"index": row["index"], "outcome": "held", "reason": ""}
        if row["fault1"]:
            result |= {"outcome": "aborted", "reason": "vehicle 1 was lost"}
        else:
            margin = 4.0 - float(row["wind_mps"])
            result |= {"outcome": "held" if margin >= 0.0 else "failed", "reason": "separation" if margin < 0 else ""}
            result |= {"separation_m": margin + 1.0, "separation_m_margin": margin}
            result |= {"arrival_time_s": math.inf if margin < 0 else 0.1, "arrival_time_s_margin": -math.inf}
        results.append(result)
    results[-1] = {"index": results[-1]["index"], "outcome": "infrastructure", "reason": "killed"}
    folder.add(results[: ended // 2])
    folder.add(results[ended // 2 :])
    return folder


def test_a_report_under_way_shows_what_has_ended(tmp_path: Path) -> None:
    found = summarise(campaign(tmp_path / "c", 40), None)
    counts = found.outcomes
    assert counts.total() == 40
    assert counts["infrastructure"] == 1
    assert not found.complete
    every = found.strata[0]
    assert (every.flights, every.held) == (39, counts["held"])  # a failure of the machine says nothing of the plan
    for factor in ("wind_mps", "gusts", "fault1"):
        mine = [one for one in found.strata if one.factor == factor]
        assert sum(one.flights for one in mine) == 39
        assert sum(one.held for one in mine) == counts["held"]
    wind = [one for one in found.strata if one.factor == "wind_mps"]
    assert wind[0].held > 0
    assert wind[-1].held == 0
    effect = next(one for one in found.effects if (one.factor, one.figure) == ("wind_mps", "separation_m"))
    assert effect.correlation.value == pytest.approx(-1.0)
    separation = next(one for one in found.figures if one.name == "separation_m")
    design = CampaignFolder(tmp_path / "c").design()
    flown = [row for row in design[:39] if not row["fault1"]]
    assert separation.worst[0] == max(flown, key=lambda row: row["wind_mps"])["index"]
    assert separation.flights == len(flown)


def test_the_effect_of_words_is_told(tmp_path: Path) -> None:
    fault = parse_fault("80%:all:slow-down=at-once|late", 1, (1, 2), 50.0)
    rows = draw([], [fault], 7, FLIGHTS)
    folder = CampaignFolder(tmp_path / "c")
    folder.begin({"mission": "circuit"}, rows)
    near = [2.0 if row["fault1_value"] == "late" else 3.0 for row in rows]
    folder.add({"index": n, "outcome": "held", "separation_m": m, "separation_m_margin": m} for n, m in enumerate(near))
    effects = {(one.factor, one.figure): one.correlation.value for one in summarise(folder, None).effects}
    assert effects["fault1_value", "separation_m"] == pytest.approx(-1.0)


def test_flights_after_the_one_that_suffices_do_not_count(tmp_path: Path) -> None:
    whole = summarise(campaign(tmp_path / "a", FLIGHTS, "35%"), 0.35)
    part = summarise(campaign(tmp_path / "b", 50, "35%"), 0.35)
    assert whole.complete
    assert part.complete
    assert whole.not_counted > part.not_counted > 0
    assert whole.data()["pass_rates"] == part.data()["pass_rates"]


def test_the_command_prints_tables_and_a_picture_or_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    campaign(tmp_path / "c", 40)
    assert run(["campaign", "report", str(tmp_path / "c")]) == 0
    text = capsys.readouterr().out
    assert "40 of 60 flights" in text
    assert "Clopper-Pearson" in text
    assert (tmp_path / "c" / "effects.png").read_bytes().startswith(b"\x89PNG")
    assert run(["campaign", "report", str(tmp_path / "c"), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["outcomes"]["infrastructure"] == 1
    assert said["pass_rates"][0]["rate"]["low"] > 0.0


def test_a_campaign_without_results_has_a_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = CampaignFolder(tmp_path / "c")
    folder.begin({"mission": "field", "flights": 2}, draw([], [], 1, 2))
    assert run(["campaign", "report", str(tmp_path / "c")]) == 0
    assert "none has ended" in capsys.readouterr().out
    assert run(["campaign", "report", str(tmp_path)]) != 0
