"""What the numbers of legs are for: the goals, and whether all contenders solved the same problem.

Knows: records and findings. Does not know: how they came about or how they are shown.
"""

from __future__ import annotations

from tools.bench.findings import Findings
from tools.bench.goals import Goal
from tools.bench.race import Record

SIX, LEADER, SAME_FORM = "skein, six", "skein, leader", "skein, leader, Eq. 41"
SAME_SHARE, SAME_S = 0.01, 1.0  # of the objective; of the times at points


def judge_legs(records: list[Record], findings: dict[int, Findings]) -> list[Goal]:
    """All goals that can be judged from the records that there are."""
    done = {r.contender.name: r for r in records if r.runs}
    peers = [r for r in done.values() if r.contender.is_peer]
    if not peers:
        return []
    fastest = min(peers, key=lambda r: r.median("cold_cpu_s"))
    first_s = fastest.median("cold_cpu_s")
    goals = []
    for name, key, what in (
        (SIX, "verified_cpu_s", "six: whole plan, verified"),
        (LEADER, "verified_cpu_s", "leader: whole plan, verified"),
        (LEADER, "flight_cpu_s", "leader: the common flight, refined"),
        (LEADER, "cold_cpu_s", "leader: first solution"),
        (SAME_FORM, "cold_cpu_s", "leader: first solution, control as the peers have it"),
    ):
        if name in done:
            goal = f"{what}, of the first solution of {fastest.contender.name}"
            goals.append(Goal(goal, done[name].median(key) / first_s, 1.0))
    if SAME_FORM in done:
        ours = done[SAME_FORM]
        objective = findings[id(ours)].objective
        off = max(abs(findings[id(r)].objective / objective - 1.0) for r in peers)
        goals.append(Goal("objective of the peers, off skein's with control as they have it", off, SAME_SHARE))
    for name in (SAME_FORM, LEADER):
        if name in done:
            off_s = max(points_off_s(done[name], peer) for peer in peers)
            goals.append(Goal(f"times at points of the peers, off those of {name}, in s", off_s, SAME_S))
    return goals


def points_off_s(ours: Record, theirs: Record) -> float:
    """Largest difference of the times at the points, in seconds."""
    pairs = zip(ours.result["points_s"], theirs.result["points_s"], strict=True)
    return float(max(abs(a - b) for a, b in pairs))
