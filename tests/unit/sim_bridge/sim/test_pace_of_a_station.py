"""The pace of emulated time with a ground station that sends setpoints just in time, on a fake clock.

The station knows the vehicle's time from its reports, and sends a setpoint when its time has come. The vehicle waits
for setpoints. Neither may make the other slower and slower.
"""

from __future__ import annotations

import itertools
import math
from collections import deque

import numpy as np
import pytest

from gcs.link.protocols.clock import VehicleClock
from gcs.link.wire.message import Message
from sim_bridge.autopilot.guidance.stream import SetpointFollower, StampedSetpoint
from sim_bridge.sim.world import Lockstep

BEFORE_S = 10.0  # setpoints begin; until then the station learns the pace
STEP_S, PERIOD_S, REPORT_S = 0.02, 0.1, 0.1
EPOCH_S = 1.5e9


@pytest.mark.parametrize("speedup", [2.0, 3.0, 10.0])
@pytest.mark.parametrize("delay_s", [0.002, 0.03])
def test_a_station_without_lead_that_stood_still_gets_the_whole_pace_again(speedup: float, delay_s: float) -> None:
    """The station stands still for 3 s of wall time, and looks at its clock every 20 ms otherwise."""
    clock, lockstep, stream = VehicleClock(), Lockstep(), SetpointFollower()
    down, up = deque[tuple[float, float]](), deque[tuple[float, float]]()  # wall time of arrival, simulated time
    stamps = (k * PERIOD_S for k in itertools.count(round(BEFORE_S / PERIOD_S)))
    stamp_s, steps, next_step_s, seen = next(stamps), 0, 0.0, False
    begun_s = BEFORE_S / speedup + 1.0
    marks: list[float] = []
    for now_s in np.arange(0.0, begun_s + 16.0, 1e-3).tolist():
        t_s = steps * STEP_S
        while up and up[0][0] <= now_s:
            stream.add(StampedSetpoint(up.popleft()[1], np.zeros((3, 4)), arrived_s=t_s))
            stream.advance(t_s)
        awaited = stream.awaits_more_after_s(t_s)
        waits = lockstep.wait_s({} if awaited is None else {0: awaited}, now_s) > 0.0
        if waits and lockstep.reminds(now_s):
            down.append((now_s + delay_s, t_s))
        if not waits and now_s >= next_step_s:
            steps, next_step_s = steps + 1, max(next_step_s, now_s - STEP_S) + STEP_S / speedup
            stream.advance(steps * STEP_S)
            if steps % round(REPORT_S / STEP_S) == 0:
                down.append((now_s + delay_s, steps * STEP_S))
        if begun_s + 3.0 <= now_s < begun_s + 6.0:
            seen = False
        elif round(now_s * 1e3) % 20 == 0:
            if not seen and now_s >= begun_s + 6.0:
                clock.stood_still(now_s)
            seen = now_s >= begun_s + 6.0
            while down and down[0][0] <= now_s:
                boot_s = down.popleft()[1] + 1.0
                stamp = {"time_boot_ms": round(boot_s * 1e3), "time_unix_usec": round((EPOCH_S + boot_s) * 1e6)}
                clock.receive(Message("SYSTEM_TIME", stamp), now_s)
            known_s = clock.now_unix_s(now_s)
            while known_s is not None and known_s - 1.0 - EPOCH_S >= stamp_s:
                up.append((now_s + delay_s, stamp_s))
                stamp_s = next(stamps)
        if now_s >= begun_s + 11.0:
            marks.append(t_s)
    pace = (marks[-1] - marks[0]) / 5.0
    # At worst two delays and two looks pass between a report and the setpoint it calls for.
    assert pace > min(0.9 * speedup, 0.1 / (2.0 * delay_s + 0.04)), pace
    assert not math.isinf(clock.rate)
