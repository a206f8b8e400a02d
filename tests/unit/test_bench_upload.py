"""The benchmark of uploads counts what it says, and its goals hold in small."""

from __future__ import annotations

import pytest

from gcs.autopilot import Autopilot
from tools.bench_upload import cell
from tools.upload.air import Air, Weather, mission_of


@pytest.mark.parametrize("autopilot", [Autopilot.ARDUPILOT, Autopilot.PX4])
def test_without_losses_an_upload_takes_little_more_than_a_round_trip_per_item(autopilot: Autopilot) -> None:
    row = cell(autopilot, Weather(0.2, 0.0), uploads=6, items=100)
    assert row["of_floor"] < 1.2
    assert (row["errors"], row["wrong"]) == (0, 0)


@pytest.mark.parametrize("autopilot", [Autopilot.ARDUPILOT, Autopilot.PX4])
def test_every_upload_is_held_or_told(autopilot: Autopilot) -> None:
    row = cell(autopilot, Weather(0.05, 0.4), uploads=6, items=40)
    assert row["wrong"] == 0
    assert row["errors"] <= 1


def test_a_store_that_lies_is_counted_as_wrong_by_looking_into_it() -> None:
    """`held` is what the vehicle has, whatever was read back."""
    air = Air(Autopilot.PX4, Weather(0.05, 0.0), 1)
    items = mission_of(6, 1)
    told = air.shelf._told
    air.shelf._told = lambda item, seq, peer, kind: told(items[seq], seq, peer, kind)  # type: ignore[method-assign]
    store = air.shelf._store
    air.shelf._store = lambda kind, kept: store(kind, (kept[1], *kept[1:]) if kept else kept)  # type: ignore[method-assign]
    arrived = air.deliver(items)
    assert arrived.error is None
    assert not arrived.held
