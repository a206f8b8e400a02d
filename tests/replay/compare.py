"""Compares what an emulated vehicle said with what the recorded one had said.

Knows: order, timers, repetitions. Does not know: which differences are known.

Dialogue is matched one by one: each recorded message with the first of ours that answers to it and is not too early or
too late. An answer may come in an earlier step here, because the recorded one had a loop and a link to pass. A
message repeated by a timer counts as one with a number of repetitions.
"""

from __future__ import annotations

from collections.abc import Sequence, Set

from tests.replay.player import TIMERS_MAY_DIFFER, Begun, Played
from tests.replay.rates import compare_rates
from tests.replay.recording import Recording
from tests.replay.transcript import STREAM_S, Entry, Verdict, heard, said_here, transcript
from tests.replay.wording import BY_THE_WAY, DIALOGUE, STANDING, differences, equal

_LATENCY_S = 0.25
_TOGETHER_S = 0.05  # messages by the way have no order within this time


def compare(recording: Recording, played: Played, streams: frozenset[str]) -> list[Verdict]:
    """Verdicts of all steps and stretches. `streams` names dialogue that this autopilot sends like telemetry."""
    verdicts = [Verdict(step.title, step.t_s) for step in recording.steps]
    recorded = transcript([heard(step) for step in recording.steps], recording.steps, streams)
    here = transcript([said_here(told) for told in played.told], recording.steps, streams)
    _match(recorded, here, played, verdicts)
    _signatures(recording, played, verdicts)
    return verdicts + compare_rates(recording, played, streams)


def _match(recorded: list[Entry], here: list[Entry], played: Played, verdicts: list[Verdict]) -> None:
    reached = -1  # the last of ours that was matched, in its order
    elsewhere = {(one.said.name, one.said.which) for one in recorded}
    for wanted in recorded:
        found = _find(wanted, here, played.begun, elsewhere)
        report = verdicts[wanted.said.step].differences
        if found is None and (wanted.brief or _said_in_one_go(wanted, here)):
            continue
        if found is None:
            report.append(f"missing {wanted.said}")
            continue
        one = here[found]
        one.matched, one.spare = True, one.times - wanted.times
        report += [f"{wanted.said} {line}" for line in differences(wanted.said, one.said)]
        if one.said.which != wanted.said.which:
            report.append(f"{wanted.said} -> {one.said}")
        if abs(one.times - wanted.times) > max(1, TIMERS_MAY_DIFFER * wanted.times):
            report.append(f"{wanted.said} said {wanted.times} -> {one.times} times")
        if wanted.said.name in STANDING:
            continue
        if found < reached and not _by_the_way(wanted, here[reached]):
            report.append(f"order: {wanted.said} after {here[reached].said}")
        reached = max(reached, found)
    for one in here:
        cut_off = (
            played.ends_s[one.said.step] - one.said.t_s < _LATENCY_S
        )  # the recorded vehicle had no time left to say it
        thinned = one.said.name not in DIALOGUE and one.said.name not in STANDING
        if not (one.matched or cut_off or thinned or one.brief):
            verdicts[one.said.step].differences.append(f"extra {one.said}")


def _said_in_one_go(wanted: Entry, here: list[Entry]) -> bool:
    """Whether it was said just before, together with one that is matched already; then that is used up."""
    missing = wanted.times
    for one in here:
        near = 0.0 <= wanted.said.t_s - one.said.t_s <= _LATENCY_S
        same = one.said.name == wanted.said.name and one.said.which == wanted.said.which
        if one.matched and one.spare > 0 and near and same and equal(wanted.said, one.said):
            used = min(one.spare, missing)
            one.spare, missing = one.spare - used, missing - used
    return missing == 0


def _find(wanted: Entry, here: list[Entry], begun: Sequence[Begun], elsewhere: Set[object]) -> int | None:
    """Which of ours answers to it; failing that, which was said in its place, unless it answers to one `elsewhere`."""
    best: tuple[int, int] | None = None
    for number, one in enumerate(here):
        if one.matched or not _could_be(one, wanted, begun):
            continue
        then, now = one.said.step, wanted.said.step
        same = one.said.which == wanted.said.which
        ranks: tuple[bool, ...] = (
            same and then == now and equal(wanted.said, one.said),
            same and then < now and equal(wanted.said, one.said),
            same and then == now,
            same and then < now,
            same and then > now and equal(wanted.said, one.said),
            then == now and wanted.said.name != "PARAM_VALUE" and (one.said.name, one.said.which) not in elsewhere,
        )
        if wanted.said.name in STANDING:
            lasting = not wanted.brief and not one.brief
            ranks = (equal(wanted.said, one.said), lasting and then == now, lasting)
        rank = next((rank for rank, holds in enumerate(ranks) if holds), None)
        if rank is not None and (best is None or rank < best[0]):
            best = rank, number
    return best[1] if best is not None else None


def _could_be(one: Entry, wanted: Entry, begun: Sequence[Begun]) -> bool:
    if one.said.name != wanted.said.name:
        return False
    if one.first or wanted.first:  # was so before a ground station was there to hear it
        sooner, later = (one, wanted) if one.first else (wanted, one)
        return (one.first and wanted.first) or later.said.t_s <= sooner.said.t_s + STREAM_S
    since = begun[min(one.said.step, wanted.said.step)]
    latency_s = STREAM_S if one.said.name in STANDING or since.by_stream else _LATENCY_S
    since_s = max(wanted.said.t_s - since.t_s, 0.0)
    return abs(one.said.t_s - wanted.said.t_s) <= latency_s + TIMERS_MAY_DIFFER * since_s


def _by_the_way(wanted: Entry, later: Entry) -> bool:
    either = wanted.said.name in BY_THE_WAY or later.said.name in BY_THE_WAY
    return either and abs(wanted.said.t_s - later.said.t_s) <= _LATENCY_S + _TOGETHER_S


def _signatures(recording: Recording, played: Played, verdicts: list[Verdict]) -> None:
    for step, told, verdict in zip(recording.steps, played.told, verdicts, strict=True):
        recorded = {row.signed for row in step.heard if row.name in DIALOGUE}
        here = {one.signed for one in told if one.message.name in DIALOGUE}
        if len(recorded) == len(here) == 1 and recorded != here:
            verdict.differences.append(f"signed: {recorded.pop()} -> {here.pop()}")
