"""Plays recorded scenes and counts the steps that are the same, that differ as known, and that differ otherwise."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from gcs.scenario.sources.load import load_scenario
from sim_bridge.personality import ARDUPILOT, PX4
from tests.replay.compare import compare
from tests.replay.known_differences import KNOWN, KnownDifference, explained_by, streams_of
from tests.replay.player import play
from tests.replay.recording import TRACES, find, read
from tests.replay.transcript import Verdict

MISSION = Path(__file__).resolve().parents[2] / "missions" / "field"
SPEEDS_MPS = (12.0, 12.0, 3.2)  # what the recorded vehicles can, whatever our mission allows itself


@dataclass
class Scene:
    """The outcome of one scene."""

    autopilot: str
    scene: str
    verdicts: list[Verdict]
    counts: Counter[str] = field(default_factory=Counter)
    reasons: Counter[KnownDifference] = field(default_factory=Counter)
    unlisted: list[tuple[Verdict, list[str]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        for verdict in self.verdicts:
            found = [(line, explained_by(self.autopilot, self.scene, line)) for line in verdict.differences]
            self.reasons.update(reason for _, reason in found if reason is not None)
            unlisted = [line for line, reason in found if reason is None]
            self.counts["different" if unlisted else "intended" if found else "same"] += 1
            if unlisted:
                self.unlisted.append((verdict, unlisted))


def replay(autopilot: str, scene: str, folder: Path = TRACES) -> Scene | None:
    """Play one scene to the matching vehicle, as long on the way to being ready; None where its recording is absent."""
    path = find(autopilot, scene, folder)
    if path is None:
        return None
    recording, streams = read(path), streams_of(autopilot)
    personality = (PX4 if autopilot.startswith("px4") else ARDUPILOT).booting_for_real()
    scenario = load_scenario(MISSION)
    able = scenario.model_copy(update={"limits": scenario.limits.model_copy(update={"speed_ned_mps": SPEEDS_MPS})})
    return Scene(autopilot, scene, compare(recording, play(recording, personality, able, streams), streams))


def stale(scenes: Iterable[Scene]) -> list[KnownDifference]:
    """Entries of the list that explain none of these scenes' differences."""
    used = {reason for scene in scenes for reason in scene.reasons}
    return [entry for entry in KNOWN if entry not in used]
