import math
from dataclasses import replace

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.link.mission_protocol.read_back import compare_missions
from gcs.mission.model import MissionItem

ARDUPILOT = Autopilot.ARDUPILOT
WAYPOINT = MissionItem(16, 3, (0.1, 2.0, 0.0, math.nan), 473977420, 85455939, 12.34)
SPEED = MissionItem(178, 2, (1.0, 3.3, -1.0, 0.0), 0, 0, 0.0)
LAND = MissionItem(21, 3, (0.0, 0.0, 0.0, 0.0), 473977420, 85455939, 0.0)
FENCE = MissionItem(5001, 0, (3.0, 0.0, 0.0, 0.0), 473977420, 85455939, 0.0)
RALLY = MissionItem(5100, 3, (0.0, 0.0, 0.0, 0.0), 473977420, 85455939, 20.0)


def read_back(item, **changes):
    params = tuple(float(np.float32(p)) for p in item.params)
    return replace(replace(item, params=params, alt_m=float(np.float32(item.alt_m))), **changes)


@pytest.mark.parametrize(
    ("item", "changes"),
    [
        (WAYPOINT, {}),
        (WAYPOINT, {"frame": 6}),
        (WAYPOINT, {"alt_m": 12.33}),
        (SPEED, {"frame": 0}),
        (LAND, {"params": (0.0, 0.0, 0.0, 1.0)}),
        (WAYPOINT, {"params": (0.0, 2.0, 0.0, math.nan)}),
        (WAYPOINT, {"params": (0.1, 0.0, 0.0, 0.0)}),
        (FENCE, {"autocontinue": False, "frame": 5}),
    ],
)
def test_changes_that_mean_nothing(item, changes):
    assert compare_missions([item], [read_back(item, **changes)], autopilot=ARDUPILOT) == []


@pytest.mark.parametrize(
    ("item", "changes", "what"),
    [
        (WAYPOINT, {"lat_degE7": 473977421}, "latitude"),
        (WAYPOINT, {"lon_degE7": 85455938}, "longitude"),
        (WAYPOINT, {"alt_m": 12.30}, "altitude"),
        (WAYPOINT, {"frame": 0}, "frame"),
        (WAYPOINT, {"command": 82}, "command"),
        (WAYPOINT, {"params": (0.1, 2.0, 0.0, 1.0)}, "parameter 4"),
        (WAYPOINT, {"params": (0.11, 2.0, 0.0, math.nan)}, "parameter 1"),
        (WAYPOINT, {"params": (1.0, 2.0, 0.0, math.nan)}, "parameter 1"),
        (SPEED, {"params": (1.0, 3.3, 0.0, 0.0)}, "parameter 3"),
        (FENCE, {"params": (4.0, 0.0, 0.0, 0.0)}, "parameter 1"),
        (RALLY, {"frame": 0}, "frame"),
        (SPEED, {"params": (1.0, 3.0, -1.0, 0.0)}, "parameter 2"),
        (LAND, {"params": (1.0, 0.0, 0.0, 0.0)}, "parameter 1"),
        (LAND, {"autocontinue": False}, "autocontinue"),
    ],
)
def test_changes_that_mean_something(item, changes, what):
    (difference,) = compare_missions(
        [WAYPOINT, item], [WAYPOINT, read_back(item, **changes)], autopilot=Autopilot.ARDUPILOT
    )
    assert difference.item == 1
    assert what in difference.what
    assert "item 1" in str(difference)


def test_a_missing_tail_is_a_difference():
    (difference,) = compare_missions([WAYPOINT, LAND], [WAYPOINT], autopilot=ARDUPILOT)
    assert (difference.item, difference.sent, difference.read_back) == (1, 2, 1)


@pytest.mark.parametrize(
    ("item", "changes"),
    [
        (WAYPOINT, {"alt_m": 12.33}),
        (LAND, {"params": (0.0, 0.0, 0.0, 1.0)}),
        (WAYPOINT, {"params": (0.0, 2.0, 0.0, math.nan)}),
        (WAYPOINT, {"params": (0.1, 2.0, 0.0, 0.0)}),
    ],
)
def test_what_ardupilot_cuts_off_px4_has_to_keep(item, changes):
    assert compare_missions([item], [read_back(item, **changes)], autopilot=12)
    assert compare_missions([item], [read_back(item)], autopilot=12) == []
