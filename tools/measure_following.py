"""How closely do followers follow? Recorded leaders, and recorded vehicles that follow them, in a closed loop.

./tools/run python tools/measure_following.py LEADER_FLIGHT FOLLOWER_FLIGHT [--until 215] [--delay 0.15] [--cut FILE]

LEADER_FLIGHT and FOLLOWER_FLIGHT are flight folders of one plan (`plan.skein`, `flight.json`, `telemetry.tlog`). The
second one is flown without following: its vehicles show what they are off by themselves. Their answer to the setpoints
that move them is a second-order response with delay (`tools.follow.closed_loop`). `--cut` writes the first 45 s as a
file of millimetres, which the tests read.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from tools.follow.closed_loop import Followed, FollowerResponse, Link, follow
from tools.follow.deviations import recorded_deviations

BEGIN_S = -8.0
TRANSIENT_S = 15.0
CUT_S = 45.0
RESPONSES = {
    "no following": None,
    "quick answer": FollowerResponse(),
    "slow answer": FollowerResponse(bandwidth_radps=1.0, damping=0.7, share=0.8, delay_s=0.3),
}


def main() -> None:
    """Print a line for every response."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("leader", type=Path)
    parser.add_argument("followers", type=Path)
    parser.add_argument("--until", type=float, default=215.0)
    parser.add_argument("--delay", type=float, default=0.15)
    parser.add_argument("--cut", type=Path)
    asked = parser.parse_args()
    plan, t_s, leading = recorded_deviations(asked.leader, BEGIN_S, asked.until)
    _, _, flown = recorded_deviations(asked.followers, BEGIN_S, asked.until)
    first = plan.sysids[plan.leader]
    leader, own = leading[first], np.array([flown[sysid] for sysid in plan.sysids if sysid != first])
    if asked.cut is not None:
        kept = t_s < CUT_S
        whole = np.concatenate([leader[None], own])[:, kept]
        np.savez_compressed(asked.cut, t_s=t_s[kept], off_mm=np.round(whole * 1e3).astype(np.int16))
    for name, response in RESPONSES.items():
        print(f"{name:14}{_line(follow(plan, t_s, leader, own, response, Link(delay_s=asked.delay)))}")


def _line(flown: Followed) -> str:
    end_s = float(flown.t_s[-1])
    early_m, late_m = flown.shape_m(0.0, TRANSIENT_S), flown.shape_m(TRANSIENT_S, end_s)
    return (
        f"largest follower's error {flown.ratio():.2f} of the leader's; shape off by {early_m:.2f} m"
        f" up to {TRANSIENT_S:g} s, by {late_m:.2f} m after; moved by"
        f" {np.linalg.norm(flown.moved_m, axis=-1).max():.2f} m"
    )


if __name__ == "__main__":
    main()
