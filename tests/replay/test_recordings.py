"""The emulated vehicles in recorded conversations with real autopilots: every step the same, or a known difference.

Three small scenes of each autopilot are in the tree and always played. The large ones are not, and skip without them.
"""

from __future__ import annotations

from functools import lru_cache

import pytest

from tests.replay.known_differences import KNOWN
from tests.replay.recording import AUTOPILOTS, KEPT, KEPT_SCENES, SCENES, find
from tests.replay.replay import Scene, replay, stale

STEPS = {"arducopter-4.5.6": 1202, "arducopter-4.7dev": 1201, "px4-1.17dev": 1142}
KEPT_STEPS = {"arducopter-4.5.6": 259, "arducopter-4.7dev": 258, "px4-1.17dev": 237}


@lru_cache
def played(autopilot: str, scene: str) -> Scene:
    if scene not in KEPT_SCENES and find(autopilot, scene) is None:
        pytest.skip(f"the large recording {autopilot}/{scene} is not in the tree, and not beside it in shared/traces")
    outcome = replay(autopilot, scene)
    assert outcome is not None
    return outcome


@pytest.mark.parametrize(
    "scene", [scene if scene in KEPT_SCENES else pytest.param(scene, marks=pytest.mark.slow) for scene in SCENES]
)
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_every_step_is_the_same_or_differs_as_known(autopilot: str, scene: str) -> None:
    outcome = played(autopilot, scene)
    told = [f"{verdict.t_s:.2f} {verdict.title}: {line}" for verdict, lines in outcome.unlisted for line in lines]
    assert not told, "\n".join(told)


@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_the_scenes_in_the_tree_are_played_to_the_last_step(autopilot: str) -> None:
    assert all(find(autopilot, scene, KEPT) is not None for scene in KEPT_SCENES)
    assert sum(sum(played(autopilot, scene).counts.values()) for scene in KEPT_SCENES) == KEPT_STEPS[autopilot]


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_all_steps_are_played(autopilot: str) -> None:
    counted = sum(sum(played(autopilot, scene).counts.values()) for scene in SCENES)
    assert counted == STEPS[autopilot]


@pytest.mark.slow
def test_every_reason_explains_something() -> None:
    outcomes = [played(autopilot, scene) for autopilot in AUTOPILOTS for scene in SCENES]
    assert stale(outcomes) == []
    assert all(entry.why and entry.line for entry in KNOWN)
