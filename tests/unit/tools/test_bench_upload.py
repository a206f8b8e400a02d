"""The benchmark of uploads counts what it says, and its goals hold in small."""

from __future__ import annotations

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.link.protocols.mission.strategy import Transfer
from tests.air import Air, Weather, mission_of
from tools.bench_upload import cell


@pytest.mark.parametrize("autopilot", [Autopilot.ARDUPILOT, Autopilot.PX4])
def test_without_losses_an_upload_takes_little_more_than_a_round_trip_per_item(autopilot: Autopilot) -> None:
    row = cell(autopilot, Weather(0.2, 0.0), uploads=6, items=100)
    assert row["of_floor"] < 1.2
    assert (row["errors"], row["wrong"]) == (0, 0)


def test_a_file_is_faster_than_items_in_every_weather() -> None:
    for weather in (Weather(0.0, 0.0), Weather(0.05, 0.2), Weather(0.2, 0.4)):
        ways = (Transfer.FILE, Transfer.ITEMS)
        as_file, by_items = (cell(Autopilot.ARDUPILOT, weather, uploads=5, items=60, transfer=way) for way in ways)
        assert (as_file["errors"], as_file["wrong"]) == (0, 0)
        assert as_file["held_s"] < by_items["held_s"] / 4


@pytest.mark.parametrize("autopilot", [Autopilot.ARDUPILOT, Autopilot.PX4])
def test_every_upload_is_held_or_told(autopilot: Autopilot) -> None:
    row = cell(autopilot, Weather(0.05, 0.4), uploads=6, items=40)
    assert row["wrong"] == 0
    assert row["errors"] <= 1


def test_a_store_that_lies_is_counted_as_wrong_by_looking_into_it() -> None:
    """`held` is what the vehicle has, whatever was read back."""
    air = Air(Autopilot.PX4, Weather(0.05, 0.0), 1)
    items = mission_of(6, 1)
    told = air.shelf._read_back_message
    air.shelf._read_back_message = lambda item, seq, peer, kind: told(items[seq], seq, peer, kind)  # type: ignore[method-assign]
    store = air.shelf._hold
    air.shelf._hold = lambda kind, kept: store(kind, (kept[1], *kept[1:]) if kept else kept)  # type: ignore[method-assign]
    arrived = air.deliver(items)
    assert arrived.error is None
    assert not arrived.held
