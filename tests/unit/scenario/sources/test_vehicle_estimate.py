"""Vehicle files from mass, propellers and battery: they load, and hover as long as published aircraft do."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.errors import UsageError
from gcs.scenario.schema.vehicle_types import VehicleFile, preset_file
from gcs.scenario.sources.load import load_vehicle
from gcs.scenario.sources.vehicle_estimate import INCH_M, BatteryPack, KnownVehicle, parse_battery, vehicle_text


def loaded(folder: Path, known: KnownVehicle, name: str = "five") -> VehicleFile:
    file = folder / "vehicle.toml"
    file.write_text(vehicle_text(name, known), encoding="utf-8")
    return load_vehicle(file)


# Data sheets of their maker: mass with battery, energy, propellers (first digits: inches), longest hover without wind.
# Mavic Pro 734 g, 43.6 Wh, 8330, 24 min; Mavic 2 Pro 907 g, 59.29 Wh, 8743, 29 min; Mavic 3 895 g, 77 Wh, 9453, 40 min;
# Mavic Air 430 g, 27.43 Wh, 5332, 20 min; Spark 300 g, 16.87 Wh, 4730, 15 min; Mini 2 242 g, 17.32 Wh, 4726, 31 min
# of flight.
@pytest.mark.parametrize(
    ("mass_kg", "battery_Wh", "inches", "hovers_min"),
    [
        (0.734, 43.6, 8.3, 24.0),
        (0.907, 59.29, 8.7, 29.0),
        (0.430, 27.43, 5.3, 20.0),
        (0.300, 16.87, 4.7, 15.0),
        (0.242, 17.32, 4.7, 31.0),
        (0.895, 77.0, 9.4, 40.0),
    ],
)
def test_published_aircraft_hover_within_the_estimate(
    mass_kg: float, battery_Wh: float, inches: float, hovers_min: float
) -> None:
    low_s, high_s = KnownVehicle(mass_kg, 0.5 * inches * INCH_M, BatteryPack(battery_Wh)).hover_s
    assert low_s <= 60.0 * hovers_min <= high_s


def test_quad500_is_estimated_as_it_is(tmp_path: Path) -> None:
    """Inertia, moments and thrust of the preset are within the ranges that the file states."""
    preset = load_vehicle(preset_file("quad500")).vehicle
    assert preset.power is not None
    known = KnownVehicle(
        preset.mass_kg, preset.power.rotor_radius_m, BatteryPack(preset.power.battery_Wh), preset.arm_m, 0.5
    )
    ours = loaded(tmp_path, known).vehicle
    for estimate, own in zip(ours.inertia_kgm2, preset.inertia_kgm2, strict=True):
        assert 0.7 <= own / estimate <= 1.4
    arms = ours.moment_coeff_Nms2 / ours.thrust_coeff_Ns2, preset.moment_coeff_Nms2 / preset.thrust_coeff_Ns2
    assert 0.7 <= arms[1] / arms[0] <= 1.3
    assert 0.5 <= preset.drag_Nspm[0] / ours.drag_Nspm[0] <= 2.5


def test_what_is_known_stands_in_the_file(tmp_path: Path) -> None:
    kind = loaded(
        tmp_path, KnownVehicle(1.2, 2.5 * INCH_M, BatteryPack(48.84, 14.8), 0.11, 0.4, 380.0, "px4"), 'my "five"'
    )
    vehicle, power = kind.vehicle, kind.vehicle.power
    assert power is not None
    assert (vehicle.name, kind.autopilot, vehicle.mass_kg, vehicle.arm_m) == ('my "five"', "px4", 1.2, 0.11)
    assert (power.battery_Wh, power.battery_V, power.rotor_radius_m) == (48.84, 14.8, 0.0635)
    full_N = 4.0 * vehicle.thrust_coeff_Ns2 * vehicle.rotor_max_radps**2
    assert 1.2 * 9.8 / full_N == pytest.approx(0.4, rel=0.02)
    measured = KnownVehicle(1.2, 2.5 * INCH_M, BatteryPack(48.84), hover_W=380.0)
    assert measured.hover_s == pytest.approx((48.84 * 3600.0 / 380.0,) * 2)


@given(
    st.floats(0.05, 25.0),
    st.floats(2.0, 30.0),
    st.floats(1.45, 2.5),
    st.floats(0.15, 0.7),
)
@settings(max_examples=60, deadline=None)
def test_every_vehicle_loads_or_is_refused_with_a_reason(
    mass_kg: float, inches: float, size_share: float, throttle: float
) -> None:
    diameter_m = inches * INCH_M
    known = KnownVehicle(
        mass_kg, 0.5 * diameter_m, BatteryPack(60.0 * mass_kg), 0.5 * size_share * diameter_m, throttle
    )
    try:
        vehicle_text("any", known)
    except UsageError as refused:  # by small propellers alone, which must turn too fast
        assert "faster than sound" in str(refused) or "rotor_max_radps" in str(refused)


@pytest.mark.parametrize(
    ("text", "battery"),
    [
        ("4S 3300mAh", BatteryPack(48.84, 14.8)),
        ("4s3300", BatteryPack(48.84, 14.8)),
        ("4S, 3.3 Ah", BatteryPack(48.84, 14.8)),
        ("6S 10Ah", BatteryPack(222.0, 22.2)),
        ("6s 10", BatteryPack(222.0, 22.2)),
        ("4S 3300 mAh 30C", BatteryPack(48.84, 14.8)),
        ("48,8 Wh", BatteryPack(48.8)),
    ],
)
def test_batteries_as_people_write_them(text: str, battery: BatteryPack) -> None:
    assert parse_battery(text) == battery


@pytest.mark.parametrize("text", ["", "3300mAh", "0S 3300", "4S", "four", "4S 3300 mAh 20", "1e9 Wh!"])
def test_other_words_are_no_battery(text: str) -> None:
    with pytest.raises(UsageError, match="not a battery"):
        parse_battery(text)
