"""What counts as no-go: sensors, capacities, critical texts; and what an operator may waive."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from pydantic import ValidationError

from gcs.cli.main import run
from gcs.errors import FlightError, UsageError
from gcs.flight.monitoring.own_battery import nominal_V, own_battery
from gcs.flight.monitoring.preflight_check import CheckName, PreflightCheck, known_checks, refuse_no_go, waive
from gcs.flight.recording.flight_state import FlightState, read_flight_state, write_flight_state
from gcs.flight.setup.preflight import compare_capacity, preflight
from gcs.link.session.status_report import VehicleReport
from gcs.mavlink_names import SENSORS, sensor_names
from gcs.plan.trajectory.energy import charge_needed
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Power, PreflightTable
from tests.unit.flight.setup.test_preflight_missing import full

RC = "radio control"
POWER = Power(battery_Wh=76.96, rotor_radius_m=0.127, figure_of_merit=0.55)


def sensors(plan: Plan, table: PreflightTable, **report: object) -> PreflightCheck:
    one = replace(full(plan, 0), **report)
    return next(c for c in preflight(plan, {one.sysid: one}, table) if c.name == "sensors")


def test_every_bit_of_sys_status_has_a_name_of_its_own() -> None:
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    bits = {value for value in dialect.enums["MAV_SYS_STATUS_SENSOR"] if value.bit_count() == 1}
    assert bits == {1 << bit for bit in range(len(SENSORS))}
    assert len(set(SENSORS)) == len(SENSORS) == 32
    assert sensor_names(0x10000) == (RC,)


@pytest.mark.parametrize(
    ("table", "report", "ok", "told"),
    [
        (PreflightTable(), {}, True, "healthy (mentioned: radio control not healthy)"),
        (PreflightTable(), {"ailing": ()}, True, "healthy"),
        (PreflightTable(), {"ailing": (RC, "compass")}, False, "compass (mentioned: radio control not healthy)"),
        (PreflightTable(required_sensors=(RC,)), {}, False, RC),
        (PreflightTable(required_sensors=(RC,)), {"ailing": ()}, False, "radio control not enabled"),
        (PreflightTable(required_sensors=(RC,)), {"ailing": (), "working": (RC,)}, True, "healthy"),
        (
            PreflightTable(mentioned_sensors=("logging",)),
            {"ailing": ("logging", RC)},
            True,
            "healthy (mentioned: logging, radio control not healthy)",
        ),
    ],
)
def test_the_scenario_says_which_sensors_are_required(
    simulation1_plan: Plan, table: PreflightTable, report: dict[str, object], ok: bool, told: str
) -> None:
    check = sensors(simulation1_plan, table, **report)
    assert (check.ok, check.measured) == (ok, told)


@pytest.mark.parametrize(
    "table",
    [
        {"required_sensors": ("flux capacitor",)},
        {"required_sensors": (RC,), "mentioned_sensors": (RC,)},
        {"reserve": 1.0},
        {"pad_m": 0.0},
        {"effort": 0.9},
    ],
)
def test_tables_that_cannot_be_are_refused(table: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        PreflightTable(**table)  # type: ignore[arg-type]


def test_limits_are_those_of_the_scenario(simulation1_plan: Plan) -> None:
    wide = simulation1_plan.scenario.model_copy(update={"preflight": PreflightTable(pad_m=7.0)})
    plan = replace(simulation1_plan, scenario=wide)
    (pad,) = [c for c in preflight(plan, {1: full(plan, 0)}) if (c.name, c.sysid) == ("pad", 1)]
    assert pad.required == "within 7 m"


def test_a_scenario_without_the_table_is_written_as_before(simulation1_plan: Plan) -> None:
    """Plans of recorded flights keep their hash."""
    assert "preflight" not in simulation1_plan.scenario.model_dump_json()


@pytest.mark.parametrize(
    ("power", "reported_V", "volt"),
    [
        (POWER.model_copy(update={"battery_V": 14.8}), None, 14.8),
        (POWER.model_copy(update={"battery_V": 14.8}), 16.8, 14.8),
        (POWER.model_copy(update={"battery_V": 14.8}), 13.2, 14.8),  # nearly empty
        (POWER.model_copy(update={"battery_V": 14.8}), 12.6, 11.1),  # a charged one of three cells
        (POWER.model_copy(update={"battery_V": 14.8}), 25.2, 22.2),
        (POWER, 16.2, 14.8),
        (POWER, 12.6, 11.1),
        (POWER, 25.2, 22.2),
        (POWER, None, None),
        (POWER, 0.0, None),
    ],
)
def test_the_nominal_voltage(power: Power, reported_V: float | None, volt: float | None) -> None:
    assert nominal_V(power, reported_V) == (None if volt is None else pytest.approx(volt))


def report_of(plan: Plan, **fields: object) -> VehicleReport:
    return replace(full(plan, 0), battery_V=16.2, **fields)


@pytest.mark.parametrize(
    ("name", "own_mAh", "text", "warned"),
    [
        ("BATT_CAPACITY", 5200.0, "5200 mAh", False),
        ("BATT_CAPACITY", 5600.0, "5600 mAh", False),
        ("BATT_CAPACITY", 3300.0, "3300 mAh", True),
        ("BAT1_CAPACITY", -1.0, "not set on board (BAT1_CAPACITY is -1)", False),
        ("BAT1_CAPACITY", float("nan"), "not set on board (BAT1_CAPACITY is nan)", False),
        ("BAT1_CAPACITY", None, "not reported", False),
    ],
)
def test_another_capacity_on_board_is_a_warning(
    simulation1_plan: Plan, name: str, own_mAh: float | None, text: str, warned: bool
) -> None:
    found = compare_capacity(report_of(simulation1_plan, capacity_parameter=name, capacity_mAh=own_mAh), POWER, 0.1)
    assert found.text == text
    assert bool(found.warning) == warned
    if warned:
        assert all(word in found.warning for word in (name, "3300 mAh", "5200 mAh", "76.96 Wh", "14.8 V"))


@pytest.mark.parametrize(("spare", "ok"), [(0.01, True), (-0.01, False)])
def test_the_need_is_told_in_percent_of_the_vehicles_own_battery(
    simulation1_plan: Plan, spare: float, ok: bool
) -> None:
    """Three cells of 11.1 V, so large that the flight ends with its reserve and so much to spare, or less."""
    plan, table = simulation1_plan, PreflightTable()
    power = plan.scenario.vehicle.power
    assert power is not None
    taken_Wh = float(charge_needed(plan, table).max()) * power.battery_Wh
    own_mAh = 1000.0 * taken_Wh / (1.0 - table.reserve - spare) / 11.1
    reports = {s: replace(full(plan, row), capacity_mAh=own_mAh) for row, s in enumerate(plan.sysids)}
    (worst, *_) = sorted((c for c in preflight(plan, reports) if c.name == "battery"), key=lambda c: c.ok)
    assert worst.ok == ok
    assert (
        worst.measured
        == f"has 100%, needs {0.75 - spare:.0%} of {own_mAh * 0.0111:.1f} Wh ({own_mAh:.0f} mAh at 11.1 V)"
    )
    for unset_mAh in (None, 0.0, -1.0, float("nan")):
        assert own_battery(replace(full(plan, 0), capacity_mAh=unset_mAh), power).scale(power) == 1.0


def test_another_capacity_that_is_enough_is_a_warning_alone(simulation1_plan: Plan) -> None:
    reports = {s: replace(full(simulation1_plan, row), capacity_mAh=9000.0)
               for row, s in enumerate(simulation1_plan.sysids)}  # fmt: skip
    checks = preflight(simulation1_plan, reports)
    assert all(c.warning for c in checks if c.name == "capacity")
    refuse_no_go(checks)


def test_a_waived_check_stays_failed_and_lets_the_flight_go(simulation1_plan: Plan) -> None:
    reports = {s: replace(full(simulation1_plan, row), critical_texts=("RTL: unsupported MAV_FRAME",))
               for row, s in enumerate(simulation1_plan.sysids)}  # fmt: skip
    checks = preflight(simulation1_plan, reports)
    with pytest.raises(FlightError, match="messages: RTL: unsupported MAV_FRAME") as failed:
        refuse_no_go(checks)
    assert failed.value.hint.endswith("--waive messages")
    waived = waive(checks, {"messages"})
    refuse_no_go(waived)
    assert [c.ok for c in waived if c.name == "messages"] == [False] * 6
    assert [c.name for c in waived if c.waived] == ["messages"] * 6
    with pytest.raises(FlightError):
        refuse_no_go(waive(checks, {"sensors"}))


def test_checks_are_waived_by_name() -> None:
    assert known_checks(CheckName) == set(CheckName)
    with pytest.raises(UsageError, match="there is no such check") as unknown:
        known_checks(["gps"])
    assert all(name in unknown.value.hint for name in CheckName)
    for proof in ("read-back", "verification"):
        with pytest.raises(UsageError, match="never waived"):
            known_checks(["sensors", proof])


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--link", "udpin:127.0.0.1:0", "--waive", "read-back"), "read-back is never waived"),
        (("--link", "udpin:127.0.0.1:0", "--waive", "gps"), "there is no such check"),
        (("--sim", "--waive", "sensors"), "--waive applies to vehicles on a --link only"),
    ],
)
def test_what_cannot_be_waived_is_refused_before_anything_starts(
    repo_root: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], told: str
) -> None:
    assert run(["fly", str(repo_root / "missions" / "simulation1"), *arguments]) == 2
    assert told in capsys.readouterr().err


def test_the_folder_of_a_flight_keeps_what_was_waived(tmp_path: Path) -> None:
    state = FlightState("field", "ab", ("udpin::1",), {}, "stream", False, "landed", 1.0, 1, waived=("sensors",))
    write_flight_state(tmp_path, state)
    assert read_flight_state(tmp_path) == state
    old = (tmp_path / "flight.json").read_text().replace(',\n  "waived": [\n    "sensors"\n  ]', "")
    assert "waived" not in old
    (tmp_path / "flight.json").write_text(old)
    assert read_flight_state(tmp_path) == replace(state, waived=())
