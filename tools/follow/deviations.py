"""What vehicles of a recorded flight were off the plan: (N, 6), position and velocity as reported, at 10 Hz."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gcs.flight.recording.flight_state import read_flight_state
from gcs.flight.recording.load_recording import PLAN
from gcs.flight.recording.tlog import read_messages
from gcs.link.microservices.clock import VehicleClock
from gcs.physics.quadrotor import POSITION, VELOCITY, Array
from gcs.plan.trajectory.plan import Plan
from gcs.plan.trajectory.plan_file import load_plan

PERIOD_S = 0.1


def recorded_deviations(flight: Path, begin_s: float, end_s: float) -> tuple[Plan, Array, dict[int, Array]]:
    """Return the plan, plan times (N,), and the deviations (N, 6) of every vehicle, by system id."""
    plan, _ = load_plan(flight / PLAN)
    t0_unix_s = read_flight_state(flight).t0_unix_s
    assert t0_unix_s is not None, f"{flight} never started its plan"
    clocks = {sysid: VehicleClock() for sysid in plan.sysids}
    reports: dict[int, list[tuple[float, ...]]] = {sysid: [] for sysid in plan.sysids}
    for message in read_messages(flight / "telemetry.tlog"):
        clock, fields = clocks.get(message.sysid), message.fields
        if clock is None or message.name not in ("LOCAL_POSITION_NED", "SYSTEM_TIME"):
            continue
        clock.receive(message, fields["time_boot_ms"] / 1e3)
        unix_s = clock.unix_s(fields["time_boot_ms"])
        if message.name == "LOCAL_POSITION_NED" and unix_s is not None:
            motion = [fields[name] for name in ("x", "y", "z", "vx", "vy", "vz")]
            reports[message.sysid].append((unix_s - t0_unix_s, *motion))
    t_s = np.arange(begin_s, end_s, PERIOD_S)
    return plan, t_s, {sysid: _deviation(plan, sysid, np.array(rows), t_s) for sysid, rows in reports.items()}


def _deviation(plan: Plan, sysid: int, reports: Array, t_s: Array) -> Array:
    row = plan.sysids.index(sysid)
    at = np.clip(reports[:, 0], plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf))
    state = plan.states(at)[row]
    off = reports[:, 1:] - np.hstack([state[:, POSITION], state[:, VELOCITY]])
    off[:, :3] += plan.pads_ned_m[row]
    return np.stack([np.interp(t_s, reports[:, 0], column) for column in off.T], axis=1)
