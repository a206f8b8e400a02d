"""Plans on disk: what is read is what was written, and anything else is refused in one sentence."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gcs.errors import FileFormatError
from gcs.plan.plan_file import is_plan_file, load_plan, read_plan, save_plan
from gcs.plan.trajectory.leg_lines import LegLimits
from gcs.plan.trajectory.phases import Phase
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import Report
from tests.unit.plan.problems import changed
from tests.unit.plan.routed import with_route


@pytest.fixture
def saved(tmp_path: Path, meadow_plan: Plan, meadow_report: Report) -> Path:
    path = tmp_path / "meadow.skein"
    save_plan(meadow_plan, meadow_report, path)
    return path


def rewritten(path: Path, **changes: Any) -> None:
    """The archive with some of its arrays, or keys of its `meta`, replaced; everything else as it was."""
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    meta = json.loads(arrays["meta"].tobytes())
    for name, value in changes.items():
        if name in arrays:
            arrays[name] = value
        else:
            meta[name] = value
    arrays["meta"] = np.frombuffer(json.dumps(meta).encode(), dtype=np.uint8)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    path.write_bytes(buffer.getvalue())


def test_a_plan_comes_back_as_it_was(saved: Path, meadow_plan: Plan, meadow_report: Report) -> None:
    plan, report = load_plan(saved)
    assert plan.hash == meadow_plan.hash
    assert report == meadow_report
    assert plan.scenario == meadow_plan.scenario
    assert plan.phases == meadow_plan.phases
    assert plan.mesh_history == meadow_plan.mesh_history
    assert plan.objective == meadow_plan.objective
    times = np.linspace(plan.t_start_s, plan.t_end_s, 57)
    np.testing.assert_array_equal(plan.states(times), meadow_plan.states(times))
    np.testing.assert_array_equal(plan.controls(times), meadow_plan.controls(times))


def test_the_hash_is_of_everything_that_is_flown_and_of_nothing_else(meadow_plan: Plan) -> None:
    assert replace(meadow_plan, timings_s={"elsewhere": 1.0}, mesh_history=()).hash == meadow_plan.hash
    moved = meadow_plan.leader_trajectory.state.c.copy()
    moved[-1, 0, 0] = np.nextafter(moved[-1, 0, 0], np.inf)
    motion = replace(
        meadow_plan.leader_trajectory,
        state=type(meadow_plan.leader_trajectory.state)(moved, meadow_plan.leader_trajectory.joints_s),
    )
    late = (*meadow_plan.phases[:-1], Phase("landing", meadow_plan.phases[-1].start_s, 99.0))
    others = [
        replace(meadow_plan, leader_trajectory=motion),
        replace(meadow_plan, phases=late),
        replace(meadow_plan, scenario=changed(meadow_plan.scenario, vehicle={"mass_kg": 0.51})),
    ]
    assert len({meadow_plan.hash, *(other.hash for other in others)}) == 4


def test_an_edited_trajectory_is_refused(saved: Path, meadow_plan: Plan) -> None:
    state = meadow_plan.leader_trajectory.state.c.copy()
    state[-1, 3, 0] += 1e-9
    rewritten(saved, state=state)
    with pytest.raises(FileFormatError, match=r"meadow\.skein: the plan was changed after it was written"):
        load_plan(saved)


def test_an_edited_verdict_is_refused(saved: Path) -> None:
    with np.load(saved) as archive:
        report = json.loads(archive["meta"].tobytes())["report"]
    report["window_error_max_m"] = 0.0
    rewritten(saved, report=report)
    with pytest.raises(FileFormatError, match="the plan was changed after it was written"):
        load_plan(saved)


def test_another_format_is_named(saved: Path) -> None:
    rewritten(saved, format=7)
    with pytest.raises(FileFormatError, match=r"plan format 7 is not the \d of this version"):
        load_plan(saved)


def test_what_never_was_a_plan_is_refused(tmp_path: Path, saved: Path) -> None:
    array, archive, folder = tmp_path / "a.npy", tmp_path / "b.npz", tmp_path / "folder"
    np.save(array, np.zeros(3))
    np.savez(archive, x=np.zeros(3))
    folder.mkdir()
    text, empty = tmp_path / "c.skein", tmp_path / "d.skein"
    text.write_text("schema_version = 1\n")
    empty.write_bytes(b"")
    for path in (array, archive, folder, text, empty):
        with pytest.raises(FileFormatError, match=r"not a plan of this program|is a folder, not a file") as caught:
            load_plan(path)
        assert str(path) in caught.value.message
        assert caught.value.hint
    with pytest.raises(FileFormatError, match="there is no such plan"):
        load_plan(tmp_path / "none.skein")


def test_a_plan_is_known_by_its_content(tmp_path: Path, saved: Path) -> None:
    renamed = tmp_path / "plan-of-today.toml"
    renamed.write_bytes(saved.read_bytes())
    assert is_plan_file(renamed)
    assert load_plan(renamed)[0].hash == load_plan(saved)[0].hash
    text = tmp_path / "scenario.toml"
    text.write_text("schema_version = 1\n")
    assert not is_plan_file(text)
    assert not is_plan_file(tmp_path)
    assert is_plan_file(tmp_path / "missing.skein")
    archive = tmp_path / "other"
    with archive.open("wb") as file:
        np.savez(file, meta=np.zeros(3))
    with pytest.raises(FileFormatError, match="not a plan of this program: the archive has no array joints_s"):
        load_plan(archive)
    with pytest.raises(FileFormatError, match="not a plan of this program: its content is no archive"):
        load_plan(text)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_damage_is_refused_or_harmless_but_never_believed(saved: Path, meadow_plan: Plan, data: st.DataObject) -> None:
    whole = saved.read_bytes()
    place = data.draw(st.integers(0, len(whole) - 1))
    damaged = data.draw(
        st.one_of(
            st.integers(0, 255).map(lambda byte: whole[:place] + bytes([byte]) + whole[place + 1 :]),
            st.just(whole[:place]),
            st.binary(min_size=1, max_size=30).map(lambda more: whole[:place] + more + whole[place:]),
        )
    )
    path = saved.with_name("damaged.skein")
    path.write_bytes(damaged)
    try:
        plan, _ = load_plan(path)
    except FileFormatError:
        return
    assert plan.hash == meadow_plan.hash


def test_an_interrupted_write_leaves_the_old_plan(
    saved: Path, meadow_plan: Plan, meadow_report: Report, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = saved.read_bytes()

    def power_cut(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("os.fsync", power_cut)
    with pytest.raises(KeyboardInterrupt):
        save_plan(replace(meadow_plan, objective=0.0), meadow_report, saved)
    assert saved.read_bytes() == before
    assert [path.name for path in saved.parent.iterdir()] == [saved.name]


def test_the_times_of_a_route_come_back_and_wrong_ones_are_refused(
    tmp_path: Path, meadow_plan: Plan, meadow_report: Report
) -> None:
    routed, path = with_route(meadow_plan, {5.0: {"name": "gate"}, 9.25: {}}), tmp_path / "routed.skein"
    save_plan(routed, meadow_report, path)
    read, _ = read_plan(path)
    assert (read.route_s, read.hash) == (routed.route_s, routed.hash)
    for route_s, said in (((5.0,), "it has 1 times for 2 route points"), ((9.0, 5.0), "point 2 before it leaves")):
        save_plan(replace(routed, route_s=route_s), meadow_report, path)
        with pytest.raises(FileFormatError, match=said):
            read_plan(path)


def test_what_a_plan_keeps_of_its_lines_comes_back(tmp_path: Path, meadow_plan: Plan, meadow_report: Report) -> None:
    path, free = tmp_path / "routed.skein", LegLimits(np.inf, np.inf)
    routed = replace(with_route(meadow_plan, {5.0: {}}), leg_limits=(LegLimits(2.0, 1.0, 0.1), free))
    save_plan(routed, meadow_report, path)
    assert read_plan(path)[0].leg_limits == routed.leg_limits
    save_plan(replace(routed, leg_limits=(free,)), meadow_report, path)
    with pytest.raises(FileFormatError, match="limits of 1 legs for 1 route points"):
        read_plan(path)
    save_plan(replace(routed, leg_limits=(free, LegLimits(-1.0, 1.0))), meadow_report, path)
    with pytest.raises(FileFormatError, match="not numbers above 0"):
        read_plan(path)


def test_a_plan_without_a_route_is_written_without_one(saved: Path) -> None:
    with np.load(saved) as archive:
        assert "route_s" not in json.loads(archive["meta"].tobytes())
