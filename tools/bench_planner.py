"""Skein's planner beside its peers on one problem, in one run:  ./tools/run python tools/bench_planner.py [--quick]

Simulation 1's leader alone from A to B, with the same objective, bounds, scaling, guess and tolerance for every
contender, `--repetitions` runs of each on every mesh; medians count. `--quick`: one run each, yapss as the only peer.
Skein's verifier then checks every solver's solution between its nodes.
"""

from gcs.plan.nlp.ipopt import solve
from gcs.plan.nlp.transcription import transcribe
from gcs.plan.ocp.problem import Problem
from tools.bench import describe, race
from tools.bench.findings import cost
from tools.bench.frame import options
from tools.bench.race import Contender, Goal, Record

UNIFORM, ENDS, OWN = "15 uniform x 4", "30 end-refined x 4", "own mesh"
EQ_41, REFINED, SIX = "skein, Eq. 41", "skein, refined", "skein, six refined"


def main() -> None:
    """Measure, judge, print."""
    asked = options(__doc__, repetitions=5, quick=False, json=None)
    problem = describe.leader_problem()
    meshes = {UNIFORM: describe.uniform(problem), ENDS: describe.refined_at_ends(problem)}
    numbers = {name: describe.numbers(problem, mesh) for name, mesh in meshes.items()}
    both = (
        Contender(EQ_41, "skein", ("leader", "lagrange")),
        Contender("skein, linear control", "skein", ("leader", "linear")),
        *(race.YAPSS if asked.quick else race.PEERS),
    )
    entries = [(contender, mesh) for mesh in meshes for contender in both]
    entries += [
        (Contender("skein, six, Eq. 41", "skein", ("six", "lagrange")), UNIFORM),
        (Contender(REFINED, "skein", ("leader", "refined")), OWN),
        (Contender(SIX, "skein", ("six", "refined")), OWN),
    ]
    reference = None if asked.quick else converged(problem)

    def judged(records: list[Record]) -> list[Goal]:
        return judge(records, reference)

    repetitions = 1 if asked.quick else asked.repetitions
    race.hold(problem, numbers | {OWN: numbers[UNIFORM]}, entries, judged, repetitions, asked.json)


def converged(problem: Problem) -> float:
    """The objective on a mesh so fine that it no longer changes."""
    program = transcribe(problem, describe.converged(problem), describe.straight(problem))
    return cost(problem, program.trajectory(solve(program, program.scaled(describe.straight(problem))).y))


def judge(records: list[Record], reference: float | None) -> list[Goal]:
    """All goals that can be judged from the records that there are."""
    goals, done = [], [r for r in records if r.runs]
    peers = [r for r in done if r.contender.is_peer]
    for ours in (r for r in done if r.contender.name == EQ_41):
        yapss = [r for r in peers if r.contender.package == "yapss" and r.mesh == ours.mesh]
        if not yapss:
            continue
        # The smaller of the peer's times is what counts, whichever of its settings had it.
        for key, bound in (("solver_s", 0.3), ("cold_s", 0.6)):
            ratio = ours.median(key) / min(r.median(key) for r in yapss)
            goals.append(Goal(f"{key.removesuffix('_s')} on {ours.mesh}, of yapss-lg", ratio, bound))
        off = abs(ours.result["objective"] / yapss[0].result["objective"] - 1.0)
        goals.append(Goal(f"objective on {ours.mesh}, off yapss-lg's", off, 1e-4))
    refined, six = (next((r for r in done if r.contender.name == name), None) for name in (REFINED, SIX))
    if refined and refined.findings and peers:
        took_s = refined.median("cold_s") if refined.findings.verified else float("inf")
        ratio = took_s / min(r.median("cold_s") for r in peers)
        goals.append(Goal("time to a verified plan, of the fastest peer's first solution", ratio, 1.0))
    if refined and refined.findings and reference:
        off = abs(refined.findings.objective / reference - 1.0)
        goals.append(Goal("objective of the verified plan, off the converged one", off, 1e-3))
    if refined and six:
        goals.append(Goal("six vehicles, of the leader alone", six.median("cold_s") / refined.median("cold_s"), 2.0))
    return goals


if __name__ == "__main__":
    main()
