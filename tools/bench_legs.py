"""Five points for Skein and for planners of several phases, in one run:  ./tools/run python tools/bench_legs.py

Simulation 1's leader flies through the five points of `bench_route.drawn(5, 1)`: six legs, each a phase of free
duration, in a given time. Objective, bounds, scaling, guess, tolerance and mesh (Skein's first one) are the same for
all. A peer is done at its first solution; Skein goes on to the verified plan, with take-off, run-up and landing. Every
solver's solution is then checked between its nodes. Times are CPU times, so other programs count little.
"""

from tools.bench import describe, race
from tools.bench.frame import options
from tools.bench.race import Contender, Goal, Record

MESH = "first mesh"
SIX, LEADER, SAME_FORM = "skein, six", "skein, leader", "skein, leader, Eq. 41"
OURS = (
    Contender(SIX, "skein", ("six", "plan")),
    Contender(LEADER, "skein", ("leader", "plan")),
    Contender(SAME_FORM, "skein", ("leader", "one_solve")),
)
SAME_SHARE, SAME_S = 0.01, 1.0  # of the objective; of the times at points


def main() -> None:
    """Measure, judge, print."""
    asked = options(__doc__, repetitions=3, json=None)
    problem, mesh, guess = describe.route_problem()
    numbers = {MESH: describe.numbers(problem, mesh, guess)}
    entries = [(contender, MESH) for contender in (*OURS, *race.YAPSS, race.MAPTOR)]
    race.hold(problem, numbers, entries, judge, asked.repetitions, asked.json)


def judge(records: list[Record]) -> list[Goal]:
    """All goals that can be judged from the records that there are."""
    done = {r.contender.name: r for r in records if r.runs}
    peers = [r for r in done.values() if r.contender.is_peer]
    if not peers:
        return []
    fastest = min(peers, key=lambda r: r.median("cold_cpu_s"))
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
            goals.append(Goal(goal, done[name].median(key) / fastest.median("cold_cpu_s"), 1.0))
    ours = done.get(SAME_FORM)
    if ours and ours.findings:
        objective = ours.findings.objective
        off = max(abs(peer.findings.objective / objective - 1.0) for peer in peers if peer.findings)
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


if __name__ == "__main__":
    main()
