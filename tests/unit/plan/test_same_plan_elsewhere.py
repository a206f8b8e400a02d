"""The same scenario planned with other kernels, threads and numbers of processes: how far two plans may differ.

The tolerances are those that docs/planner.md states. Where the shape is chosen, the optimum is flat: its cost is the
same to a part in 10,000, and its places move by decimetres.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from gcs.plan.plan_file import read_plan
from gcs.plan.trajectory.plan import Plan
from tests.machines import OLDEST, OTHERS, environment

PLAN = """
import sys
from gcs.plan.planner import make_plan
from gcs.plan.plan_file import save_plan
from gcs.plan.verification.verify import verify
from gcs.scenario.sources.load import load_scenario
if __name__ == "__main__":
    plan = make_plan(load_scenario(sys.argv[1]), workers=int(sys.argv[3]))
    report = verify(plan)
    assert report.ok, report
    save_plan(plan, report, sys.argv[2])
"""


@dataclass(frozen=True)
class Tolerances:
    """The largest differences of two plans, and that of their costs as a share."""

    place_m: float
    speed_mps: float
    angle_rad: float
    cost: float


FIXED_SHAPE = Tolerances(5e-3, 1e-3, 1e-3, 1e-6)
CHOSEN_SHAPE = Tolerances(0.3, 0.1, 0.05, 1e-4)


def planned(folder: Path, scenario: Path, variables: dict[str, str], workers: int = 1) -> Plan:
    """The verified plan that a process on this machine makes."""
    program, file = folder / "planned.py", folder / "plan.skein"
    program.write_text(PLAN)
    command = [sys.executable, str(program), str(scenario), str(file), str(workers)]
    repository = str(Path(__file__).parents[3])
    subprocess.run(command, env={**environment(variables), "PYTHONPATH": repository}, check=True, cwd=repository)
    return read_plan(file)[0]


def assert_near(ours: Plan, theirs: Plan, allowed: Tolerances) -> None:
    assert ours.t_end_s == pytest.approx(theirs.t_end_s, abs=1e-6)
    assert ours.objective == pytest.approx(theirs.objective, rel=allowed.cost)
    t_s = np.linspace(ours.t_start_s, np.nextafter(ours.t_end_s, -np.inf), 2000)
    apart = np.abs(ours.states(t_s) - theirs.states(t_s))
    assert apart[..., :3].max() <= allowed.place_m
    assert apart[..., 3:6].max() <= allowed.speed_mps
    assert apart[..., 6:9].max() <= allowed.angle_rad


MISSIONS = {
    "simulation1": FIXED_SHAPE,
    "field": FIXED_SHAPE,
    "ridge": FIXED_SHAPE,
    "changes": FIXED_SHAPE,
    "gap": CHOSEN_SHAPE,
}
# The oldest processor differs most; the others take their turn with `-m long`.
SLOW = [("simulation1", OLDEST), ("ridge", OTHERS[0])]
LONG = [(name, other) for name in MISSIONS for other in (OLDEST, *OTHERS) if (name, other) not in SLOW]


@pytest.mark.parametrize(
    ("name", "variables"),
    [pytest.param(*case, marks=pytest.mark.slow) for case in SLOW]
    + [pytest.param(*case, marks=pytest.mark.long) for case in LONG],
    ids=lambda each: each if isinstance(each, str) else each["OPENBLAS_CORETYPE"],
)
def test_every_processor_makes_the_same_plan(
    plan_of: Callable[[str], Plan], repo_root: Path, tmp_path: Path, name: str, variables: dict[str, str]
) -> None:
    theirs = planned(tmp_path, repo_root / "missions" / name, variables)
    assert_near(plan_of(f"{name}/scenario.toml"), theirs, MISSIONS[name])


@pytest.mark.parametrize(
    "name", [pytest.param("simulation1", marks=pytest.mark.slow), pytest.param("gap", marks=pytest.mark.long)]
)
def test_more_processes_make_the_same_plan_to_the_last_bit(
    plan_of: Callable[[str], Plan], repo_root: Path, tmp_path: Path, name: str
) -> None:
    theirs = planned(tmp_path, repo_root / "missions" / name, {}, workers=3)
    assert theirs.hash == plan_of(f"{name}/scenario.toml").hash
