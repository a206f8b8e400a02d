"""How wide arrival times may spread, in the words of reports."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.mission.predicted.arrival_spread import arrival_spread, spread_in_words
from gcs.mission.predicted.planned_flight import PredictedFlight


@pytest.mark.parametrize(
    ("widest_s", "autopilots", "words"),
    [
        (0.0, (Autopilot.ARDUPILOT,) * 2, "no arrival time rests on a reaction of ArduCopter that may go both ways"),
        (1.4, (Autopilot.ARDUPILOT,) * 2, "arrival times may spread by ±1.4 s by what ArduCopter may do"),
        (0.0, (Autopilot.PX4,), "arrival times may spread by ±1.1 s by what PX4 may do"),
        (0.5, tuple(Autopilot), "arrival times may spread by ±1.6 s by what ArduCopter and PX4 may do"),
    ],
)
def test_reports_say_how_wide_arrivals_may_spread(
    widest_s: float, autopilots: tuple[Autopilot, ...], words: str
) -> None:
    assert spread_in_words(widest_s, autopilots) == words


def along(*knots: tuple[float, int]) -> PredictedFlight:
    """A flight with knots at these times, each with its item."""
    t_s, item = (np.array(column) for column in zip(*knots, strict=True))
    return PredictedFlight(t_s, np.zeros((len(t_s), 3)), item, 0.0, 1e3, 1e3)


def test_a_knot_left_out_of_a_straight_leg_makes_no_vehicle_early() -> None:
    """Item 2 is under way from 10 s in both flights; the last knot of item 1 is at 9 s in one, at 2 s in the other."""
    flight, other = along((0, 1), (9, 1), (10, 2), (20, 2)), along((0, 1), (2, 1), (10, 2), (23, 2))
    spread = arrival_spread(flight, [other])
    assert spread.t_s.tolist() == [10.0, 20.0]
    assert spread.early_s.tolist() == [0.0, 0.0]
    assert spread.late_s.tolist() == [0.0, 3.0]
