"""Texts of failsafes and of pilots, as recorded or as published sources write them."""

from __future__ import annotations

import pytest

from gcs.autopilots.columns import FailsafeCause
from gcs.autopilots.traits import Autopilot


@pytest.mark.parametrize(
    ("autopilot", "text", "cause"),
    [
        (Autopilot.PX4, "Failsafe activated\t", FailsafeCause.OTHER),
        (Autopilot.PX4, "Geofence: approaching or outside geofence", FailsafeCause.FENCE),
        (Autopilot.PX4, "Critical battery level\t", FailsafeCause.BATTERY),
        (Autopilot.PX4, "RTL: unsupported MAV_FRAME\t", None),
        (Autopilot.ARDUPILOT, "Polygon fence breached", FailsafeCause.FENCE),
        (Autopilot.ARDUPILOT, "Battery Failsafe", FailsafeCause.BATTERY),
        (Autopilot.ARDUPILOT, "EKF Failsafe: changed to LAND Mode", FailsafeCause.POSITION),
        (Autopilot.ARDUPILOT, "GCS Failsafe", FailsafeCause.LINK),
        (Autopilot.ARDUPILOT, "GCS Failsafe Cleared", None),
        (Autopilot.ARDUPILOT, "Radio Failsafe - Continuing Guided Mode", None),
        (Autopilot.ARDUPILOT, "Mission: 38 WP", None),
    ],
)
def test_a_text_names_the_cause_of_a_failsafe(autopilot: Autopilot, text: str, cause: FailsafeCause | None) -> None:
    assert autopilot.traits.flight.failsafe.cause(text) is cause


def test_a_pilot_is_told_by_px4() -> None:
    assert Autopilot.PX4.traits.flight.failsafe.pilot("Pilot took over using sticks\t")
    assert not Autopilot.ARDUPILOT.traits.flight.failsafe.pilot("Failsafe activated")
