"""Play recorded scenes against the emulated vehicles and count what differs:

    ./tools/run python -m tests.replay [--autopilot NAME] [--scene NAME] [--verbose] [--all] [FOLDER]

Prints for each scene how many steps are the same, differ as they are meant to, or differ; then what differs.
Exit code 1 if something differs that `known_differences` does not list, or an entry there explains nothing.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path

from gcs.scenario.load import load_scenario
from gcs.scenario.schema.scenario import Scenario
from sim_bridge.personality import ARDUPILOT, PX4, Personality
from tests.replay.compare import compare
from tests.replay.known_differences import MEANT, Meant, streams_of, why
from tests.replay.player import play
from tests.replay.recording import AUTOPILOTS, SCENES, TRACES, find, read
from tests.replay.verdict import Verdict

VEHICLE = Path(__file__).resolve().parents[2] / "missions" / "field"
SPEEDS_MPS = (12.0, 12.0, 3.2)  # what the recorded vehicles can, whatever our mission allows itself


@dataclass
class Scene:
    """The outcome of one scene."""

    autopilot: str
    scene: str
    verdicts: list[Verdict]
    counts: Counter[str] = field(default_factory=Counter)
    reasons: Counter[Meant] = field(default_factory=Counter)
    unlisted: list[tuple[Verdict, list[str]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        for verdict in self.verdicts:
            found = [(line, why(self.autopilot, self.scene, line)) for line in verdict.differences]
            self.reasons.update(reason for _, reason in found if reason is not None)
            unlisted = [line for line, reason in found if reason is None]
            self.counts["different" if unlisted else "meant" if found else "same"] += 1
            if unlisted:
                self.unlisted.append((verdict, unlisted))


def personality_of(autopilot: str) -> Personality:
    """The emulated autopilot that matches a recorded one, as long on the way to being ready."""
    return (PX4 if autopilot.startswith("px4") else ARDUPILOT).booting_for_real()


def replay(autopilot: str, scene: str, folder: Path = TRACES) -> Scene | None:
    """Play one scene; None where its recording is absent."""
    path = find(autopilot, scene, folder)
    if path is None:
        return None
    recording = read(path)
    streams = streams_of(autopilot)
    played = play(recording, personality_of(autopilot), _able(load_scenario(VEHICLE)), streams)
    return Scene(autopilot, scene, compare(recording, played, streams))


def _able(scenario: Scenario) -> Scenario:
    return scenario.model_copy(update={"limits": scenario.limits.model_copy(update={"speed_ned_mps": SPEEDS_MPS})})


def replay_all(autopilots: Iterable[str], scenes: Iterable[str], folder: Path = TRACES) -> Iterator[Scene]:
    """All scenes that there are, one after the other."""
    scenes = tuple(scenes)
    for autopilot in autopilots:
        for scene in scenes:
            played = replay(autopilot, scene, folder)
            if played is not None:
                yield played


def stale(scenes: Iterable[Scene]) -> list[Meant]:
    """Entries of the list that explain none of these scenes' differences."""
    used = {reason for scene in scenes for reason in scene.reasons}
    return [entry for entry in MEANT if entry not in used]


def main(arguments: list[str] | None = None) -> int:
    """Run the tool and return its exit code."""
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("folder", nargs="?", type=Path, default=TRACES, metavar="FOLDER")
    cli.add_argument("--autopilot", default="*", help="shell pattern, for example 'px4-*'")
    cli.add_argument("--scene", default="*", help="shell pattern, for example 'mission_*'")
    cli.add_argument("--verbose", action="store_true", help="also tell what is meant, and why")
    options = cli.parse_args(arguments)
    autopilots = [name for name in AUTOPILOTS if fnmatch(name, options.autopilot)]
    names = [name for name in SCENES if fnmatch(name, options.scene)]
    if not any(find(a, s, options.folder) for a in autopilots for s in names):
        print(f"error: there is no such scene in {options.folder}.", file=sys.stderr)
        return 2
    scenes = []
    total: Counter[str] = Counter()
    print(f"{'autopilot':18} {'scene':20} {'steps':>6} {'same':>6} {'meant':>6} {'different':>10}")
    for scene in replay_all(autopilots, names, options.folder):
        scenes.append(scene)
        total += scene.counts
        _print_row(scene.autopilot, scene.scene, scene.counts)
        for verdict, lines in scene.unlisted:
            print(f"    {verdict.t_s:8.2f} {verdict.title}")
            print("".join(f"             - {line}\n" for line in lines), end="")
        if options.verbose:
            for reason, times in scene.reasons.most_common():
                print(f"    meant {times:4} x {reason.line}: {reason.why}")
    _print_row("total", "", total)
    old = stale(scenes) if options.autopilot == options.scene == "*" else []
    for entry in old:
        print(f"stale: {entry.autopilot} {entry.scene} {entry.line}: explains nothing any more")
    return 1 if total["different"] or old else 0


def _print_row(autopilot: str, scene: str, counts: Counter[str]) -> None:
    steps = sum(counts.values())
    print(f"{autopilot:18} {scene:20} {steps:6} {counts['same']:6} {counts['meant']:6} {counts['different']:10}")


if __name__ == "__main__":
    sys.exit(main())
