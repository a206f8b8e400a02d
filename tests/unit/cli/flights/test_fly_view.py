"""What a flight says while it lasts and when it has ended: figures that are there, nothing where there are none."""

from __future__ import annotations

import math

import pytest

from gcs.cli.flights.fly_view import _line, _together
from gcs.flight.progress import Snapshot
from gcs.flight.run import _skew


def snapshot(**known: float) -> Snapshot:
    nothing = {"separation_m": math.nan, "formation_error_m": math.nan}
    return Snapshot("landing", 0.96, 280.0, {1: known.pop("error_m", math.nan)}, {1: 0.1}, {1: True}, **nothing | known)


def test_a_line_tells_the_figures_there_are_and_no_others() -> None:
    assert _line(snapshot()) == "landing: t = 280 s (96%)"
    assert _line(snapshot(error_m=0.034)) == "landing: t = 280 s (96%), position error at most 0.03 m"
    whole = _line(snapshot(error_m=0.034, formation_error_m=0.02, separation_m=0.49))
    assert whole.endswith("0.03 m, shape off by 0.02 m, separation 0.49 m")


def test_how_far_apart_in_time_vehicles_were() -> None:
    late_s = {1: 0.010, 2: math.nan, 3: -0.004, 4: 0.0}
    assert _together(late_s) == "14.0 ms (vehicles 1 and 3)"
    assert _skew(late_s) == {
        "skew_s": pytest.approx(0.014),
        "late_s": {"1": 0.010, "2": None, "3": -0.004, "4": 0.0},
    }
    assert _together({1: 0.01, 2: math.nan}) is None
    assert _skew({1: math.nan}) == {"skew_s": None, "late_s": {"1": None}}
