"""The tools that measure emulated vehicles measure something."""

from __future__ import annotations

import pytest

from tools import bench_bridge, measure_wind


def test_the_benchmark_of_the_fleet(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_bridge, "WARM_S", 3.0)
    found = bench_bridge.measure(2, "px4", 0.2)
    assert found["vehicles"] == 2
    assert found["times_real_time"] > 1.0
    assert found["messages_per_vehicle_and_s_of_flight"] > 35.0
    assert 0.0 < found["propagate_us"] < found["update_us"]


def test_wind_is_felt(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measure_wind, "AWAY_M", 5.0)
    monkeypatch.setattr(measure_wind, "UP_M", 2.0)
    monkeypatch.setattr(measure_wind, "SETTLE_S", 3.0)
    calm, windy = (measure_wind.measure("field", wind, gusts, 1.0, 1) for wind, gusts in (("", ""), ("8@0", "severe")))
    assert 0.0 < calm["hover, RMS"] < windy["hover, RMS"] < 0.5
    assert calm["on the way, most"] < windy["on the way, most"]
