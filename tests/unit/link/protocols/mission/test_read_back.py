import math
from dataclasses import replace

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.link.protocols.mission.read_back import Difference, compare_missions, read_back_error
from gcs.link.wire.message import Station
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


@pytest.mark.parametrize(
    ("item", "changes", "said"),
    [
        (WAYPOINT, {"lat_degE7": 473977421}, "item 0: latitude (1e-7 deg) sent 473977420, read back 473977421"),
        (WAYPOINT, {"lon_degE7": 85455938}, "item 0: longitude (1e-7 deg) sent 85455939, read back 85455938"),
        (WAYPOINT, {"alt_m": 12.5}, "item 0: altitude (m) sent 12.34, read back 12.5"),
        (WAYPOINT, {"frame": 0}, "item 0: frame sent 3, read back 0"),
        (WAYPOINT, {"command": 82}, "item 0: command sent 16, read back 82"),
        (SPEED, {"params": (1.0, 3.3, 0.0, 0.0)}, "item 0: parameter 3 sent -1.0, read back 0.0"),
        (LAND, {"autocontinue": False}, "item 0: autocontinue sent True, read back False"),
    ],
)
def test_a_difference_is_said_with_both_values(item, changes, said):
    (difference,) = compare_missions([item], [read_back(item, **changes)], autopilot=ARDUPILOT)
    assert str(difference) == said


def test_every_field_of_every_item_is_compared():
    """Five items, each wrong in another field, and one item too few: all of it is found, each where it is."""
    wrong = [
        read_back(WAYPOINT, lat_degE7=1),
        read_back(WAYPOINT, lon_degE7=1, alt_m=90.0),
        read_back(SPEED, params=(0.0, 9.0, 0.0, 1.0)),
        read_back(LAND, frame=0, autocontinue=False),
    ]
    found = compare_missions([WAYPOINT, WAYPOINT, SPEED, LAND, RALLY], wrong, autopilot=Autopilot.PX4)
    assert [(one.item, one.what) for one in found] == [
        (4, "number of items"),
        (0, "latitude (1e-7 deg)"),
        (1, "altitude (m)"),
        (1, "longitude (1e-7 deg)"),
        (2, "parameter 1"),
        (2, "parameter 2"),
        (2, "parameter 3"),
        (2, "parameter 4"),
        (3, "frame"),
        (3, "autocontinue"),
    ]


@pytest.mark.parametrize(("count", "more"), [(1, ""), (5, ""), (6, "; and 1 more"), (12, "; and 7 more")])
def test_the_error_lists_five_differences_and_counts_the_others(count, more):
    differences = [Difference(n, "altitude (m)", 1.0, 2.0) for n in range(count)]
    error = read_back_error(Station(3, 1), 0, differences)
    listed = "; ".join(f"item {n}: altitude (m) sent 1.0, read back 2.0" for n in range(min(count, 5)))
    assert error.message == f"the mission read back from {Station(3, 1)} differs from what was sent: {listed}{more}."
    assert error.hint == "upload again; if the error persists, the autopilot does not store these items unchanged"


def test_items_with_too_few_parameters_are_no_match():
    short = replace(WAYPOINT, params=(0.1, 2.0, 0.0))
    with pytest.raises(ValueError, match="shorter"):
        compare_missions([WAYPOINT], [short], autopilot=ARDUPILOT)


@pytest.mark.parametrize("axis", ["lat_degE7", "lon_degE7"])
def test_a_place_that_ardupilot_does_not_store_may_come_back_as_0_and_as_nothing_else(axis):
    sent = replace(SPEED, **{axis: 473977420})
    assert compare_missions([sent], [read_back(sent, **{axis: 0})], autopilot=ARDUPILOT) == []
    (difference,) = compare_missions([sent], [read_back(sent, **{axis: 5})], autopilot=ARDUPILOT)
    assert (difference.sent, difference.read_back) == (473977420, 5)
