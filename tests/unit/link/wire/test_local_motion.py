"""What of a LOCAL_POSITION_NED is a position, and what no vehicle can mean."""

from __future__ import annotations

import math

import pytest

from gcs.link.wire.message import Message, local_motion

FIELDS = {"time_boot_ms": 7, "x": 1.0, "y": -2.0, "z": -10.0, "vx": 3.0, "vy": 0.0, "vz": -0.5}


def test_a_report_is_read_in_its_order() -> None:
    assert local_motion(Message("LOCAL_POSITION_NED", FIELDS)) == (1.0, -2.0, -10.0, 3.0, 0.0, -0.5)


@pytest.mark.parametrize("name", ["x", "y", "z", "vx", "vy", "vz"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 3e38, -3e38])
def test_one_impossible_number_spoils_the_report(name: str, value: float) -> None:
    assert local_motion(Message("LOCAL_POSITION_NED", FIELDS | {name: value})) is None


@pytest.mark.parametrize(("name", "value"), [("x", 99_000.0), ("z", -9_000.0), ("vx", 300.0)])
def test_what_is_far_or_fast_is_still_a_report(name: str, value: float) -> None:
    assert local_motion(Message("LOCAL_POSITION_NED", FIELDS | {name: value})) is not None
