"""The folder of a campaign: what is left, what another campaign may not touch, and a killed writer."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from gcs.campaign.design import draw, parse_wind
from gcs.campaign.records import INFRASTRUCTURE, PARTS, CampaignFolder
from gcs.errors import FileFormatError, UsageError

ASKED = {"plan_hash": "ab", "version": "1", "campaign": 7}
DESIGN = draw(list(parse_wind("0..6@any")), [], 7, 40)
WRITER = """
import sys
from pathlib import Path
from gcs.campaign.records import CampaignFolder
folder = CampaignFolder(Path(sys.argv[1]))
for row in folder.left():
    folder.add([{"index": row["index"], "outcome": "held", "separation_m": row["wind_mps"]}])
    print(row["index"], flush=True)
"""


def begun(path: Path) -> CampaignFolder:
    folder = CampaignFolder(path / "c")
    folder.begin(ASKED, DESIGN)
    return folder


def row(index: int, outcome: str = "held", **more: Any) -> dict[str, Any]:
    return {"index": index, "outcome": outcome, **more}


def test_left_is_the_design_less_the_results(tmp_path: Path) -> None:
    folder = begun(tmp_path)
    assert folder.design() == folder.left() == DESIGN
    folder.add([row(3), row(1)])
    folder.add([row(2, "aborted", error="vehicle 2 was lost")])  # without the other columns
    folder.add([row(0, separation_m=1.5)])
    assert [one["index"] for one in folder.left()] == list(range(4, 40))
    assert [one["index"] for one in folder.results()] == [0, 1, 2, 3]
    assert folder.results()[0]["separation_m"] == 1.5


def test_a_failure_of_the_machine_flies_again_and_counts_once(tmp_path: Path) -> None:
    folder = begun(tmp_path)
    folder.add([row(0, INFRASTRUCTURE, error="the worker was killed"), row(1, INFRASTRUCTURE)])
    assert folder.left() == DESIGN
    folder.add([row(0, INFRASTRUCTURE), row(0)])
    folder.add([row(0)])
    assert [(one["index"], one["outcome"]) for one in folder.results()] == [(0, "held"), (1, INFRASTRUCTURE)]
    assert folder.left() == DESIGN[1:]


@pytest.mark.parametrize("changed", [{"plan_hash": "cd"}, {"version": "2"}, {"campaign": 8}, {"more": 1}])
def test_another_campaign_is_refused(tmp_path: Path, changed: dict[str, Any]) -> None:
    begun(tmp_path).begin(ASKED, DESIGN)
    with pytest.raises(UsageError, match=f"another {next(iter(changed))}"):
        begun(tmp_path).begin({**ASKED, **changed}, DESIGN)
    with pytest.raises(UsageError, match="another design"):
        begun(tmp_path).begin(ASKED, DESIGN[:-1])


def test_a_folder_of_other_things_stays_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(UsageError, match="other files"):
        CampaignFolder(tmp_path).begin(ASKED, DESIGN)
    assert [file.name for file in tmp_path.iterdir()] == ["notes.txt"]


def test_a_broken_part_is_named(tmp_path: Path) -> None:
    folder = begun(tmp_path)
    folder.add([row(0)])
    (part,) = (folder.path / PARTS).iterdir()
    part.write_bytes(part.read_bytes()[:-20])
    with pytest.raises(FileFormatError, match=part.name):
        folder.results()


def test_a_killed_writer_leaves_what_it_had_and_the_next_ends_the_same_table(tmp_path: Path) -> None:
    folder, line = begun(tmp_path), [sys.executable, "-c", WRITER, str(tmp_path / "c")]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[3])}
    with subprocess.Popen(line, stdout=subprocess.PIPE, env=environment, text=True) as writer:
        assert writer.stdout is not None
        for _ in range(5):
            writer.stdout.readline()
        writer.send_signal(signal.SIGKILL)
    done = len(folder.results())
    assert 5 <= done < 40
    subprocess.run(line, check=True, env=environment, stdout=subprocess.DEVNULL)
    expected = [row(one["index"], separation_m=one["wind_mps"]) for one in DESIGN]
    assert folder.results() == expected
    assert len(list((folder.path / PARTS).iterdir())) == 40
