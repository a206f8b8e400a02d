"""Prints a row for each recorded scene, then what differs, with the reason where it is known.

./tools/run python -m tests.replay [FOLDER of recordings]
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

from tests.replay.recording import AUTOPILOTS, SCENES, TRACES
from tests.replay.replay import replay


def main(folder: Path) -> int:
    """Return 1 if something differs that `known_differences` does not list."""
    total: Counter[str] = Counter()
    for autopilot in AUTOPILOTS:
        for name in SCENES:
            scene = replay(autopilot, name, folder)
            if scene is None:
                continue
            total += scene.counts
            print(f"{autopilot} {name}: {told(scene.counts)}", flush=True)
            for verdict, lines in scene.unlisted:
                print(f"  {verdict.t_s:.2f} s, {verdict.title}:", *lines, sep="\n    ")
            for reason, times in scene.reasons.most_common():
                print(f"  {times} x {reason.line}: {reason.why}")
    print(f"total: {told(total)}")
    return int(total["different"] > 0)


def told(counts: Counter[str]) -> str:
    """The counts of steps in words."""
    kinds = ", ".join(f"{counts[kind]} {kind}" for kind in ("same", "intended", "different"))
    return f"{sum(counts.values())} steps, {kinds}"


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if sys.argv[1:] else TRACES))
