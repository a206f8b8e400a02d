"""The lines of a flight: known figures are shown, unknown ones are left out."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from gcs.cli.flights.fly_view import _line, _skew_text, _waiting
from gcs.flight.monitoring.lateness import lateness_data
from gcs.flight.monitoring.progress import Snapshot


def snapshot(**known: float) -> Snapshot:
    nothing = {"separation_m": math.nan, "formation_error_m": math.nan}
    return Snapshot("landing", 0.96, 280.0, {1: known.pop("error_m", math.nan)}, {1: 0.1}, {1: True}, **nothing | known)


def test_a_line_has_the_known_figures_and_no_others() -> None:
    assert _line(snapshot()) == "landing: t = 280 s (96%)"
    assert _line(snapshot(error_m=0.034)) == "landing: t = 280 s (96%), position error at most 0.03 m"
    whole = _line(snapshot(error_m=0.034, formation_error_m=0.02, separation_m=0.49))
    assert whole.endswith("0.03 m, formation error 0.02 m, separation 0.49 m")


def test_whoever_waits_for_readiness_is_told_which_vehicle_lacks_what() -> None:
    lacking = {3: "no position estimate", 1: "no position estimate", 2: "", 4: "no GNSS time"}
    waiting = replace(snapshot(), phase="waiting for readiness", plan_time_s=None, lacks=lacking)
    told = ": vehicles 1, 3: no position estimate; vehicle 4: no GNSS time"
    assert _line(waiting) + _waiting(waiting) == f"waiting for readiness{told}"
    assert _waiting(replace(waiting, lacks={1: "", 2: ""})) == _waiting(snapshot()) == ""


def test_time_skew_between_vehicles() -> None:
    late_s = {1: 0.010, 2: math.nan, 3: -0.004, 4: 0.0}
    assert _skew_text(late_s) == "14.0 ms (vehicles 1 and 3)"
    assert lateness_data(late_s) == {
        "skew_s": pytest.approx(0.014),
        "late_s": {"1": 0.010, "2": None, "3": -0.004, "4": 0.0},
    }
    assert _skew_text({1: 0.01, 2: math.nan}) is None
    assert lateness_data({1: math.nan}) == {"skew_s": None, "late_s": {"1": None}}
