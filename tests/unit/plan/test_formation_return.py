"""Returns of a whole formation: where they begin and end, what they keep, and how they are kept in a plan file."""

import io
import json
import zipfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gcs.cli.main import run
from gcs.errors import FileFormatError, OutOfTime, PlanningError, UsageError
from gcs.plan import formation_return, prepared_returns
from gcs.plan.formation_return import _duration_s, plan_return
from gcs.plan.plan_file import ARRAYS, load_returns, read_plan, save_plan, stored_returns, write_plan
from gcs.plan.planner import make_plan
from gcs.plan.prepared_returns import PreparedReturn, PreparedReturns, prepare_returns
from gcs.plan.trajectory.constraint_id import Kind
from gcs.plan.trajectory.energy import battery_model, charge_needed
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.scenario.schema.scenario import Power
from gcs.scenario.sources.load import load_scenario
from gcs.util import long_work
from gcs.util.long_work import within

SAME = 1e-9
NAMES = ("field", "simulation1", "terminal_weighting", "circuit", "changes", "simulation2")
QUICK = ("terminal_weighting",)  # the others take minutes


@pytest.fixture(scope="module")
def plan() -> Plan:
    """One vehicle over flat ground: the cheapest of the bundled plans, with a battery."""
    scenario = load_scenario(Path("missions/terminal_weighting"))
    power = Power(battery_Wh=40.0, rotor_radius_m=0.06, figure_of_merit=0.5)
    vehicle = scenario.vehicle.model_copy(update={"power": power})
    return make_plan(scenario.model_copy(update={"vehicle": vehicle}))


@pytest.fixture(scope="module")
def home(plan: Plan) -> Plan:
    """The return from its middle."""
    return plan_return(plan, 120.0)


def continues(plan: Plan, home: Plan, t_s: float) -> None:
    """Position, velocity and acceleration of all vehicles go on."""
    at_s = np.array([t_s])
    assert home.t_start_s == t_s
    np.testing.assert_allclose(home.states(at_s)[..., :6], plan.states(at_s)[..., :6], rtol=0.0, atol=SAME)
    np.testing.assert_allclose(home.accelerations(at_s), plan.accelerations(at_s), rtol=0.0, atol=1e-3)


def lands_on_pads(plan: Plan, home: Plan) -> None:
    """Every pad gets one vehicle."""
    ends = home.states(np.array([home.t_end_s]))[:, 0, :3]
    distances = np.linalg.norm(ends[:, None] - plan.pads_ned_m[None], axis=2)
    assert distances.min(axis=1).max() < 1e-3
    assert len(set(distances.argmin(axis=1).tolist())) == len(ends)


def test_a_return_begins_as_the_plan_flies_and_lands_on_the_pads(plan: Plan, home: Plan) -> None:
    continues(plan, home, 120.0)
    lands_on_pads(plan, home)
    assert verify(home).ok


def test_what_the_plan_took_from_the_battery_counts(plan: Plan, home: Plan) -> None:
    battery = battery_model(plan)
    expected = np.interp(120.0, battery.t_s, battery.used[0])
    assert home.used_before == pytest.approx((expected,))
    (check,) = [each for each in verify(home).checks if each.constraint.kind is Kind.BATTERY]
    left = 1.0 - plan.scenario.preflight.reserve - expected - charge_needed(home)[0]
    assert check.worst == pytest.approx(left)
    empty = replace(home, used_before=(0.9,))
    assert [each.constraint.kind for each in verify(empty).failures] == [Kind.BATTERY]


def test_without_enough_battery_there_is_no_return(plan: Plan) -> None:
    power = plan.scenario.vehicle.power
    assert power is not None
    used = float(charge_needed(plan)[0])
    small = power.model_copy(update={"battery_Wh": power.battery_Wh * used / (1.0 - plan.scenario.preflight.reserve)})
    vehicle = plan.scenario.vehicle.model_copy(update={"power": small})
    tired = replace(plan, scenario=plan.scenario.model_copy(update={"vehicle": vehicle}))
    with pytest.raises(PlanningError, match=r"from t = 290 s.*battery"):
        plan_return(tired, 290.0)


@pytest.mark.parametrize("t_s", [-10.0, 310.0])
def test_over_the_pads_and_in_the_landing_there_is_no_return(plan: Plan, t_s: float) -> None:
    with pytest.raises(UsageError, match="in the air"):
        plan_return(plan, t_s)


def test_a_return_of_a_return(plan: Plan, home: Plan) -> None:
    again = plan_return(home, 130.0)
    continues(home, again, 130.0)
    lands_on_pads(plan, again)
    assert again.used_before[0] > home.used_before[0]


def test_the_next_return_ahead_is_the_one_that_begins(plan: Plan, home: Plan) -> None:
    table = PreparedReturns(
        (PreparedReturn(110.0, home), PreparedReturn(120.0, None, "no way"), PreparedReturn(130.0, home))
    )
    begins = {t_s: table.at(t_s) for t_s in (0.0, 110.0, 110.1, 130.0, 130.1)}
    found = [None if one is None else one.begins_s for one in begins.values()]
    assert found == [110.0, 110.0, 130.0, 130.0, None]
    assert table.longest_wait_s == 20.0
    with pytest.raises(ValueError, match="no way"):
        _ = table.returns[1].duration_s


def test_a_plan_file_keeps_returns_where_older_versions_pass_over_them(plan: Plan, home: Plan, tmp_path: Path) -> None:
    file, bare = tmp_path / "with.skein", tmp_path / "bare.skein"
    rows = PreparedReturn(120.0, home, cpu_s=2.0), PreparedReturn(200.0, None, "no way")
    save_plan(plan, verify(plan), file, PreparedReturns(rows))
    save_plan(plan, verify(plan), bare)
    loaded = load_returns(file)
    assert [(one.begins_s, one.why_not, one.cpu_s) for one in loaded.returns] == [
        (120.0, "", 2.0),
        (200.0, "no way", 0),
    ]
    assert loaded.returns[0].plan is not None
    assert loaded.returns[0].plan.content == home.content
    assert load_returns(bare).returns == ()
    again = tmp_path / "again.skein"  # the folder of a flight keeps them without verifying them
    write_plan(plan, verify(plan), again, stored_returns(file))
    assert [one.plan and one.plan.content for one in load_returns(again).returns] == [home.content, None]
    assert stored_returns(bare).rows == ()
    # Older versions read these arrays alone, and of the first no key that they do not know.
    assert {name.removesuffix(".npy") for name in zipfile.ZipFile(file).namelist()} == set(ARRAYS)
    old, new = (json.loads(np.load(each)["meta"].tobytes()) for each in (bare, file))
    assert {key: new[key] for key in old} == old
    assert set(new) - set(old) == {"returns"}
    assert read_plan(file)[0].content == plan.content


def test_a_return_of_another_plan_is_none(plan: Plan, home: Plan, tmp_path: Path) -> None:
    file = tmp_path / "with.skein"
    save_plan(plan, verify(plan), file, PreparedReturns((PreparedReturn(60.0, home),)))
    (one,) = load_returns(file).returns
    assert one.plan is None
    assert "not a return of this plan" in one.why_not


def test_a_damaged_return_is_refused(plan: Plan, home: Plan, tmp_path: Path) -> None:
    file = tmp_path / "with.skein"
    save_plan(plan, verify(plan), file, PreparedReturns((PreparedReturn(120.0, home),)))
    arrays = dict(np.load(io.BytesIO(file.read_bytes())))
    meta = json.loads(arrays["meta"].tobytes())
    meta["returns"][0]["plan"] = "AAAA" + meta["returns"][0]["plan"][4:]
    from gcs.plan.plan_file import _checksum

    arrays["meta"] = np.frombuffer(json.dumps(meta).encode(), dtype=np.uint8)
    del arrays["checksum"]
    np.savez_compressed(file.open("wb"), **arrays, checksum=_checksum(arrays))
    with pytest.raises(FileFormatError, match="return"):
        load_returns(file)


def test_returns_are_prepared_along_the_plan(plan: Plan) -> None:
    seen: list[float] = []
    table = prepare_returns(plan, 160.0, lambda one: seen.append(one.begins_s))
    assert seen == [one.begins_s for one in table.returns] == [-5.0, 155.0]
    assert all(one.plan is not None for one in table.returns)
    with pytest.raises(UsageError, match="0 s"):
        prepare_returns(plan, 0.0)


def test_instants_beyond_a_time_limit_say_so(plan: Plan) -> None:
    with within(0.0):
        table = prepare_returns(plan, 160.0)
    assert [one.plan for one in table.returns] == [None, None]
    assert all("the time limit has passed" in one.why_not for one in table.returns)


def test_the_command_says_that_its_time_was_over(
    plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    save_plan(plan, verify(plan), tmp_path / "one.skein")
    clock = [0.0]
    monkeypatch.setattr(long_work, "time", SimpleNamespace(monotonic=lambda: clock[0]))

    def late(*given: Any) -> PreparedReturns:
        clock[0] += 61.0
        return prepare_returns(*given)

    monkeypatch.setattr(prepared_returns, "prepare_returns", late)
    assert run(["returns", str(tmp_path / "one.skein"), "--every", "160", "--limit", "60"]) == 0
    told = capsys.readouterr()
    assert "returns: 0 of 2 verified" in told.out
    assert "the time limit passed before all returns were planned. Give more (--limit)" in told.out


def test_a_return_that_runs_out_of_time_is_not_taken_for_one_without_a_way(
    plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    tries: list[int] = []

    def late(*_: object, **__: object) -> None:
        tries.append(1)
        raise OutOfTime.because("solving")

    monkeypatch.setattr(formation_return, "optimise", late)
    with pytest.raises(OutOfTime, match="no return of the formation from t = 120 s: the time limit has passed"):
        plan_return(plan, 120.0)
    assert tries == [1]


def test_a_return_from_long_before_t0_ends_after_it(plan: Plan) -> None:
    """A scenario, and so a plan file, has no flight that ends before T0."""
    assert plan.t_start_s + _duration_s(plan, plan.t_start_s, 0.0, 1.0) > 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.long) for name in NAMES]
)
def test_from_ten_random_instants_of_a_mission(name: str) -> None:
    """Late in a long flight the battery may not last for the way home: then the refusal says so."""
    plan, empty = make_plan(load_scenario(Path(f"missions/{name}"))), []
    for t_s in np.random.default_rng(7).uniform(plan.airborne_s, plan.landing_s - 1.0, 10).tolist():
        try:
            home = plan_return(plan, t_s)
        except PlanningError as refusal:
            assert "battery at the last touch-down" in refusal.message
            empty.append(t_s)
            continue
        continues(plan, home, t_s)
        lands_on_pads(plan, home)
        assert verify(home).ok
        flown_s = np.linspace(t_s, home.t_end_s, 500)
        assert home.zone_distances_m(flown_s).min() > 0.0
    assert not empty or min(empty) > 0.5 * plan.landing_s
