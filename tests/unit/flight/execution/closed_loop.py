"""A formation in which recorded vehicles follow: what they are off by themselves, plus their answer to D.

A recorded follower cannot answer to setpoints that it was never sent. Here its deviation is the recorded one of a
flight without following, plus a second-order response with delay to the part of its setpoints beyond the plan.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs.flight.execution.leader_follower import FollowerState, FormationFollowing, SentSetpoints
from gcs.flight.monitoring.monitor import VehicleView
from gcs.physics.states import POSITION, VELOCITY
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array

STEP_S = 0.02
SETPOINTS_HZ = 10.0


@dataclass(frozen=True)
class FollowerResponse:
    """How a vehicle answers to a moved setpoint: x'' = w^2 (D - x) + 2 z w (D' - x') + share D'', `delay_s` later."""

    bandwidth_radps: float = 2.0
    damping: float = 0.8
    share: float = 1.0
    delay_s: float = 0.15


@dataclass(frozen=True)
class Link:
    """Age of a report on arrival, how far ahead of its time a setpoint is sent, and the share of lost reports."""

    delay_s: float = 0.15
    lead_s: float = 0.1
    loss: float = 0.0


@dataclass(frozen=True)
class Followed:
    """The outcome at `t_s` (N,): D (F, N, 3), and the deviations of the leader (N, 3) and the followers (F, N, 3)."""

    t_s: Array
    moved_m: Array
    leader_m: Array
    followers_m: Array

    def ratio(self) -> float:
        """Return the largest RMS error of a follower over that of the leader."""
        return float(np.sqrt((self.followers_m**2).sum(-1).mean(-1)).max() / np.sqrt((self.leader_m**2).sum(-1).mean()))

    def shape_m(self, begin_s: float, end_s: float) -> float:
        """Return the largest formation error (Definition 1) within these times."""
        during = (self.t_s >= begin_s) & (self.t_s < end_s)
        everybody = np.concatenate([self.leader_m[None], self.followers_m])[:, during]
        return float(np.linalg.norm(everybody - everybody.mean(axis=0), axis=-1).max())


def follow(
    plan: Plan,
    t_s: Array,
    leader: Array,
    followers: Array,
    response: FollowerResponse | None = FollowerResponse(),
    link: Link = Link(),
) -> Followed:
    """Return what followers do whose own deviations are `followers` (F, N, 6), behind a leader off by `leader` (N, 6).

    `response` None: they fly the plan, without following.
    """
    grid = np.arange(t_s[0], t_s[-1], STEP_S)
    led = np.stack([np.interp(grid, t_s, column) for column in leader.T], axis=1)
    own = np.stack([np.stack([np.interp(grid, t_s, c) for c in one.T], axis=1) for one in followers])
    off = own.copy()
    moved = np.zeros((*own.shape[:2], 9))
    if response is not None:
        _run(plan, grid, led, own, off, moved, response, link)
    during = grid >= 0.0
    return Followed(grid[during], moved[:, during, :3], led[during, :3], off[:, during, :3])


def _run(
    plan: Plan, grid: Array, led: Array, own: Array, off: Array, moved: Array, response: FollowerResponse, link: Link
) -> None:
    """Fill `off` (F, N, 6) and `moved` (F, N, 9) step by step."""
    sysids = [sysid for sysid in plan.sysids if sysid != plan.sysids[plan.leader]][: len(own)]
    rows = [plan.sysids.index(sysid) for sysid in sysids]
    states = plan.states(np.clip(grid, plan.t_start_s, np.nextafter(plan.t_end_s, -np.inf)))
    views = {sysid: VehicleView(sysid) for sysid in plan.sysids}
    sent = {sysid: SentSetpoints() for sysid in sysids}
    following = FormationFollowing(plan, 0.0, {sysid: FollowerState(views[sysid], sent[sysid]) for sysid in sysids})
    following.lead(views[plan.sysids[plan.leader]])
    rng = np.random.default_rng(1)
    every = round(1.0 / SETPOINTS_HZ / STEP_S)
    late, ahead, answer = (round(s / STEP_S) for s in (link.delay_s, link.lead_s, response.delay_s))
    state = np.zeros((len(sysids), 6))
    w, damping = response.bandwidth_radps, 2.0 * response.damping * response.bandwidth_radps
    after_s = np.arange(every)[:, None] * STEP_S
    for n in range(len(grid)):
        if n % every == 0 and n + ahead < len(grid):
            seen = max((n - late) // every * every, 0)
            for row, report in [(plan.leader, led[seen]), *zip(rows, off[:, seen], strict=True)]:
                if rng.random() < link.loss:
                    continue
                view = views[plan.sysids[row]]
                view.position_ned_m = states[row, seen, POSITION] + report[:3]
                view.velocity_ned_mps = states[row, seen, VELOCITY] + report[3:]
                view.unix_s = float(grid[seen])
            due = n + ahead
            following.heed(plan.sysids, float(grid[n]))
            for f, (sysid, row) in enumerate(zip(sysids, rows, strict=True)):
                p, v, a = following.at(sysid, float(grid[due]))
                planned = states[row, due]
                sent[sysid].add(
                    float(grid[due]), [*(planned[POSITION] + p), *(planned[VELOCITY] + v), *np.zeros(3), 0.0]
                )
                held = moved[f, due : due + every]
                held[:] = np.hstack([p + v * after_s + a * after_s**2 / 2, v + a * after_s, a + 0.0 * after_s])[
                    : len(held)
                ]
        told = moved[:, max(n - answer, 0)]
        push = w * w * (told[:, :3] - state[:, :3]) + damping * (told[:, 3:6] - state[:, 3:])
        state[:, 3:] += (push + response.share * told[:, 6:]) * STEP_S
        state[:, :3] += state[:, 3:] * STEP_S
        off[:, n] = own[:, n] + state
