"""Vehicles that start together over slow links."""

from __future__ import annotations

import numpy as np

from gcs.flight.compare import lateness_s
from gcs.plan.trajectory import Plan
from tests.bridge.flying import fly


def test_a_formation_starts_together_over_links_that_delay(hop: Plan) -> None:
    flown = fly(hop, "all:delay=0.05,0.02")
    assert flown.error is None
    during = (flown.t_s > 0.0) & (flown.t_s < hop.flight_s)
    rate = np.gradient(flown.planned[:, during], flown.t_s[during], axis=1)
    late_s = [lateness_s(flown.places[row, during], flown.planned[row, during], rate[row]) for row in range(3)]
    assert max(late_s) - min(late_s) <= 0.05
    assert max(np.abs(late_s)) < 0.1
