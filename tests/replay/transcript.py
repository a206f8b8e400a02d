"""What a vehicle said, as a transcript: dialogue in order, repetitions counted, states only where they are new."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from gcs.link.wire.message import Message
from gcs.mavlink import MavCommand, MessageId
from tests.replay.harness import Told
from tests.replay.recording import Step
from tests.replay.wording import DIALOGUE, REPEATED, STANDING, Wording, equal, wording

STREAM_S = 1.2  # until a stream of 1 Hz tells what is new
_REQUESTS = (MavCommand.REQUEST_MESSAGE, MavCommand.GET_HOME_POSITION)


@dataclass
class Verdict:
    """One step, or one stretch of telemetry, and what differs in it, each difference one line."""

    title: str
    t_s: float
    differences: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Uttered:
    """One message; `count` includes those of its kind that a recording left out before it."""

    t_s: float
    name: str
    message: Message | None
    signed: bool
    count: int = 1


def heard(step: Step) -> list[Uttered]:
    """What the recorded vehicle said in a step."""
    return [Uttered(row.t_s, row.name, row.message, row.signed, 1 + row.more) for row in step.heard]


def said_here(told: Sequence[Told]) -> list[Uttered]:
    """What the emulated vehicle said."""
    return [Uttered(t.t_s, t.message.name, t.message, t.signed) for t in told]


@dataclass
class Entry:
    """A message of the dialogue, repetitions included.

    The `first` word of how things stand was true before a ground station was there to hear it; a `brief`
    one may go unheard.
    """

    said: Wording
    times: int = 1
    matched: bool = False
    first: bool = False
    brief: bool = False
    spare: int = 0  # times that nothing recorded answers to yet


def transcript(uttered: list[list[Uttered]], steps: Sequence[Step], streams: frozenset[str]) -> list[Entry]:
    """The dialogue among what was uttered in each step. `streams` names messages that are sent like telemetry."""
    entries: list[Entry] = []
    standing: dict[str, tuple[object, ...]] = {}
    on_a_timer: dict[object, Entry] = {}
    for step, utterances in zip(steps, uttered, strict=True):
        asked = _asked(step)
        repeated: dict[object, Entry] = {}
        for one in utterances:
            first = False
            if one.name in STANDING and one.message is not None:
                news = tuple(one.message.fields[key] for key in STANDING[one.name])
                if news == standing.get(one.name):
                    continue
                first = one.name not in standing
                standing[one.name] = news
            elif not is_dialogue(one, asked, streams):
                continue
            said = wording(one.t_s, step.number, one.name, one.message)
            key = (said.name, said.which, repr(one.message.fields) if one.message is not None else "")
            known = repeated.get(key) or on_a_timer.get(key)
            if known is not None and one.name not in STANDING:
                known.times += 1
            else:
                repeated[key] = Entry(said, first=first)
                entries.append(repeated[key])
                if one.name in REPEATED:
                    on_a_timer[key] = repeated[key]
    _mark_brief(entries)
    return entries


def _mark_brief(entries: list[Entry]) -> None:
    """Mark what a stream of 1 Hz may well not have told: what soon was otherwise, or again as before that."""
    standing = [one for one in entries if one.said.name in STANDING and one.said.name != "HEARTBEAT"]
    ahead: dict[str, float] = {}  # when the next news of each name came
    for one in reversed(standing):
        one.brief = ahead.get(one.said.name, math.inf) - one.said.t_s < 2.0 * STREAM_S
        ahead[one.said.name] = one.said.t_s
    lasting: dict[str, Wording] = {}
    for one in standing:
        before = lasting.get(one.said.name)
        if not one.brief:
            one.brief = before is not None and equal(before, one.said)
            lasting[one.said.name] = one.said


def is_dialogue(one: Uttered, asked: int | None, streams: frozenset[str]) -> bool:
    """Whether it is dialogue; a message that a step has `asked` for by number is, whatever it is."""
    if one.name == "TIMESYNC" and one.message is not None and one.message.fields["tc1"] == 0:
        return False  # its own questions come on a clock of their own
    if asked is not None and one.message is not None and _number(one) == asked:
        return True
    return one.name in DIALOGUE and one.name not in streams


def _asked(step: Step) -> int | None:
    """The number of the message that the step asks for."""
    message = step.sent.message if step.sent is not None else None
    if message is None or message.name != "COMMAND_LONG" or message.fields["command"] not in _REQUESTS:
        return None
    return (
        int(MessageId.HOME_POSITION)
        if message.fields["command"] == MavCommand.GET_HOME_POSITION
        else round(message.fields["param1"])
    )


def _number(one: Uttered) -> int:
    raw = one.message.raw if one.message is not None else b""
    return int.from_bytes(raw[7:10], "little") if raw[:1] == b"\xfd" else -1
