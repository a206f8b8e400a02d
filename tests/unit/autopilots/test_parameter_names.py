"""Names of parameters in ArduCopter 4.6 and 4.7: as published, and as a vehicle was recorded that has some of both."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.autopilots.columns import ReturnSettings
from gcs.autopilots.parameter_names import (
    has_new_names,
    in_units_of,
    reason_for,
    spellings,
    system_id_names,
    with_new_names,
)
from gcs.autopilots.traits import Autopilot
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.parameter_transfer import Parameter, ParameterReader
from gcs.link.wire.message import Message, Station
from sim_bridge.personality import by_name

COPTER, PX4 = int(Autopilot.ARDUPILOT), int(Autopilot.PX4)
RENAMING = Autopilot.ARDUPILOT.traits.link.renaming
OLD, NEW, NEW_DEV = (4 << 24 | 6 << 16 | 255), (4 << 24 | 7 << 16 | 255), 67567616

# From the parameter list of ArduCopter 4.7.0-dev (October 2025), flight_sw_version 67567616: name, value, type.
RECORDED = [
    ("RTL_ALT", 1500.0, 6),
    ("RTL_SPEED", 0.0, 4),
    ("RTL_ALT_FINAL", 0.0, 4),
    ("RTL_CLIMB_MIN", 0.0, 4),
    ("LAND_SPEED", 50.0, 4),
    ("PILOT_SPEED_UP", 250.0, 4),
    ("ANGLE_MAX", 3000.0, 4),
]


def test_a_version_decides_which_names_are_requested() -> None:
    assert spellings(COPTER, "RTL_ALT", OLD) == ("RTL_ALT",)
    assert spellings(COPTER, "RTL_ALT", NEW) == ("RTL_ALT_M", "RTL_ALT")
    assert spellings(COPTER, "RTL_ALT_M", OLD) == ("RTL_ALT",)
    assert spellings(COPTER, "LAND_SPEED") == ("LAND_SPEED", "LAND_SPD_MS")
    assert spellings(COPTER, "RTL_LOIT_TIME", NEW) == ("RTL_LOIT_TIME",)
    assert spellings(PX4, "RTL_ALT") == ("RTL_ALT",)
    assert spellings(99, "RTL_ALT") == ("RTL_ALT",)


def test_names_are_those_of_the_wire_and_each_stands_once() -> None:
    assert RENAMING is not None
    names = [name for row in RENAMING.names for name in (row.old, row.new)]
    assert len(set(names)) == len(names)
    assert all(len(name) <= 16 for name in names)


def test_what_an_upload_sets_has_a_name_in_4_7() -> None:
    """The renamed ones among RTL_*, WPNAV_* and FENCE_*, as the release notes of 4.7 list them."""
    old = {"RTL_ALT", "RTL_ALT_FINAL", "RTL_CLIMB_MIN", "RTL_SPEED", "WPNAV_SPEED_UP", "WPNAV_SPEED_DN"}
    new = {"RTL_ALT_M", "RTL_ALT_FINAL_M", "RTL_CLIMB_MIN_M", "RTL_SPEED_MS", "WP_SPD_UP", "WP_SPD_DN"}
    assert {spellings(COPTER, name, NEW)[0] for name in old} == new


@given(st.integers(0, 30_000))
def test_centimetres_are_exact_under_either_name(value_cm: int) -> None:
    value_m = in_units_of(COPTER, "RTL_ALT_M", "RTL_ALT", value_cm)
    assert value_m == pytest.approx(value_cm / 100, abs=1e-9)
    assert in_units_of(COPTER, "RTL_ALT", "RTL_ALT_M", value_m) == value_cm


def test_one_unit_keeps_the_value_and_its_type() -> None:
    assert in_units_of(COPTER, "MAV_SYSID", "SYSID_THISMAV", 3) == 3
    assert isinstance(in_units_of(COPTER, "MAV_SYSID", "SYSID_THISMAV", 3), int)
    assert in_units_of(COPTER, "RTL_ALT", "RTL_ALT", 1500) == 1500
    assert in_units_of(PX4, "RTL_ALT_M", "RTL_ALT", 1500) == 1500


def test_a_file_has_both_names() -> None:
    values = with_new_names(COPTER, (("RTL_ALT", 4523), ("RTL_LOIT_TIME", 5000)))
    assert values == (("RTL_ALT", 4523), ("RTL_LOIT_TIME", 5000), ("RTL_ALT_M", 45.23))
    assert has_new_names(COPTER, dict(values))
    assert not has_new_names(COPTER, ["RTL_ALT"])
    assert with_new_names(PX4, (("RTL_RETURN_ALT", 30.0),)) == (("RTL_RETURN_ALT", 30.0),)


def test_the_system_id_has_a_parameter_on_both() -> None:
    assert system_id_names() == "SYSID_THISMAV or MAV_SYSID on ArduCopter, MAV_SYS_ID on PX4"


@pytest.mark.parametrize("version", [None, NEW_DEV])
def test_a_development_build_answers_for_the_names_that_it_has(version: int | None) -> None:
    """4.7.0-dev reports version 4.7.0; of the new names its source tree had MAV_SYSID only."""
    there = {name: (value, kind) for name, value, kind in RECORDED} | {"MAV_SYSID": (1.0, 4)}
    found = _read([*(name for name, _, _ in RECORDED), "SYSID_THISMAV"], there, version)
    assert found["RTL_ALT"] == Parameter("RTL_ALT", 1500, 6)
    assert found["SYSID_THISMAV"] == Parameter("MAV_SYSID", 1, 4)
    assert {p.name for p in found.values()} == set(there)


def test_the_emulated_4_7_has_the_new_names_and_the_same_settings() -> None:
    older, newer = by_name("ardupilot"), by_name("ardupilot-4.7")
    there = {p.name: (p.value, p.kind) for p in newer.params}
    assert RENAMING is not None
    assert not {row.old for row in RENAMING.names} & set(there)
    for before, after in zip(older.params, newer.params, strict=True):
        assert after.value * after.unit == pytest.approx(before.value * before.unit)
        assert (after.low * after.unit, after.sets) == (pytest.approx(before.low * before.unit), before.sets)
    found = _read(["RTL_ALT", "WPNAV_SPEED_DN", "FENCE_ENABLE"], there, newer.version)
    assert [p.name for p in found.values()] == ["RTL_ALT_M", "WP_SPD_DN", "FENCE_ENABLE"]
    assert found["RTL_ALT"].value == pytest.approx(15.0)


def _read(names: list[str], there: dict[str, tuple[float, int]], version: int | None) -> dict[str, Parameter]:
    """Read parameters from a vehicle that has these names only, and is silent about all others."""
    reader = ParameterReader(names, Exchange(Station(1, 1), COPTER), version=version)
    out = reader.start(0.0)
    for _ in range(100):
        if not out:
            break
        name = str(out.pop(0).fields["param_id"])
        if name in there:
            value, kind = there[name]
            fields = {"param_id": name, "param_value": value, "param_type": kind}
            out += reader.receive(Message("PARAM_VALUE", {**fields, "param_index": 65535, "param_count": 9}, 1, 1), 0.1)
    assert reader.done
    assert reader.error is None
    return reader.values


@pytest.mark.parametrize("known", list(Autopilot))
def test_the_operator_is_told_why_an_upload_sets_each_parameter(known: Autopilot) -> None:
    settings = ReturnSettings(15.0, 5.0, 1.5, 1.5, 5.0, 38.0, 15.0)
    names = [name for name, _ in known.traits.returns.parameters(settings)]
    for name in names:
        for spelling in spellings(known, name):
            assert 0 < len(reason_for(known, spelling)) <= 35, "it stands in a table of 80 columns"
    assert reason_for(known, "SYSID_THISMAV") == reason_for(99, names[0]) == ""
