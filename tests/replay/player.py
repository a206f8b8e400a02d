"""Plays the ground station's part of a recording to an emulated vehicle.

Knows: when the recorded ground station spoke, and what it had been waiting for. Does not know: what a difference is.

The ground station's frames go out at the recorded times. Where it had reacted to an answer, or to news, it waits for
that here too, as long as timers and flights may differ; everything after that is later, or sooner, by so much.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from gcs.frames import Origin, from_degE7
from gcs.link.wire.message import Message
from gcs.mavlink import MavCommand, ModeFlag
from gcs.scenario.schema.scenario import Scenario
from sim_bridge.dynamics.airframes import CONTROL_PERIOD_S
from sim_bridge.personality import Personality
from tests.replay.harness import Harness, Told
from tests.replay.recording import Recording, Row, Step
from tests.replay.transcript import STREAM_S
from tests.replay.wording import BY_THE_WAY, DIALOGUE, STANDING, wording

TIMERS_MAY_DIFFER = 0.2
_REACTION_S = 0.03  # what came no longer ago is what the ground station had waited for
_PATIENCE_S = 0.15
_SHORT_S = 1.0  # a step so short is not worth making shorter
_TURN_S = 1.01 * CONTROL_PERIOD_S
_FROM_POWER_ON = {"connect", "arm_refusals"}
_Key = tuple[str, tuple[object, ...], tuple[object, ...]]  # a message's name, which one it is, how things stand


@dataclass(frozen=True)
class Begun:
    """What a step's timers count from: when that was, and whether a stream's news were waited for."""

    t_s: float
    by_stream: bool


@dataclass
class Played:
    """What the vehicle said in each step; times are those of the recording."""

    told: list[list[Told]] = field(default_factory=list)
    begun: list[Begun] = field(default_factory=list)
    ends_s: list[float] = field(default_factory=list)  # the end of the scene, dated as what was said in each step


def play(recording: Recording, personality: Personality, scenario: Scenario, streams: frozenset[str]) -> Played:
    """Play all steps; what the vehicle says is dated in the recording's time. `streams` that no step waits for."""
    boots_s = _boot_s(recording)
    harness = Harness(
        personality if boots_s is None else personality.booting_for_real(),
        scenario,
        recording.vehicle,
        _home(recording, scenario),
        boots_s=boots_s,
        epoch_unix_s=_epoch_unix_s(recording),
        standing=frozenset(STANDING),
    )
    if boots_s is None:
        harness.prepare(_mode(recording), _left_over(recording), keep=DIALOGUE | STANDING.keys())
    played = Played()
    clock_s, before, begin = recording.steps[0].t_s, 0, 0
    awaited, lates_s = _awaited(recording, streams), list[float]()
    for step in recording.steps:
        late_s = clock_s - step.t_s
        if step.sent is not None:
            harness.receive(step.sent.frame, clock_s)
        streamed = _streamed(step, bool(awaited[step.number]))
        for row in streamed:
            harness.run_until(row.t_s + late_s)
            harness.receive(row.frame, row.t_s + late_s)
        stands = {t.message.name: t.message for t in harness.told[:begin] if t.message.name in STANDING}
        known = {_key(name, message) for name, message in stands.items()}
        known |= {_key(t.message.name, t.message) for t in _acks(harness.told[before:begin], clock_s)}
        clock_s = max(clock_s, streamed[-1].t_s + late_s if streamed else clock_s)
        clock_s = _let_pass(step, harness, begin, (step.t_s + late_s, clock_s), awaited[step.number] - known)
        answer = step.sent is not None and step.sent.name == "TIMESYNC" and not _asks_time(step.sent)
        came = awaited[step.number - 1] if step.number else set()
        if (step.sent is not None and not answer) or came or not played.begun:
            begun = Begun(step.t_s, any(name in STANDING for name, *_ in came))
        played.begun.append(begun)
        played.told.append([Told(t.t_s - late_s, t.message, t.signed) for t in harness.told[begin:]])
        before, begin = begin, len(harness.told)
        lates_s.append(late_s)
    played.ends_s = [clock_s - late_s for late_s in lates_s]
    return played


def _let_pass(step: Step, harness: Harness, begin: int, clock: tuple[float, float], awaited: set[_Key]) -> float:
    """Let a step's time pass, until the vehicle has said what is awaited, within what its timers may differ.

    `clock` is when the step began, and now.
    """
    length_s, slack_s = step.end_s - step.t_s, _slack_s(step)
    start_s, now_s = clock
    news = any(name in STANDING for name, *_ in awaited)
    patience_s = TIMERS_MAY_DIFFER * length_s + STREAM_S if news else slack_s
    clock_s = max(start_s + (length_s - slack_s if awaited and length_s > _SHORT_S else length_s), now_s)
    harness.run_until(clock_s)
    said = {_key(t.message.name, t.message) for t in harness.told[begin:]}
    while not awaited <= said and clock_s < start_s + length_s + patience_s:
        heard = len(harness.told)
        clock_s += _TURN_S
        harness.run_until(clock_s)
        said |= {_key(t.message.name, t.message) for t in harness.told[heard:]}
    return clock_s


def _slack_s(step: Step) -> float:
    return TIMERS_MAY_DIFFER * (step.end_s - step.t_s) + _PATIENCE_S


def _streamed(step: Step, awaits: bool) -> list[Row]:
    """What is streamed to the vehicle; heartbeats at the end of a step that may be shorter here are left out."""
    if not awaits or step.end_s - step.t_s <= _SHORT_S:
        return step.streamed
    until_s = step.end_s - _slack_s(step)
    return [row for row in step.streamed if row.name != "HEARTBEAT" or row.t_s <= until_s]


def _awaited(recording: Recording, streams: frozenset[str]) -> list[set[_Key]]:
    """What the ground station had waited for at the end of each step: answers, and news of how things stand."""
    standing: dict[str, object] = {}
    awaited: list[set[_Key]] = []
    for step in recording.steps:
        wanted = set[_Key]()
        for row in step.heard:
            key = _key(row.name, row.message)
            new = row.name in STANDING and standing.get(row.name) not in (None, key)
            if row.name in STANDING:
                standing[row.name] = key
            reacted = step.end_s - row.t_s <= _REACTION_S
            if reacted and (new or (row.name in DIALOGUE - BY_THE_WAY - streams and not _asks_time(row))):
                wanted.add(key)
        awaited.append(wanted)
    return awaited


def _acks(told: list[Told], now_s: float) -> list[Told]:
    """Acknowledgements just now: where the recorded vehicle sent one twice, the second came later."""
    return [one for one in told if one.message.name == "COMMAND_ACK" and now_s - one.t_s <= _PATIENCE_S]


def _asks_time(row: Row) -> bool:
    return row.name == "TIMESYNC" and row.message is not None and row.message.fields["tc1"] == 0


def _key(name: str, message: Message | None) -> _Key:
    said = wording(0.0, 0, name, message)
    news = tuple(said.fields.get(field) for field in STANDING.get(name, ()))
    if name == "HEARTBEAT":  # scripts wait for modes, and for motors
        news = said.fields.get("custom_mode"), int(said.fields.get("base_mode", 0)) & ModeFlag.ARMED
    return said.name, said.which, news


def _mode(recording: Recording) -> int:
    """The mode in which the recorded vehicle was when the scene began."""
    beats = (row.message for _, row in recording.heard() if row.name == "HEARTBEAT" and row.message)
    return int(next(beats).fields["custom_mode"])


def _left_over(recording: Recording) -> dict[int, float]:
    """Intervals in seconds, by message number, in which the recorded vehicle sent when the scene began; inf is never.

    Rates are left over from earlier scenes: they are not requested here.
    """
    counts: Counter[int] = Counter()
    until_s: dict[int, float] = {}
    for step in recording.steps:
        message = step.sent.message if step.sent is not None else None
        if message is not None and message.fields.get("command") == MavCommand.SET_MESSAGE_INTERVAL:
            until_s.setdefault(round(message.fields["param1"]), step.t_s)
    for _, row in recording.heard():
        if row.name not in DIALOGUE and row.message is not None:
            number = int.from_bytes(row.frame[7:10], "little")
            if row.t_s < until_s.get(number, recording.end_s):
                counts[number] += 1 + row.more
    return {number: until_s.get(number, recording.end_s) / count for number, count in counts.items()}


def _home(recording: Recording, scenario: Scenario) -> Origin:
    """Where the recorded vehicle stood; at the scenario's origin where it never told."""
    fixed = [row.message.fields for _, row in recording.heard() if row.name == "GLOBAL_POSITION_INT" and row.message]
    fields = next((f for f in fixed if f["lat"]), None)
    if fields is None:
        return Origin(scenario.origin.lat_deg, scenario.origin.lon_deg, scenario.origin.alt_amsl_m)
    alt_mm = fields["alt"] - fields["relative_alt"]
    return Origin(from_degE7(fields["lat"]), from_degE7(fields["lon"]), alt_mm / 1000.0)


def _boot_s(recording: Recording) -> float | None:
    """When the vehicle was switched on; None if that was before the recording."""
    first: Row = next(row for _, row in recording.heard())
    console = first.name == "BAD_DATA"
    return first.t_s if console or recording.scene in _FROM_POWER_ON else None


def _epoch_unix_s(recording: Recording) -> float:
    """Unix time of the recording's beginning, as its vehicle had it; a fixed day where it never told."""
    for _, row in recording.heard():
        if row.name == "SYSTEM_TIME" and row.message and row.message.fields["time_unix_usec"]:
            return float(row.message.fields["time_unix_usec"]) / 1e6 - row.t_s
    return 1_795_264_000.0
