"""How wide arrival times may spread, in the words of reports."""

from __future__ import annotations

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.mission.predicted.arrival_spread import spread_in_words


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
