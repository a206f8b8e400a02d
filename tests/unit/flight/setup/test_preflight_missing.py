"""Whatever a vehicle does not report: every vehicle has every check, and what is missing is a no-go that is told."""

from __future__ import annotations

import io
import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from gcs.cli.console import Screen, to_json
from gcs.cli.flights.vehicles import _data, _show
from gcs.cli.prompts import checks_table, show_checks
from gcs.errors import FlightError
from gcs.flight.setup.preflight import preflight
from gcs.flight.setup.preflight_check import CHECKS, NOT_REPORTED, checks_data, complete, refuse_no_go, waive
from gcs.frames import ned_to_geodetic
from gcs.link.microservices.timesync import TimeSample
from gcs.link.session.status_report import VehicleReport
from gcs.mission.model import Home
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.si import local_origin

# Every field of a report that may be missing, and the checks that fail without it.
FAILS = {
    "version": (),
    "uid": (),
    "prearm_ok": (),
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
    )  # fmt: skip


def test_every_field_that_may_be_missing_is_listed(simulation1_plan: Plan) -> None:
    optional = {name for name, kind in VehicleReport.__annotations__.items() if "None" in kind}
    assert optional == set(FAILS)


def shown(checks, **how) -> str:
    out = io.StringIO()
    Console(file=out, width=250, **how).print(checks_table(checks))
    return out.getvalue()


def judged(plan: Plan, reports: dict[int, VehicleReport]) -> None:
    """A fleet through pre-flight, the refusal, the table on a terminal and off it, and JSON."""
    checks = preflight(plan, reports)
    assert [(c.sysid, c.name) for c in checks] == list(itertools.product(plan.sysids, CHECKS))
    expected = {
        (sysid, name)
        for sysid in plan.sysids
        for name in CHECKS
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
@given(gone=st.sets(st.tuples(st.integers(0, 5), st.sampled_from(sorted(CHECKS))), max_size=65))
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
