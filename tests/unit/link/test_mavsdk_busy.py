"""A vehicle that is busy with a transfer which MAVSDK cancelled: it is asked again to clear, and what it holds."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import pytest
from mavsdk.plugins.mission_raw import MissionRawError, MissionRawResult

from gcs.errors import PeerError
from gcs.link.session import mavsdk_vehicle
from gcs.link.session.mavsdk_vehicle import MavsdkVehicle


class Busy:
    """MissionRaw of a vehicle that refuses its first requests to clear, and to download."""

    def __init__(self, clears: int, downloads: int) -> None:
        self.refusals = {"clear": clears, "download": downloads}

    def _asked(self, what: str) -> None:
        self.refusals[what] -= 1
        if self.refusals[what] >= 0:
            raise MissionRawError(MissionRawResult.BUSY, what)

    def clear_mission(self) -> None:
        self._asked("clear")

    def download_mission(self) -> list[object]:
        self._asked("download")
        raise MissionRawError(MissionRawResult.NO_MISSION_AVAILABLE, "download")  # of a vehicle that holds nothing

    download_geofence = download_rallypoints = download_mission


def vehicle(monkeypatch: pytest.MonkeyPatch, missions: Busy) -> MavsdkVehicle:
    monkeypatch.setattr(mavsdk_vehicle, "_RETRY_S", 0.0)
    monkeypatch.setattr(mavsdk_vehicle.mission_raw, "MissionRaw", lambda _: missions)
    monkeypatch.setattr(mavsdk_vehicle.param, "Param", lambda _: None)
    telemetry = SimpleNamespace(subscribe_armed=lambda _: None)
    monkeypatch.setattr(mavsdk_vehicle.telemetry, "Telemetry", lambda _: telemetry)
    return MavsdkVehicle(SimpleNamespace(get_system_id=lambda: 1, autopilot_type=lambda: None))


@pytest.mark.parametrize(("clears", "downloads"), [(0, 0), (3, 0), (0, 1), (2, 2)])
def test_a_busy_vehicle_is_asked_again(monkeypatch: pytest.MonkeyPatch, clears: int, downloads: int) -> None:
    missions = Busy(clears, downloads)
    asyncio.run(vehicle(monkeypatch, missions).upload_items(()))
    assert missions.refusals["clear"] < 0
    assert missions.refusals["download"] == -1


def test_one_that_stays_busy_is_an_error_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mavsdk_vehicle, "_BUSY_MAX_S", 0.0)
    with pytest.raises(PeerError, match="vehicle 1: MAVSDK could not download its items: BUSY"):
        asyncio.run(vehicle(monkeypatch, Busy(0, 100)).upload_items(()))
