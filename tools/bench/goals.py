"""What the numbers are for: the goals, and which are met.

Knows: records and findings. Does not know: how they came about or how they are shown.
"""

from __future__ import annotations

from dataclasses import dataclass

from tools.bench.findings import Findings
from tools.bench.race import Record

SAME_OBJECTIVE = 1e-4
OF_CONVERGED = 1e-3


@dataclass(frozen=True)
class Goal:
    """A ratio that shall be at most (or at least) some number."""

    name: str
    value: float
    bound: float
    at_least: bool = False

    @property
    def met(self) -> bool:
        """The bound is kept."""
        return self.value >= self.bound if self.at_least else self.value <= self.bound


def judge(records: list[Record], findings: dict[int, Findings], reference: float | None) -> list[Goal]:
    """All goals that can be judged from the records that there are."""
    goals: list[Goal] = []

    def find(name: str, mesh: str | None = None) -> list[Record]:
        return [r for r in records if r.runs and r.contender.name.startswith(name) and mesh in (None, r.mesh)]

    for mesh in dict.fromkeys(r.mesh for r in find("yapss")):
        ours, yapss = find("skein, Eq. 41", mesh), find("yapss", mesh)
        if not ours:
            continue
        # The smaller of the peer's times is what counts, whichever of its settings had it.
        for key, bound in (("solver_s", 0.3), ("cold_s", 0.6)):
            ratio = ours[0].median(key) / min(r.median(key) for r in yapss)
            goals.append(Goal(f"{key.removesuffix('_s')} on {mesh}, of yapss-lg", ratio, bound))
        theirs = yapss[0].result["objective"]
        goals.append(
            Goal(f"objective on {mesh}, off yapss-lg's", abs(ours[0].result["objective"] / theirs - 1), SAME_OBJECTIVE)
        )
    refined, peers = find("skein, refined"), [r for r in records if r.runs and r.contender.is_peer]
    if refined and peers:
        verified = findings[id(refined[0])].verified
        fastest = min(r.median("cold_s") for r in peers)
        goals.append(
            Goal(
                "time to a verified plan, of the fastest peer's first solution",
                refined[0].median("cold_s") / fastest if verified else float("inf"),
                1.0,
            )
        )
    if refined and reference:
        off = abs(findings[id(refined[0])].objective / reference - 1)
        goals.append(Goal("objective of the verified plan, off the converged one", off, OF_CONVERGED))
    six, six_there, coupled = find("skein, six refined"), find("skein, six, Eq. 41"), find("coupled")
    if refined and six:
        goals.append(
            Goal("six vehicles, of the leader alone", six[0].median("cold_s") / refined[0].median("cold_s"), 2.0)
        )
    for ours, what in ((six_there, "on the same mesh"), (six, "verified")):
        if ours and coupled:
            ratio = coupled[0].median("cold_s") / ours[0].median("cold_s")
            goals.append(Goal(f"six in one coupled program, of our six {what}", ratio, 30.0, at_least=True))
    return goals
