"""The header of a mission file: how long the file is, and what is no file of a mission."""

from __future__ import annotations

import struct

import pytest

from gcs.errors import PeerError
from gcs.link.protocols.mission.mission_dat import length_of
from gcs.mavlink import MissionType
from tests.unit.link.protocols.mission.conversation import VEHICLE

MAGIC, FENCE, OPTIONS = 0x763D, int(MissionType.FENCE), 7


@pytest.mark.parametrize("count", [0, 1, 4096])
def test_a_file_has_10_bytes_and_38_for_each_item(count: int) -> None:
    head = struct.pack("<5H", MAGIC, FENCE, OPTIONS, 0, count)
    assert length_of(head, FENCE, VEHICLE) == length_of(head + b"item", FENCE, VEHICLE) == 10 + 38 * count


@pytest.mark.parametrize(
    "fields",
    [
        (MAGIC + 1, FENCE, OPTIONS, 0, 3),
        (MAGIC, int(MissionType.RALLY), OPTIONS, 0, 3),
        (MAGIC, FENCE, OPTIONS, 1, 3),  # it begins with a later item
        (MAGIC, FENCE, OPTIONS, 0, 4097),  # no autopilot has so many
    ],
)
def test_a_file_of_another_kind_is_not_read(fields: tuple[int, ...]) -> None:
    head = struct.pack("<5H", *fields)
    with pytest.raises(PeerError, match=f"invalid header: {head.hex(' ')}"):
        length_of(head, FENCE, VEHICLE)


def test_a_file_that_ends_in_its_header_is_not_read() -> None:
    with pytest.raises(PeerError, match="without a header"):
        length_of(struct.pack("<5H", MAGIC, FENCE, 0, 0, 1)[:-1], FENCE, VEHICLE)
