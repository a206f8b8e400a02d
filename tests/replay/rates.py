"""Telemetry: which kinds of message come, and how often.

Knows: stretches of time in which the rates did not change. Does not know: what the messages say.
"""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

from gcs.mavlink import MavCommand
from tests.replay.player import TIMERS_MAY_DIFFER, Played
from tests.replay.recording import Recording, Step
from tests.replay.transcript import Uttered, Verdict, heard, is_dialogue, said_here
from tests.replay.wording import DIALOGUE

_SHORTEST_S = 2.5
_EDGES = 1.5  # messages that fall on this or that side of a stretch's ends


def compare_rates(recording: Recording, played: Played, streams: frozenset[str]) -> list[Verdict]:
    """Verdicts of all stretches, each with the kinds that come at another rate, not at all, or unheard of."""
    cuts = [step.t_s for step in recording.steps if _changes_rates(step)]
    edges = [recording.steps[0].t_s, *cuts, recording.end_s]
    recorded = [one for step in recording.steps for one in heard(step)]
    here = [one for told in played.told for one in said_here(told)]
    verdicts = []
    for start_s, end_s in pairwise(edges):
        if end_s - start_s < _SHORTEST_S:
            continue
        verdict = Verdict(f"telemetry from {start_s:.1f} to {end_s:.1f} s", start_s)
        theirs, ours = (_counted(said, start_s, end_s, streams) for said in (recorded, here))
        for name in sorted(theirs.keys() | ours.keys()):
            verdict.differences += _rate(name, theirs[name], ours[name], end_s - start_s)
        verdicts.append(verdict)
    return verdicts


def _changes_rates(step: Step) -> bool:
    message = step.sent.message if step.sent is not None else None
    return (
        message is not None
        and message.name == "COMMAND_LONG"
        and message.fields["command"] == MavCommand.SET_MESSAGE_INTERVAL
    )


def _counted(said: list[Uttered], start_s: float, end_s: float, streams: frozenset[str]) -> Counter[str]:
    counted: Counter[str] = Counter()
    for one in said:
        question = one.name == "TIMESYNC" and not is_dialogue(one, None, frozenset())
        if start_s <= one.t_s < end_s and (one.name not in DIALOGUE or one.name in streams or question):
            # what was left out before the first one was left out of the stretch before
            counted[one.name] += one.count if counted[one.name] else 1
    return counted


def _rate(name: str, theirs: int, ours: int, seconds: float) -> list[str]:
    fewest = theirs / (1.0 + TIMERS_MAY_DIFFER) - _EDGES
    most = theirs / (1.0 - TIMERS_MAY_DIFFER) + _EDGES  # it is the interval that may differ by so much
    if fewest <= ours <= most:
        return []
    if not ours:
        return [f"no {name}"]
    if not theirs:
        return [f"unheard-of {name}"]
    return [f"rate of {name}: {theirs / seconds:.2f} -> {ours / seconds:.2f} Hz"]
