"""What one vehicle's session keeps, whatever the vehicle says later."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.message import Message

FIELDS: dict[str, Any] = {"type": 2, "base_mode": 1, "custom_mode": 0, "system_status": 3}


@pytest.mark.parametrize("later", [0, 8, 12, 255])
def test_a_vehicle_keeps_the_autopilot_that_it_was_found_with(later: int) -> None:
    async def autopilot() -> int:
        first = Message("HEARTBEAT", FIELDS | {"autopilot": int(Autopilot.ARDUPILOT)}, 1, 1)
        session = VehicleSession(first, lambda _: None)
        session.receive(Message("HEARTBEAT", FIELDS | {"autopilot": later, "base_mode": 129}, 1, 1), 1.0)
        assert session.armed
        return session.autopilot

    assert asyncio.run(autopilot()) == Autopilot.ARDUPILOT
