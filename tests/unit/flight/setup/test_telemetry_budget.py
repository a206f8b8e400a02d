"""Telemetry that is requested over a radio fits beside the setpoints, or the flight is refused."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.errors import UsageError
from gcs.flight.contingency.choices import FlightMode
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.setup.telemetry_budget import LEAST_SHARE, full_telemetry_Bps, telemetry_share
from gcs.link.session.connection import Connection


def test_without_a_radio_telemetry_is_full() -> None:
    assert telemetry_share(None, 200, FlightMode.STREAM, 100.0) == 1.0
    assert Connection(("udpin:127.0.0.1:14550",)).slowest_baud is None
    assert telemetry_share(921_600, 6, FlightMode.STREAM, 10.0) == 1.0


def test_the_slowest_line_counts() -> None:
    two = ("serial:/dev/ttyUSB0:115200", "serial:/dev/ttyUSB1:57600")
    assert Connection(two).slowest_baud == 57_600
    assert Connection(two, radio_baud=38_400).slowest_baud == 38_400
    assert Connection(("tcp:127.0.0.1:5760",), radio_baud=57_600).slowest_baud == 57_600


def test_six_vehicles_fly_missions_over_the_usual_radio_and_get_no_setpoints_over_it() -> None:
    share = telemetry_share(57_600, 6, FlightMode.MISSION, 10.0)
    assert share * full_telemetry_Bps(6) == pytest.approx(0.6 * 5760.0)
    asked = FlightOptions(telemetry_share=share)
    assert (asked.position_rate_hz, asked.state_rate_hz) == (pytest.approx(3.84), pytest.approx(0.768))
    with pytest.raises(UsageError, match=r"57600 baud .* setpoints at 10 Hz .* need 4800") as refused:
        telemetry_share(57_600, 6, FlightMode.STREAM, 10.0)
    assert refused.value.hint == "fly --mode mission, or set `setpoint_rate_hz` to 6.5 or less"


@given(st.integers(4_800, 921_600), st.integers(1, 250), st.sampled_from(list(FlightMode)), st.floats(2.0, 100.0))
def test_what_is_requested_fits_beside_the_setpoints(
    baud: int, vehicles: int, mode: FlightMode, rate_hz: float
) -> None:
    setpoints_Bps = vehicles * rate_hz * 65.0 if mode is FlightMode.STREAM else 0.0
    try:
        share = telemetry_share(baud, vehicles, mode, rate_hz)
    except UsageError:
        assert setpoints_Bps + LEAST_SHARE * full_telemetry_Bps(vehicles) > 0.06 * baud
    else:
        assert LEAST_SHARE <= share <= 1.0
        assert setpoints_Bps + share * full_telemetry_Bps(vehicles) <= 0.06 * baud * (1.0 + 1e-12) or share == 1.0
        assert share == 1.0 or setpoints_Bps + share * full_telemetry_Bps(vehicles) >= 0.06 * baud * (1.0 - 1e-12)
