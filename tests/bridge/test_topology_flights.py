"""Emulated vehicles that follow each other in a chain, over a link that is late and loses frames, and breaks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.plan.trajectory.plan import Plan
from tests.bridge.flying import fly


@pytest.mark.slow
def test_a_chain_follows_its_leader_and_passes_over_a_vehicle_that_is_not_heard(hop: Plan) -> None:
    formation = hop.scenario.formation.model_copy(update={"topology": "chain"})
    plan = replace(hop, scenario=hop.scenario.model_copy(update={"formation": formation}))
    assert plan.information_graph(0.0).sources == ((), (0,), (1,))
    late = "all:down.delay=0.2,0.02", "all:down.loss=0.2"
    flown = fly(plan, "1:push=4,0@25..26.2", "2:down.silent@34..37", *late, follow=True)
    assert flown.error is None
    during = (flown.t_s > 0.0) & (flown.t_s < plan.flight_s)
    off = np.linalg.norm(flown.places - flown.planned, axis=-1)[:, during].max(axis=1)
    assert off[0] > 2.5  # pushed
    assert off[0] > off[1] > off[2] > 0.2  # each less than the one before it
    before_landing = (flown.t_s > plan.flight_s - 1.0) & (flown.t_s < plan.flight_s)
    assert flown.formation_error_m()[before_landing].max() < 0.5
    changes = [(event.what, event.rule) for event in flown.events if event.sysid == 2 and "listened" in event.what]
    assert [what for what, _ in changes] == ["is not listened to any more", "is listened to again"]
    assert changes[0][1].endswith("vehicle 3 listens to vehicle 1")
    assert changes[1][1] == "by vehicle 3"
