"""What is on board of vehicles whose missions are longer than their autopilot stores."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from gcs.autopilots.traits import TRAITS, Autopilot
from gcs.errors import NotWritten
from gcs.flight.contingency.choices import FlightMode, TimeKeeping
from gcs.flight.setup.build_loads import build_loads, export_for_flight
from gcs.mission.geofence import fence_items
from gcs.mission.returns.fence_rally import build_fence
from gcs.mission.waypoints.mission_items import build_missions
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify

SHORT = "the setpoint stream is flown without waypoint missions on board: A mission has "


@pytest.mark.slow
def test_a_stream_is_flown_without_missions_that_are_too_long(
    simulation1_plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, row = simulation1_plan, Autopilot.ARDUPILOT.traits
    usual = build_missions(plan)
    monkeypatch.setitem(TRAITS, Autopilot.ARDUPILOT, replace(row, missions=replace(row.missions, items_max=6)))
    autopilots = dict.fromkeys(plan.sysids, int(Autopilot.ARDUPILOT))
    with pytest.raises(NotWritten, match="ArduCopter stores at most 6"):
        build_loads(plan, autopilots, timed=False)
    told: list[str] = []
    loads = build_loads(plan, autopilots, timed=False, stream=True, warn=told.append)
    assert [load.mission.items for load in loads] == [()] * len(plan.sysids)
    assert [load.mission.home for load in loads] == [mission.home for mission in usual]
    assert all(load.fence and load.parameters for load in loads)
    assert [text for text in told if text.startswith(SHORT)]

    told.clear()
    stream = TimeKeeping(FlightMode.STREAM, emulated=True)
    index, _ = export_for_flight(plan, verify(plan), tmp_path / "export", stream, told.append)
    assert [mission.items for mission in index.missions] == [()] * len(plan.sysids)
    assert [text for text in told if text.startswith(SHORT)]
    assert (tmp_path / "export" / "index.json").exists()
    given = build_loads(plan, autopilots, timed=False, stream=True, exported=index)
    assert [load.mission for load in given] == list(index.missions)


@pytest.mark.slow
def test_only_a_stream_has_a_fence_with_room_for_other_plans(plan_of: Callable[[str], Plan]) -> None:
    plan = plan_of("field/scenario.toml")
    autopilots = dict.fromkeys(plan.sysids, int(Autopilot.ARDUPILOT))
    usual, roomy = (fence_items(build_fence(plan, may_change=stream).geofence) for stream in (False, True))
    assert usual != roomy
    for stream, fence in ((False, usual), (True, roomy)):
        assert {load.fence for load in build_loads(plan, autopilots, timed=False, stream=stream)} == {fence}
