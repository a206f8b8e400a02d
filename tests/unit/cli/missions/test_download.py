"""What vehicles have on board, as files: also what only PX4 would store."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.cli.missions.download import _write
from gcs.errors import PeerError
from gcs.link.session.vehicle_load import OnboardState
from gcs.mavlink import FenceCommand
from gcs.mission.formats.qgc_plan import read_mission
from gcs.mission.model import Command, Frame, Home, MissionItem

HOME = Home(47.4, 8.5, 488.0)
NO_ALTITUDE = MissionItem(Command.DO_SET_ROI_NONE, Frame.MISSION, (math.nan,) * 4, 0, 0, math.nan)


def held(*items: MissionItem, rally: tuple[MissionItem, ...] = ()) -> OnboardState:
    return OnboardState(3, Autopilot.PX4, HOME, items, (), rally)


def test_numbers_that_qgroundcontrol_leaves_open_are_null_in_the_file(tmp_path: Path) -> None:
    assert _write(tmp_path / "held", [held(NO_ALTITUDE)]) == ["uav3.plan"]
    text = (tmp_path / "held" / "uav3.plan").read_text()
    (read,) = read_mission(text, "uav3.plan").items
    assert (read.command, read.alt_m) == (Command.DO_SET_ROI_NONE, 0.0)
    assert all(map(math.isnan, read.params))


def test_what_no_file_can_hold_is_refused_with_its_vehicle(tmp_path: Path) -> None:
    endless = MissionItem(Command.NAV_WAYPOINT, Frame.GLOBAL, (0.0,) * 4, 0, 0, math.inf)
    with pytest.raises(PeerError, match="vehicle 3 has an infinite number in its mission item 2"):
        _write(tmp_path / "held", [held(NO_ALTITUDE, endless)])
    nowhere = MissionItem(FenceCommand.RALLY_POINT, Frame.GLOBAL_RELATIVE_ALT, (0.0,) * 4, 1, 1, math.nan)
    with pytest.raises(PeerError, match="vehicle 3 has invalid rally points on board: item 0 has no altitude"):
        _write(tmp_path / "held", [held(rally=(nowhere,))])
    assert not (tmp_path / "held").exists()
