"""The MISSION argument: a mission folder, a scenario or a plan file becomes a verified plan."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from gcs.cli.shared.console import Screen
from gcs.errors import UsageError
from gcs.plan.plan_file import is_plan_file, load_plan, read_plan
from gcs.plan.planner import LIMIT_S, make_plan
from gcs.plan.trajectory.plan import MeshRound, Plan
from gcs.plan.verification.verify import Report, refusal, verify
from gcs.scenario.environment.no_fly import zone_sentences
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.sources.load import load_scenario
from gcs.scenario.validation.unit_guesses import doubts
from gcs.util.long_work import shown, within

_SPIN_S = 0.5


@dataclass
class Stopwatch:
    """The time that each part of a command took, in order."""

    began_s: float
    laps_s: dict[str, float] = field(default_factory=dict)

    def lap(self, name: str) -> None:
        """Count the time since the last lap as `name`."""
        self.laps_s[name] = time.perf_counter() - self.began_s - sum(self.laps_s.values())

    @property
    def total_s(self) -> float:
        """Time from the beginning to the last lap."""
        return sum(self.laps_s.values())

    def __str__(self) -> str:
        parts = ", ".join(f"{name} {seconds:.2f}" for name, seconds in self.laps_s.items())
        return f"{self.total_s:.2f} s ({parts})"


@dataclass(frozen=True)
class Accepts:
    """The plans that a command works with: by default, verified ones that begin on the ground."""

    unverified: bool = False
    from_the_air: bool = False  # plans that begin in flight
    refuse: Callable[[Scenario], None] = lambda _: None  # raises for scenarios with which the command cannot work


VERIFIED = Accepts()


def plan_for(
    mission: Path,
    screen: Screen,
    watch: Stopwatch,
    accepts: Accepts = VERIFIED,
    *,
    alternatives: bool = False,
    limit_s: float = LIMIT_S,
) -> tuple[Plan, Report]:
    """The plan of a mission folder, a scenario file or a plan file, with the report of its verification, made now.

    `alternatives` optimises every route class through the map, for comparison. Scenarios are refused before anything
    is planned or verified. Raises VerificationError for a plan that failed verification, and UsageError for one that
    begins in flight, where the command does not accept them; OutOfTime where planning finds nothing in `limit_s`.
    """
    if is_plan_file(mission):
        accepts.refuse(read_plan(mission)[0].scenario)
        with shown(screen.say), within(limit_s):
            plan, report = load_plan(mission, screen.warn)
        if plan.begin_state is not None and not accepts.from_the_air:
            raise UsageError(
                f"{mission}: this plan begins in the air, at t = {plan.t_start_s:g} s, not on the ground",
                hint="give the plan or mission that it was made from; `gcs export` writes the setpoints of this one",
            )
        watch.lap("load and verify")
    else:
        scenario = load_scenario(mission)
        if not mission.exists():
            screen.say(f"mission {mission}: the one that comes with Skein")
        accepts.refuse(scenario)
        for question in doubts(scenario):
            screen.warn(question)
        for sentence in zone_sentences(scenario):
            screen.say(sentence)
        watch.lap("scenario")
        with _progress(screen) as on_round:
            plan = make_plan(scenario, on_round, every_way=alternatives, workers=os.cpu_count() or 1, limit_s=limit_s)
            watch.lap("optimise")
            with within(limit_s):  # a plan that was found just in time is verified, too
                report = verify(plan)
        watch.lap("verify")
    if not report.ok and not accepts.unverified:
        raise refusal(report)
    return plan, report


def plan_path(to: Path | None, otherwise: Path) -> Path:
    """Where a plan is written: the file that --to names, in the folder that it names, or `otherwise`."""
    if to is None:
        return otherwise
    return to / otherwise.name if to.is_dir() else to


def verdict_word(ok: bool) -> str:
    """The last column of a table of criteria."""
    return "ok" if ok else "FAILED"


def solve_line(done: MeshRound) -> str:
    """The effort of one solve, and the first limit that it violates between the nodes."""
    verdict = done.complaints[0] if done.complaints else "verified between nodes"
    return f"{done.unknowns} unknowns, {done.iterations} iterations, {done.seconds:.2f} s: {verdict}"


@contextmanager
def _progress(screen: Screen) -> Iterator[Callable[[MeshRound], None]]:
    """A callback that prints one line for each solve of the mesh refinement, or moves a spinner on a terminal."""
    rounds: list[MeshRound] = []

    def describe(done: MeshRound) -> str:
        return f"solve {len(rounds)}: {solve_line(done)}"

    if not screen.is_watched:

        def line(done: MeshRound) -> None:
            rounds.append(done)
            screen.say(describe(done))

        with shown(screen.say):
            yield line
        return
    with screen.console.status("planning …") as status, shown(status.update, _SPIN_S):

        def spin(done: MeshRound) -> None:
            rounds.append(done)
            status.update(describe(done))

        yield spin
