"""MAVSDK for tests: systems found at a port, and missions in its words."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import mavsdk
from mavsdk.plugins.mission_raw import MissionItem as RawItem

from gcs.mission.model import MissionItem

PATIENCE_S = 120.0


@contextmanager
def client(url: str, count: int) -> Iterator[dict[int, mavsdk.System]]:
    """So many systems by system id; `url` as MAVSDK writes them, for example udpin://127.0.0.1:14550."""
    configuration = mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
    sdk = mavsdk.Mavsdk(configuration)
    try:
        assert sdk.add_any_connection(url) == mavsdk.ConnectionResult.SUCCESS
        systems: dict[int, mavsdk.System] = {}

        def found() -> bool:
            known = [s for s in sdk.get_systems() if s.is_connected() and s.has_autopilot()]
            systems.update({s.get_system_id(): s for s in known})
            return len(systems) >= count

        wait(found, "MAVSDK to find its systems")
        yield systems
    finally:
        sdk.destroy()


def wait(condition: Callable[[], bool], what: str, patience_s: float = PATIENCE_S) -> None:
    """Wait for something that the client brings about."""
    end_s = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < end_s, f"waited in vain for {what}"
        time.sleep(0.02)


def to_raw(seq: int, item: MissionItem) -> RawItem:
    params = (float(p) for p in item.params)
    place = (item.lat_degE7, item.lon_degE7, item.alt_m)
    return RawItem(seq, item.frame, item.command, int(seq == 0), 1, *params, *place, 0)


def from_raw(raw: RawItem) -> MissionItem:
    params = (raw.param1, raw.param2, raw.param3, raw.param4)
    return MissionItem(raw.command, raw.frame, params, raw.x, raw.y, raw.z, bool(raw.autocontinue))
