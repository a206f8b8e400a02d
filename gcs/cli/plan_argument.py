"""A mission on the command line becomes a plan that may be used: loaded or made, and verified.

Knows: what a MISSION argument can be, how planning is shown. Does not know: what is done with the plan.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from gcs.cli.console import Screen
from gcs.errors import UsageError, VerificationError
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import MeshRound, Plan
from gcs.plan.trajectory.plan_file import SUFFIX, load_plan
from gcs.plan.verification.verify import Report, verify
from gcs.scenario.load import load_scenario


@dataclass
class Stopwatch:
    """Where the time went, in order."""

    began_s: float
    laps_s: dict[str, float] = field(default_factory=dict)

    def lap(self, name: str) -> None:
        """All time since the last lap goes to `name`."""
        self.laps_s[name] = time.perf_counter() - self.began_s - sum(self.laps_s.values())

    @property
    def total_s(self) -> float:
        """From the beginning to the last lap."""
        return sum(self.laps_s.values())

    def __str__(self) -> str:
        parts = ", ".join(f"{name} {seconds:.2f}" for name, seconds in self.laps_s.items())
        return f"{self.total_s:.2f} s ({parts})"


def plan_for(
    mission: Path,
    screen: Screen,
    watch: Stopwatch,
    *,
    unverified: bool = False,
    every_way: bool = False,
    in_the_air: bool = False,
) -> tuple[Plan, Report]:
    """The plan of a mission folder, a scenario file or a `.skein` file, with its verdict.

    `every_way` optimises all ways through the map, for comparison. Raises VerificationError for a plan that does not
    hold, unless `unverified`; UsageError for one that begins in flight, unless `in_the_air`.
    """
    if mission.suffix == SUFFIX:
        plan, report = load_plan(mission)
        if plan.begin_state is not None and not in_the_air:
            raise UsageError(
                f"{mission}: this plan begins in the air, at t = {plan.t_start_s:g} s, not on the ground",
                hint="give the plan or mission that it was made from; `gcs export` writes this one's setpoints",
            )
        watch.lap("load")
    else:
        scenario = load_scenario(mission)
        watch.lap("scenario")
        with _progress(screen) as on_round:
            plan = make_plan(scenario, on_round, every_way=every_way, workers=os.cpu_count() or 1)
        watch.lap("optimise")
        report = verify(plan)
        watch.lap("verify")
    if not report.ok and not unverified:
        raise refusal(report)
    return plan, report


def refusal(report: Report) -> VerificationError:
    """Why a plan must not be used."""
    worst = "; ".join(str(c) for c in report.failures[:5])
    more = f"; and {len(report.failures) - 5} more" if len(report.failures) > 5 else ""
    return VerificationError(
        f"the plan does not hold what it promises: {worst}{more}",
        hint="change the scenario and plan again, or add --unverified to use it as it is",
    )


@contextmanager
def _progress(screen: Screen) -> Iterator[Callable[[MeshRound], None]]:
    """A line per solve of the mesh refinement; a spinner where somebody watches."""
    rounds: list[MeshRound] = []

    def describe(done: MeshRound) -> str:
        verdict = done.complaints[0] if done.complaints else "holds between nodes"
        effort = f"{done.unknowns} unknowns, {done.iterations} iterations, {done.seconds:.2f} s"
        return f"solve {len(rounds)}: {effort}: {verdict}"

    if not screen.is_watched:

        def line(done: MeshRound) -> None:
            rounds.append(done)
            screen.say(describe(done))

        yield line
        return
    with screen.console.status("planning …") as status:

        def spin(done: MeshRound) -> None:
            rounds.append(done)
            status.update(describe(done))

        yield spin
