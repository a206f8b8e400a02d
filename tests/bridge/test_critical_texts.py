"""A critical text about the upload, over real sockets: nobody is armed, unless the operator waived it."""

from __future__ import annotations

import pytest

from gcs.errors import FlightError
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.execution.flight import FlightSequence
from gcs.flight.monitoring.preflight_check import CheckName
from gcs.flight.monitoring.progress import Step
from gcs.plan.trajectory.plan import Plan
from sim_bridge.sim.world import World
from tests.bridge.flying import Flown, fly

RTL = "RTL: unsupported MAV_FRAME\t"


class Complaint:
    """Vehicle 2 complains once, after its mission has come."""

    def __init__(self) -> None:
        self.made = False
        self.armed: set[int] = set()

    def __call__(self, world: World, flight: FlightSequence) -> None:
        self.armed |= {sysid for sysid, session in flight.sessions.items() if session.armed}
        if flight.held is not None and not self.made:
            self.made = True
            world.vehicles[1]._queue_text(2, RTL)


def flown(hop: Plan, **options: object) -> tuple[Flown, Complaint]:
    complaint = Complaint()
    result = fly(hop, during=complaint, **options)
    assert complaint.made
    (event,) = [e for e in result.events if "unsupported MAV_FRAME" in e.what]
    assert (event.sysid, event.what) == (2, "reports: CRITICAL: RTL: unsupported MAV_FRAME")
    assert event.unix_s > 1.6e9
    return result, complaint


def test_after_a_critical_text_nobody_is_armed(hop: Plan) -> None:
    result, complaint = flown(hop)
    assert isinstance(result.error, FlightError)
    assert result.error.message == "vehicle 2 reports before it is armed: RTL: unsupported MAV_FRAME."
    assert complaint.armed == set()


@pytest.mark.slow
def test_the_operator_may_waive_it_for_one_flight(hop: Plan) -> None:
    result, complaint = flown(
        hop, waived=frozenset({CheckName.MESSAGES}), enough=lambda flight: flight.step is Step.FLY
    )
    assert result.error is None
    assert complaint.armed == set(hop.sysids)
    assert FlightOptions().waived == frozenset()
