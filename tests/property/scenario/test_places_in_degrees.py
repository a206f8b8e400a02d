"""Latitude and longitude in scenarios: the same flight as in metres, and the same places in what is exported."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.frames import Origin, ned_to_geodetic, place_up_m
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.validation.to_metres import in_metres
from tests.property.scenario.in_degrees import WIDER_M, in_degrees
from tests.property.scenario.mutations import ROOT, bundled, toml_text

TEXTS = bundled()
EXPORTED_DEG = 1e-7
NUMBERS_M = 2e-6  # converted metres are rounded to a micrometre

# Any place that a scenario may have, the date line and high latitudes as often as others.
origins = st.builds(
    Origin,
    lat_deg=st.one_of(st.floats(-85, 85), st.sampled_from((-85.0, 0.0, 84.99, 85.0))),
    lon_deg=st.one_of(st.floats(-180, 180), st.floats(-180, -179.9), st.floats(179.9, 180)),
    alt_amsl_m=st.floats(-500, 9000),
)
reaches = st.sampled_from((50.0, 5000.0, 60_000.0))


@st.composite
def places_deg(draw: st.DrawFn, origin: Origin) -> list[list[float]]:
    """Places around an origin, with as many digits as people write."""
    reach_m = draw(reaches)
    ned = np.array(draw(st.lists(st.tuples(*[st.floats(-reach_m, reach_m)] * 2), min_size=3, max_size=6)))
    lat, lon, _ = ned_to_geodetic(np.column_stack([ned, np.zeros(len(ned))]), origin)
    return np.round(np.column_stack([lat, (lon + 180.0) % 360.0 - 180.0]), 7).tolist()


def apart_deg(lat: Any, lon: Any, places: Any) -> float:
    """The greatest difference of an angle, also across the date line."""
    lon_off = (np.asarray(lon) - np.asarray(places)[..., 1] + 180.0) % 360.0 - 180.0
    return float(max(np.abs(np.asarray(lat) - np.asarray(places)[..., 0]).max(), np.abs(lon_off).max()))


@given(st.data(), origins, st.floats(-100, 3000))
def test_places_come_out_where_they_went_in(data: st.DataObject, origin: Origin, height_m: float) -> None:
    places = data.draw(places_deg(origin))
    first, second, third = places[:3]
    found = in_metres(
        {
            "origin": {"lat_deg": origin.lat_deg, "lon_deg": origin.lon_deg, "alt_amsl_m": origin.alt_amsl_m},
            "start": {"position_deg": first, "height_m": height_m},
            "end": {"position_deg": second, "alt_amsl_m": origin.alt_amsl_m + height_m},
            "no_fly": [{"polygon_deg": places}, {"lat_deg": third[0], "lon_deg": third[1], "radius_m": 9.0}],
            "formation": {"change": [{"gate_deg": [first, second]}]},
        }
    )
    assert found.mistakes == []
    start, end = (np.array(found.data[table]["position_m"]) for table in ("start", "end"))
    assert start[2] == pytest.approx(height_m, abs=1e-6)
    lat, lon, alt = ned_to_geodetic(np.array([start, end]) * [1.0, 1.0, -1.0], origin)
    assert apart_deg(lat, lon, [first, second]) < EXPORTED_DEG
    assert alt[1] == pytest.approx(origin.alt_amsl_m + height_m, abs=1e-5)
    polygon, disk = found.data["no_fly"]
    flat = [*polygon["polygon_m"], [disk["north_m"], disk["east_m"]], *found.data["formation"]["change"][0]["gate_m"]]
    lat, lon, _ = ned_to_geodetic(np.column_stack([np.array(flat), np.zeros(len(flat))]), origin)
    assert apart_deg(lat, lon, [*places, third, first, second]) < EXPORTED_DEG


@given(st.data(), origins)
def test_limits_in_degrees_are_inside_their_parallels_and_meridians(data: st.DataObject, origin: Origin) -> None:
    half_deg = data.draw(st.floats(1e-4, 0.05))
    wide_deg = half_deg / math.cos(math.radians(origin.lat_deg))
    west, east = ((lon + 180.0) % 360.0 - 180.0 for lon in (origin.lon_deg - wide_deg, origin.lon_deg + wide_deg))
    south, north = origin.lat_deg - half_deg, origin.lat_deg + half_deg
    table = {"lat_deg": [south, north], "lon_deg": [west, east]}
    place = {"lat_deg": origin.lat_deg, "lon_deg": origin.lon_deg, "alt_amsl_m": origin.alt_amsl_m}
    found = in_metres({"origin": place, "limits": table})
    assert found.mistakes == []
    (low, high), (left, right) = (found.data["limits"][key] for key in ("north_m", "east_m"))
    shares = np.linspace(0.0, 1.0, 5)
    edges = [(low + (high - low) * a, left + (right - left) * b, 0.0) for a in shares for b in shares]
    lat, lon, _ = ned_to_geodetic(np.array(edges), origin)
    slack = 1e-9
    assert (lat >= south - slack).all() and (lat <= north + slack).all()
    assert (((lon - west + 180.0) % 360.0 - 180.0) >= -slack * 20).all()
    assert (((east - lon + 180.0) % 360.0 - 180.0) >= -slack * 20).all()
    assert high - low > 0.9 * np.ptp(place_up_m(np.array([south, north]), origin.lon_deg, 0.0, origin)[:, 0])


@pytest.mark.parametrize("name", sorted({*TEXTS} - {"in degrees"}))
def test_every_mission_is_the_same_flight_in_degrees(tmp_path: Path, name: str) -> None:
    data = tomllib.loads(TEXTS[name])
    if "dem" in data.get("terrain", {}):
        data["terrain"]["dem"]["file"] = str(ROOT / "missions" / "ridge" / data["terrain"]["dem"]["file"])
    loaded = []
    for tables in (data, in_degrees(data)):
        (tmp_path / "scenario.toml").write_text(toml_text(tables))
        loaded.append(load_scenario(tmp_path).model_dump(exclude={"terrain": {"relief"}}))
    metres, degrees = loaded
    for key in ("north_m", "east_m"):
        ends = np.array(metres["limits"].pop(key)), np.array(degrees["limits"].pop(key))
        assert np.abs(ends[0] - ends[1]).max() < 2.0 * WIDER_M
    assert close(metres, degrees)


def close(one: Any, other: Any) -> bool:
    """Whether two trees of values differ by roundings only."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(close(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(close, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, abs_tol=NUMBERS_M)
    return bool(one == other)
