"""Regenerate the golden exports under missions/<name>/expected:  ./tools/run python tools/golden.py [mission ...]

Run it when planner or mission layer change on purpose, look at the difference, and commit it with the change.
The setpoints are thinned to 1 Hz: the files are for reading and for comparison, not for flying.
"""

import sys
from pathlib import Path

from gcs.mission.export.export import export
from gcs.plan.planner import make_plan
from gcs.scenario.sources.load import load_scenario

MISSIONS = Path(__file__).resolve().parent.parent / "missions"
SETPOINT_RATE_HZ = 1.0


def main(names: list[str]) -> None:
    """Regenerate the named missions' exports, or all that have some."""
    for name in names or sorted(p.parent.name for p in MISSIONS.glob("*/expected")):
        index = export(
            make_plan(load_scenario(MISSIONS / name)), MISSIONS / name / "expected", setpoint_rate_hz=SETPOINT_RATE_HZ
        )
        print(
            f"{name}: {index.waypoints} waypoints, {index.items} items; "
            f"{index.deviation.path_m:.3f} m from the path, {index.deviation.time_m:.3f} m at equal time"
        )


if __name__ == "__main__":
    main(sys.argv[1:])
