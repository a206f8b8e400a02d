"""Draws the pictures of the README from the scenarios: ./tools/run python tools/figures.py"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import gcs
from gcs.flight.pictures import draw_all
from gcs.quadrotor import POSITION

ROOT = Path(__file__).resolve().parent.parent
STEP_S = 0.1


def main() -> None:
    """Plan Simulation 1 and write docs/pictures/simulation1/*.png."""
    plan = gcs.make_plan(gcs.load_scenario(ROOT / "missions" / "simulation1"))
    folder = ROOT / "docs" / "pictures" / "simulation1"
    folder.mkdir(parents=True, exist_ok=True)
    t_s = np.arange(plan.t_start_s, plan.t_end_s, STEP_S)
    for path in draw_all(plan.scenario, plan.sysids, t_s, plan.states(t_s)[..., POSITION], folder):
        print(path.relative_to(ROOT))


if __name__ == "__main__":
    main()
