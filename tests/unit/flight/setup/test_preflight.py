"""Go and no-go: every check can fail, and says what was found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.cli.main import run
from gcs.errors import FlightError
from gcs.flight.monitoring.preflight_check import refuse_no_go
from gcs.flight.setup.preflight import preflight
from gcs.frames import ned_to_geodetic
from gcs.link.protocols.timesync import TimeSample
from gcs.link.session.status_report import ReportedWind, VehicleReport
from gcs.mission.model import Home
from gcs.plan.trajectory.energy import charge_needed, energy_Wh
from gcs.plan.verification.wind_envelope import proved_mps, wind_envelope
from gcs.scenario.schema.scenario import Power, PreflightTable
from gcs.scenario.values.si import local_origin


def place(plan, ned_m):
    lat, lon, alt = ned_to_geodetic(np.asarray(ned_m), local_origin(plan.scenario))
    return Home(float(lat), float(lon), float(alt))


@pytest.fixture
def reports(simulation1_plan):
    plan = simulation1_plan
    found = {}
    for row, sysid in enumerate(plan.sysids):
        here = place(plan, plan.pads_ned_m[row])
        found[sysid] = VehicleReport(
            sysid=sysid, system=sysid, where="", autopilot="ArduCopter", version="4.5.6", uid="aa", mode="GUIDED",
            armed=False, state="standby", prearm_ok=True, estimate_ok=True, ailing=(), home=here, position=here,
            origin=here, satellites=14, fix_type=6, battery_share=1.0, battery_V=12.4, loss=0.0,
            timesync=TimeSample(5.0, 0.02), heartbeat_age_s=0.3,
        )  # fmt: skip
    return found


def test_vehicles_on_their_pads_go(simulation1_plan, reports):
    checks = preflight(simulation1_plan, reports)
    assert all(c.ok for c in checks)
    refuse_no_go(checks)
    assert {c.sysid for c in checks} == set(simulation1_plan.sysids)


def moved(plan, row, north_m, down_m=0.0):
    return place(plan, plan.pads_ned_m[row] + np.array([north_m, 0.0, down_m]))


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("disarmed", lambda plan: {"armed": True}),
        ("can arm", lambda plan: {"prearm_ok": False}),
        ("can arm", lambda plan: {"not_ready_texts": ("Preflight Fail: Accel 0 uncalibrated",)}),
        ("position estimate", lambda plan: {"estimate_ok": False}),
        ("position estimate", lambda plan: {"estimate_ok": None}),
        ("sensors", lambda plan: {"ailing": ("compass",)}),
        ("sensors", lambda plan: {"ailing": None}),
        ("messages", lambda plan: {"critical_texts": ("RTL: unsupported MAV_FRAME",)}),
        ("height", lambda plan: {"position": moved(plan, 1, 0.0, -30.0)}),
        ("home", lambda plan: {"home": None}),
        ("home", lambda plan: {"home": moved(plan, 1, 50.0)}),
        ("local frame", lambda plan: {"origin": moved(plan, 1, 6.0)}),
        ("battery", lambda plan: {"battery_share": 0.3}),
        ("battery", lambda plan: {"battery_share": None}),
        ("wind", lambda plan: {"wind": ReportedWind(1.05 * wind_envelope(plan).ok_from(40.0), 40.0)}),
        ("clock", lambda plan: {"timesync": None}),
        ("clock", lambda plan: {"timesync": TimeSample(0.0, 1.5)}),
    ],
)
def test_every_check_can_say_no(simulation1_plan, reports, name, change):
    sysid = simulation1_plan.sysids[1]
    reports[sysid] = replace(reports[sysid], **change(simulation1_plan))
    checks = preflight(simulation1_plan, reports)
    assert [(c.sysid, c.name) for c in checks if not c.ok] == [(sysid, name)]
    with pytest.raises(FlightError, match=f"no-go: vehicle {sysid}: {name}: "):
        refuse_no_go(checks)


def test_a_wind_inside_the_envelope_is_a_go_and_is_shown_beside_it(simulation1_plan, reports):
    sysid, allowed_mps = simulation1_plan.sysids[1], wind_envelope(simulation1_plan).ok_from(40.0)
    reports[sysid] = replace(reports[sysid], wind=ReportedWind(0.95 * allowed_mps, 40.0))
    checks = [c for c in preflight(simulation1_plan, reports) if c.name == "wind"]
    assert all(c.ok for c in checks)
    (told,) = [c.measured for c in checks if c.sysid == sysid]
    assert told == f"{0.95 * allowed_mps:.1f} m/s from 40°, up to {proved_mps(allowed_mps)} m/s from there"
    assert {c.measured for c in checks if c.sysid != sysid} == {"not reported"}
    everywhere_mps = wind_envelope(simulation1_plan).wind_ok_mps
    assert f"up to {proved_mps(everywhere_mps)} m/s from every direction" in checks[0].required


def test_a_vehicle_far_from_its_pad_is_told_by_how_much(simulation1_plan, reports):
    sysid = simulation1_plan.sysids[1]
    far = moved(simulation1_plan, 1, -20.0)
    reports[sysid] = replace(reports[sysid], position=far, home=far)
    (bad,) = [c for c in preflight(simulation1_plan, reports) if not c.ok]
    assert (bad.name, bad.required) == ("pad", "within 3 m")
    assert bad.measured.startswith("20.0")


def test_a_vehicle_far_from_all_pads_is_on_the_pad_of_none(simulation1_plan, reports):
    for row, sysid in enumerate(simulation1_plan.sysids):
        far = moved(simulation1_plan, row, 300.0)
        reports[sysid] = replace(reports[sysid], position=far, home=far)
    pads = [c for c in preflight(simulation1_plan, reports) if c.name == "pad"]
    assert [c.measured for c in pads] == ["300.00 m away"] * len(pads)
    assert not any(c.ok for c in pads)


def test_two_vehicles_on_each_others_pads_are_noticed_as_far_as_their_receivers_can(simulation1_plan, reports):
    first, second = simulation1_plan.sysids[:2]
    one, other = reports[first].position, reports[second].position
    for sysid, there in ((first, other), (second, one)):
        reports[sysid] = replace(reports[sysid], position=there, home=there)
    bad = [c for c in preflight(simulation1_plan, reports) if not c.ok]
    assert {(c.sysid, c.name) for c in bad} >= {(first, "pad"), (second, "pad")}
    assert any(f"on the pad of vehicle {second}" in c.measured for c in bad)


def with_power(plan, power):
    vehicle = plan.scenario.vehicle.model_copy(update={"power": power})
    return replace(plan, scenario=plan.scenario.model_copy(update={"vehicle": vehicle}))


def test_a_battery_nobody_described_lasts_for_the_flight_and_a_reserve(simulation1_plan, reports):
    plan, limits = with_power(simulation1_plan, None), PreflightTable(endurance_s=1200.0, effort=1.0, reserve=0.2)
    duration_s = plan.t_end_s - plan.t_start_s
    assert charge_needed(plan, limits) == pytest.approx(duration_s / 1200.0)
    (first, *_) = [c for c in preflight(plan, reports, limits) if c.name == "battery"]
    assert first.ok
    assert first.measured == f"has 100%, needs {duration_s / 1200.0:.0%}"
    assert first.required == "20% left (20 min of hover assumed: no [vehicle.power])"


@pytest.mark.parametrize(("spare", "ok"), [(0.02, True), (-0.02, False)])
def test_the_plans_own_energy_counts_where_the_vehicle_is_described(simulation1_plan, reports, spare, ok):
    """A battery that ends the flight with its reserve and so much to spare."""
    rotors = {"rotor_radius_m": 0.038, "figure_of_merit": 0.5}
    taken_Wh = float(energy_Wh(with_power(simulation1_plan, Power(battery_Wh=1.0, **rotors))).max())
    plan = with_power(simulation1_plan, Power(battery_Wh=taken_Wh / (0.7 - spare), **rotors))
    checks = [c for c in preflight(plan, reports, PreflightTable(reserve=0.3)) if c.name == "battery"]
    assert [c.ok for c in checks] == [ok] * 6
    assert checks[0].measured.startswith("has 100%, needs ")
    assert checks[0].required.startswith("30% left (need from the plan; ")
    assert checks[0].required.endswith(" Wh in [vehicle.power])")


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--link", "udpin:127.0.0.1:0", "--reserve", "120%"), "--reserve 120%: not a share"),
        (("--link", "udpin:127.0.0.1:0", "--reserve", "a lot"), "--reserve a lot: not a share"),
        (("--sim", "--reserve", "30%"), "--reserve applies to vehicles on a --link only"),
    ],
)
def test_reserves_that_cannot_be_are_refused(repo_root, capsys, arguments, told):
    assert run(["fly", str(repo_root / "missions" / "simulation1"), *arguments]) == 2
    assert told in capsys.readouterr().err
