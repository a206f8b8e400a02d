"""Vehicles that start together over slow links, and followers that stay with a leader who is held up."""

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


def test_followers_stay_with_a_leader_who_is_held_up(hop: Plan) -> None:
    """The leader crawls for three seconds. Those who follow hang back with him; those who do not fly into him."""
    fault = "1:slow=1.2@30..33"
    alone = fly(hop, fault)
    assert "separation in danger" in [event.what for event in alone.events]
    following = fly(hop, fault, follow=True)
    assert following.error is None
    assert following.events == []
    error = following.formation_error_m()
    assert error[(following.t_s > 31.0) & (following.t_s < 33.0)].max() < 0.3  # converged
