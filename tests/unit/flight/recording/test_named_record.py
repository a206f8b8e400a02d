"""`record.parquet` and `truth.npz` by the names that docs/python.md gives them, on a flight of real autopilots."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import gcs
from gcs.cli.main import run
from gcs.errors import FileFormatError
from gcs.flight.assessment import judge
from gcs.flight.recording.named_record import FlightReports, load_record
from gcs.physics.quadrotor import POSITION
from tests.real_flights import Flight, unpacked
from tests.unit.test_readme import BLOCKS


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recorded flight with its report; its true states are made up: half a metre above the plan."""
    found = unpacked("arducopter-4.5.6-stream", tmp_path_factory.mktemp("flight"))
    assert run(["report", str(found)]) == 0
    flight = Flight(found)
    plan, t_s = flight.plan, np.arange(0.0, 20.0, 0.5)
    states = plan.states(t_s)
    states[..., 2] -= 0.5
    count = len(plan.sysids), len(t_s)
    with (found / "truth.npz").open("wb") as file:
        np.savez(
            file,
            t_s=t_s,
            t_unix_s=t_s + flight.t0_unix_s,
            state=states,
            control=np.zeros((*count, 4)),
            armed=np.ones(count, dtype=bool),
            flying=np.ones(count, dtype=bool),
            mode=np.zeros(count, dtype=np.int64),
            sysid=np.array(plan.sysids),
            boot_offset_s=np.zeros(len(plan.sysids)),
        )
    return found


@pytest.mark.slow
def test_the_program_of_the_page_runs_on_a_flight(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (block,) = (b for b in BLOCKS["docs/python.md"] if "load_record" in b.code)
    code, count = re.subn(r'Path\("flights/[^"]+"\)', f"Path({str(folder)!r})", block.code)
    assert count == 1
    exec(compile(code, "docs/python.md", "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines[:-1]] == [f"vehicle {n}" for n in range(1, 7)]
    assert re.fullmatch(r"truly at least \d+\.\d\d m from no-fly zones", lines[-1])


def test_columns_by_name(folder: Path) -> None:
    reports = load_record(folder)
    assert reports.sysids == (1, 2, 3, 4, 5, 6)
    one = reports.of(3)
    assert set(one.sysid.tolist()) == {3}
    assert np.array_equal(one.position_ned_m[:, 0], one.column("north_m"))
    assert np.array_equal(one.planned_velocity_ned_mps[:, 2], one.column("planned_v_down_mps"), equal_nan=True)
    assert one.error_m == pytest.approx(
        np.linalg.norm(one.position_ned_m - one.planned_position_ned_m, axis=1), nan_ok=True
    )
    assert one.velocity_ned_mps.shape == one.position_ned_m.shape == (len(one.t_s), 3)
    assert len(one.formation_error_m) == len(one.t_s)
    with pytest.raises(KeyError, match="vehicle 9 has no row; those with one are 1, 2, 3"):
        reports.of(9)
    with pytest.raises(KeyError, match="'north' is no column; there are t_s, sysid"):
        reports.column("north")


def test_true_states_by_name(folder: Path) -> None:
    truth, flight = gcs.load_truth(folder), Flight(folder)
    t_s = truth.t_s(flight.t0_unix_s)
    assert t_s == pytest.approx(np.arange(0.0, 20.0, 0.5), abs=1e-6)
    planned = flight.plan.states(np.arange(0.0, 20.0, 0.5))[..., POSITION]
    assert truth.named.height_m == pytest.approx(-planned[..., 2] + 0.5)
    assert np.array_equal(gcs.load_truth(str(folder / "truth.npz")).states, truth.states)


def test_a_folder_without_a_report_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError) as caught:
        load_record(tmp_path)
    assert caught.value.hint == "write it with `gcs report FOLDER`"


def test_the_page_has_every_column_and_accessor(folder: Path, repo_root: Path) -> None:
    page = (repo_root / "docs" / "python.md").read_text(encoding="utf-8")
    tables = [line for line in page.splitlines() if line.startswith("|")]
    named = set(re.findall(r"`(\w+)`", "\n".join(line.split("|")[1] for line in tables)))
    assert named == set(load_record(folder).table.column_names) | set(judge._TRUTH)
    for kind in (FlightReports, judge.Truth):
        for name, thing in vars(kind).items():
            assert not isinstance(thing, property) or f"`{name}`" in page, name
