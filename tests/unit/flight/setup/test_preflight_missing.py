"""Whatever a vehicle does not report: every vehicle has every check, and what is missing is a no-go that is told."""

from __future__ import annotations

import io
import itertools
import json
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from gcs.cli.flights.fly_view import checks_table, show_checks
from gcs.cli.flights.vehicles import _data, _say_silent, _show
from gcs.cli.shared.console import Screen, to_json
from gcs.errors import FlightError
from gcs.flight.monitoring.preflight_check import NOT_REPORTED, CheckName, checks_data, complete, refuse_no_go, waive
from gcs.flight.setup.preflight import preflight
from gcs.frames import ned_to_geodetic
from gcs.link.protocols.timesync import TimeSample
from gcs.link.session.status_report import ReportedWind, VehicleReport
from gcs.mission.model import Home
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.si import local_origin

OF_REPORTS = [name for name in CheckName if name is not CheckName.TIMING]  # which is about parameters
# Every field of a report that may be missing, and the checks that fail without it.
FAILS = {
    "version": (),
    "uid": (),
    "prearm_ok": ("can arm",),
    "estimate_ok": ("position estimate",),
    "ailing": ("sensors",),
    "home": ("home",),
    "position": ("pad", "height"),
    "origin": ("local frame",),
    "satellites": (),
    "fix_type": (),
    "battery_share": ("battery",),
    "battery_V": (),
    "loss": (),
    "timesync": ("clock",),
    "working": (),
    "capacity_parameter": (),
    "capacity_mAh": (),
    "wind": (),
}


@pytest.fixture(scope="session")
def field(simulation1_plan: Plan) -> Plan:
    """Without a battery in the scenario: its energy takes long to compute, and nothing here is about it."""
    vehicle = simulation1_plan.scenario.vehicle.model_copy(update={"power": None})
    return replace(simulation1_plan, scenario=simulation1_plan.scenario.model_copy(update={"vehicle": vehicle}))


def full(plan: Plan, row: int) -> VehicleReport:
    """The report of a vehicle that lacks nothing."""
    lat, lon, alt = ned_to_geodetic(np.asarray(plan.pads_ned_m[row]), local_origin(plan.scenario))
    here = Home(float(lat), float(lon), float(alt))
    return VehicleReport(
        sysid=plan.sysids[row], system=plan.sysids[row], where="udp", autopilot="PX4", version="1.17.0", uid="aa",
        mode="HOLD", armed=False, state="standby", prearm_ok=True, estimate_ok=True, ailing=("radio control",),
        home=here, position=here, origin=here, satellites=14, fix_type=3, battery_share=1.0, battery_V=12.4, loss=0.0,
        timesync=TimeSample(5.0, 0.02), heartbeat_age_s=0.3, working=("gyro",), mentioned_sensors=("radio control",),
        capacity_parameter="BAT1_CAPACITY", capacity_mAh=2200.0,
        wind=ReportedWind(0.2, 240.0),
    )  # fmt: skip


def test_every_field_that_may_be_missing_is_listed(simulation1_plan: Plan) -> None:
    optional = {name for name, kind in VehicleReport.__annotations__.items() if "None" in str(kind)}
    assert optional == set(FAILS)


def shown(checks, **how) -> str:
    out = io.StringIO()
    Console(file=out, width=250, **how).print(checks_table(checks))
    return out.getvalue()


def judged(plan: Plan, reports: dict[int, VehicleReport]) -> None:
    """A fleet through pre-flight, the refusal, the table on a terminal and off it, and JSON."""
    checks = preflight(plan, reports)
    assert [(c.sysid, c.name) for c in checks] == list(itertools.product(plan.sysids, OF_REPORTS))
    expected = {
        (sysid, name)
        for sysid in plan.sysids
        for name in OF_REPORTS
        if sysid not in reports
        or any(name in checks for field, checks in FAILS.items() if getattr(reports[sysid], field) is None)
    }
    assert {(c.sysid, c.name) for c in checks if not c.ok} == expected
    for how in ({"force_terminal": True}, {"force_terminal": False}):
        told = shown(checks, **how)
        assert ("NO-GO" in told) == bool(expected)
        assert told.count("FAILED: ") == len(expected)
    data = json.loads(to_json(checks_data(checks)))
    assert {(c["sysid"], c["name"]) for c in data if not c["go"]} == expected
    if expected:
        with pytest.raises(FlightError, match="no-go: "):
            refuse_no_go(checks)
    refuse_no_go(waive(checks, {name for _, name in expected}))
    listed = list(reports.values())
    json.loads(to_json([_data(report) for report in listed]))
    for json_wanted in (False, True):
        _show(Screen(json=json_wanted), listed)
        show_checks(Screen(json=json_wanted), checks)


@settings(max_examples=25, deadline=None)
@given(missing=st.lists(st.none() | st.sets(st.sampled_from(sorted(FAILS))), min_size=6, max_size=6))
def test_whatever_some_vehicles_do_not_report(field: Plan, missing: list[set[str] | None]) -> None:
    """None: no report of this vehicle at all."""
    plan = field
    judged(
        plan,
        {
            sysid: replace(full(plan, row), **dict.fromkeys(gone, None))
            for row, (sysid, gone) in enumerate(zip(plan.sysids, missing, strict=True))
            if gone is not None
        },
    )


@pytest.mark.parametrize("name", sorted(FAILS))
def test_what_one_vehicle_does_not_report(field: Plan, name: str) -> None:
    """The position of one of six: the table had a hole there."""
    plan = field
    reports = {sysid: full(plan, row) for row, sysid in enumerate(plan.sysids)}
    reports[plan.sysids[2]] = replace(reports[plan.sysids[2]], **{name: None})
    judged(plan, reports)


@settings(max_examples=25, deadline=None)
@given(gone=st.sets(st.tuples(st.integers(0, 5), st.sampled_from(sorted(CheckName))), max_size=65))
def test_a_check_that_a_vehicle_lacks_is_a_no_go(field: Plan, gone: set[tuple[int, str]]) -> None:
    plan = field
    every = preflight(plan, {sysid: full(plan, row) for row, sysid in enumerate(plan.sysids)})
    some = tuple(c for c in every if (plan.sysids.index(c.sysid), c.name) not in gone)
    names, sysids = {c.name for c in some}, {c.sysid for c in some}
    holes = {(c.sysid, c.name) for c in every if c.name in names and c.sysid in sysids} - {
        (c.sysid, c.name) for c in some
    }
    assert {(c.sysid, c.name) for c in complete(some) if c.measured == NOT_REPORTED and not c.ok} == holes
    assert ("NO-GO" in shown(some)) == bool(holes)
    if holes:
        with pytest.raises(FlightError, match=NOT_REPORTED):
            refuse_no_go(some)


def test_all_vehicles_that_report_all_go(field: Plan) -> None:
    plan = field
    checks = preflight(plan, {sysid: full(plan, row) for row, sysid in enumerate(plan.sysids)})
    refuse_no_go(checks)
    assert not [c.warning for c in checks if c.warning]
    assert "GO" in shown(checks)


def test_a_warning_of_several_vehicles_is_told_once(simulation1_plan: Plan, capsys: pytest.CaptureFixture[str]) -> None:
    reports = {n: full(simulation1_plan, row) for row, n in enumerate(simulation1_plan.sysids)}
    checks = [replace(c, warning="set it") if c.name == "capacity" else c for c in preflight(simulation1_plan, reports)]
    show_checks(Screen(json=False), tuple(checks))
    said = capsys.readouterr()
    assert (said.out + said.err).count("set it") == 1
    assert "vehicles 1, 2, 3, 4, 5, 6: set it" in said.out + said.err


def on_screen(show: Callable[[Screen], None], columns: int) -> str:
    """What a terminal of this width gets."""
    out, screen = io.StringIO(), Screen()
    screen.console = Console(file=out, width=columns, highlight=False)
    show(screen)
    return out.getvalue()


def words(texts: Iterable[str]) -> set[str]:
    return {word for text in texts for word in text.split()}


@pytest.mark.parametrize("columns", [80, 160])
def test_no_word_of_the_go_no_go_table_is_broken(field: Plan, columns: int) -> None:
    """Six vehicles, one of them without a position: at 80 columns vehicles stand in the cells."""
    reports = {sysid: full(field, row) for row, sysid in enumerate(field.sysids)}
    reports[field.sysids[1]] = replace(reports[field.sysids[1]], position=None)
    checks = preflight(field, reports)
    told = on_screen(lambda screen: show_checks(screen, checks), columns)
    assert max(len(line) for line in told.splitlines() if line[:1] in "│┃┏└") <= columns
    for text in words(text for c in checks for text in (c.name, c.measured, c.required)):
        assert text in told, text
    heading = next(line for line in told.splitlines() if "check" in line)
    assert ("measured" in heading) == (columns == 80)
    if columns == 80:
        assert told.count("2: FAILED: not reported") == 2 and "all: disarmed" in told


@pytest.mark.parametrize("columns", [80, 160])
def test_no_word_of_the_table_of_vehicles_is_broken(field: Plan, columns: int) -> None:
    said = ("PreArm: AHRS: waiting for home", "PreArm: Accelerometers inconsistent")
    reports = [full(field, 0), full(field, 1)]
    reports[0] = replace(
        reports[0], prearm_ok=False, not_ready_texts=said, mode="AUTO_LOITER", where="udpin:127.0.0.1:14550"
    )
    told = on_screen(lambda screen: _show(screen, reports), columns)
    assert max(map(len, told.splitlines())) <= columns
    for text in words((*said, "AUTO_LOITER", "1.17.0", "radio control not healthy", "100%", "12.4 V", "loss", "20 ms")):
        assert text in told, text
    assert (f"{reports[0].home.lat_deg:.6f}" in told if reports[0].home else False) == (columns == 160)
    assert ("udpin:127.0.0.1:14550" in told) == (columns == 160)
    assert list(_data(reports[0])["not_ready_texts"]) == list(said)


def test_a_vehicle_that_told_no_reason_is_named(field: Plan, capsys: pytest.CaptureFixture[str]) -> None:
    silent = [replace(full(field, row), prearm_ok=False) for row in (0, 1)]
    _say_silent(Screen(), silent, 3.0)
    assert capsys.readouterr().out.startswith("vehicles 1, 2 told no reason; some autopilots repeat theirs every 30 s")
    _say_silent(Screen(), silent, 40.0)
    _say_silent(Screen(), [full(field, 0), replace(silent[1], not_ready_texts=("PreArm: x",))], 3.0)
    assert capsys.readouterr().out == ""
