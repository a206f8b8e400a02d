"""Six recorded PX4s that were called back through their own fence: none is left alone, and each gets an order."""

from __future__ import annotations

from pathlib import Path

from gcs.autopilots.traits import Autopilot
from gcs.flight.contingency.decisions import ContingencyPolicy
from gcs.flight.contingency.detection import DetectionLimits, IncidentKind, VehicleWatch
from gcs.flight.contingency.policy import Order, State
from gcs.flight.monitoring.progress import Action, AskedOrder
from tests.real_flights import Flight, unpacked

PX4 = Autopilot.PX4.traits.flight
ORDERED_S = 2.8  # after the log's begin the recorded ground station ordered all to return
LOOK_S = 0.1
GROUND_M = 0.5


def test_none_of_six_in_their_failsafes_hold_is_left_alone(tmp_path: Path) -> None:
    flight = Flight(unpacked("px4-1.17dev-return-into-fence", tmp_path))
    began_s = float(flight.log.unix_s[0])
    policy = ContingencyPolicy(flight.plan.sysids, flight.plan.sysids[flight.plan.leader])
    watches = {
        sysid: VehicleWatch(sysid, PX4, DetectionLimits(), began_s, frozenset({PX4.guided}))
        for sysid in flight.plan.sysids
    }
    given: list[tuple[float, Order]] = []
    failsafes: dict[int, str] = {}
    looked_s, called = began_s, False

    def give(orders: list[Order], unix_s: float) -> None:
        for order in orders:
            given.append((unix_s - began_s, order))
            watches[order.sysid].order(PX4.guided, PX4.land, PX4.returning)

    for frame, unix_s in zip(flight.log.frames, flight.log.unix_s.tolist(), strict=True):
        if frame.message is None or frame.sysid not in watches:
            continue
        watches[frame.sysid].receive(frame.message, unix_s)
        if not called and unix_s - began_s > ORDERED_S:
            called = True
            give(policy.ask(AskedOrder.RETURN, policy.sysids, unix_s), unix_s)
        if unix_s - looked_s < LOOK_S or not called:
            continue
        looked_s = unix_s
        for watch in watches.values():
            for incident in watch.look(unix_s):
                if incident.kind is IncidentKind.FAILSAFE:
                    failsafes[incident.sysid] = incident.detail
                give(policy.take(incident), unix_s)
    assert len(failsafes) == 5  # one flew past the zone and landed
    assert all(detail == "now in HOLD, cause: fence" for detail in failsafes.values())
    assert State.LEFT not in policy.states.values()
    in_failsafe = {order.sysid for t_s, order in given if t_s > 10.0 and order.action is Action.RETURN}
    assert in_failsafe == set(failsafes)
    assert not any(order.action is Action.LEAVE for _, order in given)
