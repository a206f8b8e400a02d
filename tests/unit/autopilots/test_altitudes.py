"""Altitudes are written so that the autopilot stores the altitude wanted."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.autopilots.mission_commands import kept_alt_m, written_alt_m
from gcs.autopilots.traits import Autopilot
from gcs.frames import from_degE7, geodetic_to_ned
from gcs.mission.model import Command
from gcs.mission.waypoints.mission_items import build_missions
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.values.si import local_origin
from sim_bridge.missions.acceptance import as_stored
from sim_bridge.personality import by_name

_ALTITUDES = st.floats(-500.0, 9000.0)


@given(_ALTITUDES)
def test_arducopter_stores_the_nearest_centimetre(alt_m: float) -> None:
    written = written_alt_m(alt_m, Autopilot.ARDUPILOT)
    assert kept_alt_m(written, Autopilot.ARDUPILOT) == pytest.approx(alt_m, abs=0.005 + 1e-9)
    assert abs(written - alt_m) < 0.0061


@given(_ALTITUDES)
def test_px4_stores_millimetres(alt_m: float) -> None:
    written = written_alt_m(alt_m, Autopilot.PX4)
    assert kept_alt_m(written, Autopilot.PX4) == pytest.approx(alt_m, abs=0.001)


def test_an_altitude_written_as_it_is_may_lose_a_centimetre() -> None:
    assert kept_alt_m(2.059, Autopilot.ARDUPILOT) == 2.05
    assert kept_alt_m(0.53, Autopilot.ARDUPILOT) == 0.52  # 0.53 is a little less in single precision
    assert written_alt_m(0.53, Autopilot.ARDUPILOT) == 0.531
    assert written_alt_m(-0.53, Autopilot.ARDUPILOT) == -0.531
    assert math.isinf(kept_alt_m(1e300, Autopilot.ARDUPILOT))


@pytest.mark.parametrize("firmware", list(Autopilot))
def test_stored_legs_take_the_planned_times(simulation1_plan: Plan, firmware: Autopilot) -> None:
    """Stored leg lengths over the speeds sent are the times between waypoints."""
    origin = local_origin(simulation1_plan.scenario)
    storage = by_name(firmware.key).missions.storage[0]
    for mission in build_missions(simulation1_plan, firmware=firmware):
        items = [as_stored(item, storage) for item in mission.items]
        speed_mps, before, left_s, legs = math.nan, None, math.nan, 0
        for item, arrival_s in zip(items, mission.arrival_s, strict=True):
            if item.command == Command.DO_CHANGE_SPEED:
                speed_mps = item.params[1]
            elif item.command in (Command.NAV_TAKEOFF, Command.NAV_WAYPOINT):
                alt_amsl_m = item.alt_m + mission.home.alt_amsl_m
                place = geodetic_to_ned(from_degE7(item.lat_degE7), from_degE7(item.lon_degE7), alt_amsl_m, origin)
                assert arrival_s is not None
                if before is not None:
                    taken_s = float(np.linalg.norm(place - before)) / speed_mps
                    assert taken_s == pytest.approx(arrival_s - left_s, abs=0.002)
                    legs += 1
                before, left_s = place, arrival_s
            elif item.command == Command.NAV_DELAY:
                left_s += item.params[0]
        assert legs > 30
