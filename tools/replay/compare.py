"""Compares what an emulated vehicle said with what the recorded one had said.

Knows: order, timers, repetitions, rates. Does not know: which differences are meant.

Talk is matched one by one: each recorded saying with the first of ours that answers to it and is not too early or
too late. An answer may come in an earlier step here, because the recorded one had a loop and a link to pass. A
saying repeated by a timer counts as one with a number of repetitions. Telemetry is compared by kind and rate over
stretches in which nobody changed the rates.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from gcs.link.dialect import MavCommand
from gcs.link.message import Message
from tools.replay.player import TIMERS_MAY_DIFFER, Played
from tools.replay.recording import Recording, Step
from tools.replay.saying import BY_THE_WAY, TALK, Saying, differences, equal, saying
from tools.replay.stage import Told

_LATENCY_S = 0.25
_TOGETHER_S = 0.05  # sayings by the way have no order within this time
_SHORTEST_STRETCH_S = 2.5
_REQUESTS = (MavCommand.REQUEST_MESSAGE, MavCommand.GET_HOME_POSITION)
_RATES = (MavCommand.SET_MESSAGE_INTERVAL,)


@dataclass
class Verdict:
    """One step, or one stretch of telemetry, and what differs in it, each difference one line."""

    title: str
    t_s: float
    differences: list[str] = field(default_factory=list)


def compare(recording: Recording, played: Played, streams: frozenset[str]) -> list[Verdict]:
    """Verdicts of all steps and stretches. `streams` names talk that this autopilot sends like telemetry."""
    verdicts = [Verdict(step.title, step.t_s) for step in recording.steps]
    recorded = _talk([_heard(step) for step in recording.steps], recording.steps, streams)
    here = _talk([_said(told) for told in played.told], recording.steps, streams)
    _match(recorded, here, recording.steps, verdicts)
    _signatures(recording, played, verdicts)
    return verdicts + _stretches(recording, played, streams)


@dataclass(frozen=True)
class _Uttered:
    t_s: float
    name: str
    message: Message | None
    signed: bool
    count: int = 1


def _heard(step: Step) -> list[_Uttered]:
    return [_Uttered(row.t_s, row.name, row.message, row.signed, 1 + row.more) for row in step.heard]


def _said(told: Sequence[Told]) -> list[_Uttered]:
    return [_Uttered(t.t_s, t.message.name, t.message, t.signed) for t in told]


@dataclass
class _Talk:
    """A saying, repetitions included."""

    said: Saying
    times: int = 1
    last_s: float = 0.0
    matched: bool = False
    first_beat: bool = False


def _talk(uttered: list[list[_Uttered]], steps: Sequence[Step], streams: frozenset[str]) -> list[_Talk]:
    talk: list[_Talk] = []
    beat: tuple[object, ...] = ()
    for step, utterances in zip(steps, uttered, strict=True):
        asked = _asked(step)
        repeated: dict[object, _Talk] = {}
        for one in utterances:
            first_beat = False
            if one.name == "HEARTBEAT" and one.message is not None:
                f = one.message.fields
                news = (f["type"], f["autopilot"], f["base_mode"], f["custom_mode"], f["system_status"])
                if news == beat:
                    continue
                first_beat, beat = not beat, news
            elif not _is_talk(one, asked, streams):
                continue
            said = saying(one.t_s, step.number, one.name, one.message)
            key = (said.name, said.which, repr(one.message.fields) if one.message is not None else "")
            known = repeated.get(key)
            if known is not None:
                known.times += 1
                known.last_s = one.t_s
            else:
                repeated[key] = _Talk(said, last_s=one.t_s, first_beat=first_beat)
                talk.append(repeated[key])
    return talk


def _is_talk(one: _Uttered, asked: int | None, streams: frozenset[str]) -> bool:
    if one.name == "TIMESYNC" and one.message is not None and one.message.fields["tc1"] == 0:
        return False  # its own questions come on a clock of their own
    if asked is not None and one.message is not None and _number(one) == asked:
        return True
    return one.name in TALK and one.name not in streams


def _asked(step: Step) -> int | None:
    """The number of the message that the step asks for."""
    message = step.sent.message if step.sent is not None else None
    if message is None or message.name != "COMMAND_LONG" or message.fields["command"] not in _REQUESTS:
        return None
    return 242 if message.fields["command"] == MavCommand.GET_HOME_POSITION else round(message.fields["param1"])


def _number(one: _Uttered) -> int:
    raw = one.message.raw if one.message is not None else b""
    return int.from_bytes(raw[7:10], "little") if raw[:1] == b"\xfd" else -1


def _match(recorded: list[_Talk], here: list[_Talk], steps: Sequence[Step], verdicts: list[Verdict]) -> None:
    reached = -1  # the last of ours that was matched, in its order
    for wanted in recorded:
        found = _find(wanted, here, steps)
        report = verdicts[wanted.said.step].differences
        if found is None:
            report.append(f"missing {wanted.said}")
            continue
        one = here[found]
        one.matched = True
        report += [f"{wanted.said} {line}" for line in differences(wanted.said, one.said)]
        if one.said.which != wanted.said.which:
            report.append(f"{wanted.said} -> {one.said}")
        if abs(one.times - wanted.times) > max(1, TIMERS_MAY_DIFFER * wanted.times):
            report.append(f"{wanted.said} said {wanted.times} -> {one.times} times")
        if wanted.first_beat:
            continue
        if found < reached and not _by_the_way(wanted, here[reached]):
            report.append(f"order: {wanted.said} after {here[reached].said}")
        reached = max(reached, found)
    end_s = steps[-1].end_s
    for one in here:
        cut_off = end_s - one.said.t_s < _LATENCY_S  # the recorded vehicle had no time left to say it
        thinned = one.said.name not in TALK and one.said.name != "HEARTBEAT"
        if not (one.matched or cut_off or thinned):
            verdicts[one.said.step].differences.append(f"extra {one.said}")


def _find(wanted: _Talk, here: list[_Talk], steps: Sequence[Step]) -> int | None:
    """Which of ours answers to it; failing that, which was said in its place."""
    near = [n for n, one in enumerate(here) if not one.matched and _could_be(one, wanted, steps)]
    same = [n for n in near if here[n].said.which == wanted.said.which]
    exact = [n for n in same if equal(wanted.said, here[n].said)]
    by_then = [n for n in same if here[n].said.step <= wanted.said.step]
    in_its_place = [n for n in near if here[n].said.step == wanted.said.step and wanted.said.name != "PARAM_VALUE"]
    return next(iter(exact or by_then or in_its_place), None)


def _could_be(one: _Talk, wanted: _Talk, steps: Sequence[Step]) -> bool:
    if one.said.name != wanted.said.name:
        return False
    if one.first_beat or wanted.first_beat:
        return one.first_beat and wanted.first_beat  # heartbeats have a clock of their own
    since_s = max(wanted.said.t_s - steps[min(one.said.step, wanted.said.step)].t_s, 0.0)
    return abs(one.said.t_s - wanted.said.t_s) <= _LATENCY_S + TIMERS_MAY_DIFFER * since_s


def _by_the_way(wanted: _Talk, later: _Talk) -> bool:
    either = wanted.said.name in BY_THE_WAY or later.said.name in BY_THE_WAY
    return either and abs(wanted.said.t_s - later.said.t_s) <= _LATENCY_S + _TOGETHER_S


def _signatures(recording: Recording, played: Played, verdicts: list[Verdict]) -> None:
    for step, told, verdict in zip(recording.steps, played.told, verdicts, strict=True):
        recorded = {row.signed for row in step.heard if row.name in TALK}
        here = {one.signed for one in told if one.message.name in TALK}
        if len(recorded) == len(here) == 1 and recorded != here:
            verdict.differences.append(f"signed: {recorded.pop()} -> {here.pop()}")


def _stretches(recording: Recording, played: Played, streams: frozenset[str]) -> list[Verdict]:
    """Telemetry between changes of rates."""
    cuts = [step.t_s for step in recording.steps if _changes_rates(step)]
    edges = [recording.steps[0].t_s, *cuts, recording.end_s]
    recorded = [one for step in recording.steps for one in _heard(step)]
    here = [one for told in played.told for one in _said(told)]
    verdicts = []
    for start_s, end_s in pairwise(edges):
        if end_s - start_s < _SHORTEST_STRETCH_S:
            continue
        verdict = Verdict(f"telemetry from {start_s:.1f} to {end_s:.1f} s", start_s)
        theirs, ours = (_counted(said, start_s, end_s, streams) for said in (recorded, here))
        for name in sorted(theirs.keys() | ours.keys()):
            verdict.differences += _rate(name, theirs[name], ours[name], end_s - start_s)
        verdicts.append(verdict)
    return verdicts


def _changes_rates(step: Step) -> bool:
    message: Message | None = step.sent.message if step.sent is not None else None
    return message is not None and message.name == "COMMAND_LONG" and message.fields["command"] in _RATES


def _counted(said: list[_Uttered], start_s: float, end_s: float, streams: frozenset[str]) -> Counter[str]:
    counted: Counter[str] = Counter()
    for one in said:
        question = one.name == "TIMESYNC" and not _is_talk(one, None, frozenset())
        if start_s <= one.t_s < end_s and (one.name not in TALK or one.name in streams or question):
            counted[one.name] += one.count
    return counted


def _rate(name: str, theirs: int, ours: int, seconds: float) -> list[str]:
    if abs(theirs - ours) <= max(1.5, TIMERS_MAY_DIFFER * theirs):
        return []
    if not ours:
        return [f"no {name}"]
    if not theirs:
        return [f"unheard-of {name}"]
    return [f"rate of {name}: {theirs / seconds:.2f} -> {ours / seconds:.2f} Hz"]
