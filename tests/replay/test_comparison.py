"""The replay tool sees what it should: made-up recordings, each with one thing that differs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message, Station
from tests.replay.compare import compare
from tests.replay.harness import Told
from tests.replay.known_differences import KnownDifference
from tests.replay.player import Begun, Played
from tests.replay.recording import Recording, Row, Step, read

VEHICLE = Station(1, 1)
ATTITUDE = {"time_boot_ms": 0, **dict.fromkeys(("roll", "pitch", "yaw", "rollspeed", "pitchspeed", "yawspeed"), 0.0)}
BEAT = {"type": 2, "autopilot": 3, "base_mode": 81, "custom_mode": 0, "system_status": 3, "mavlink_version": 3}
NO_STREAMS = frozenset[str]()


def over_the_wire(name: str, fields: dict, source: Station = VEHICLE) -> Message:
    (message,) = Codec(9, 9).decode(Codec(*source).encode(Message(name, fields)))
    return message


def ack(result: int = 0, kind: int = 0) -> tuple[str, dict]:
    return "MISSION_ACK", {"target_system": 255, "target_component": 190, "type": result, "mission_type": kind}


def request(seq: int) -> tuple[str, dict]:
    return "MISSION_REQUEST", {"target_system": 255, "target_component": 190, "seq": seq, "mission_type": 0}


def text(words: str) -> tuple[str, dict]:
    return "STATUSTEXT", {"severity": 6, "text": words, "id": 0, "chunk_seq": 0}


def ground(command: int, *params: float) -> Row:
    values = (*params, *(0.0,) * (7 - len(params)))
    fields = {"target_system": 1, "target_component": 1, "command": command, "confirmation": 0}
    fields |= {f"param{n}": value for n, value in enumerate(values, start=1)}
    return Row(0.0, "COMMAND_LONG", over_the_wire("COMMAND_LONG", fields, Station(255, 190)))


def scene(*steps, length_s: float = 1.0, sent: dict[int, Row] | None = None) -> tuple[Recording, Played]:
    """Steps of `length_s`, each a pair: what was recorded, and what is said here, as (t after its beginning, what)."""
    made, told = [], []
    for number, (recorded, here) in enumerate(steps):
        start_s = number * length_s
        step = Step(number, start_s, f"step {number}", (sent or {}).get(number), end_s=start_s + length_s)
        step.heard = [Row(start_s + t, what[0], over_the_wire(*what)) for t, what in recorded]
        made.append(step)
        told.append([Told(start_s + t, over_the_wire(*what), signed=False) for t, what in here])
    begun = [Begun(step.t_s, by_stream=False) for step in made]
    ends_s = [made[-1].end_s] * len(made)
    return Recording("arducopter-4.5.6", "made up", tuple(made), VEHICLE), Played(told, begun, ends_s)


def found(*steps, **kwargs) -> list[str]:
    return [line for verdict in compare(*scene(*steps, **kwargs), NO_STREAMS) for line in verdict.differences]


SILENT = ([], [])


def test_the_same_is_the_same_and_an_answer_may_come_a_little_sooner():
    first = [(0.1, request(0)), (0.2, ack())], [(0.0, request(0)), (0.0, ack())]
    assert found(first, SILENT) == []
    assert found(([], [(0.95, ack())]), ([(0.05, ack())], []), SILENT) == []


def test_missing_and_extra():
    assert found(([(0.1, ack())], []), SILENT) == ["missing MISSION_ACK 255 0"]
    assert found(([], [(0.1, ack())]), SILENT) == ["extra MISSION_ACK 255 0"]


def test_what_comes_as_the_recording_ends_may_have_been_cut_off():
    assert found(([], [(0.9, ack())])) == []


def test_a_result_that_differs():
    assert found(([(0.1, ack(0))], [(0.1, ack(3))]), SILENT) == ["MISSION_ACK 255 0 type: 0 -> 3"]


def test_something_else_in_its_place():
    assert found(([(0.1, request(1))], [(0.1, request(2))]), SILENT) == ["MISSION_REQUEST 1 0 -> MISSION_REQUEST 2 0"]


def test_order_counts_but_not_for_what_is_said_by_the_way():
    backwards = [(0.1, request(0)), (0.2, ack())], [(0.1, ack()), (0.2, request(0))]
    assert found(backwards, SILENT) == ["order: MISSION_ACK 255 0 after MISSION_REQUEST 0 0"]
    words = text("so it is")
    assert found(([(0.1, ack()), (0.11, words)], [(0.1, words), (0.11, ack())]), SILENT) == []


@pytest.mark.parametrize(("t_s", "good"), [(8.0, True), (9.4, True), (6.7, True), (10.0, False), (6.0, False)])
def test_timers_may_differ_by_a_fifth(t_s, good):
    differences = found(([(8.0, ack(15))], [(t_s, ack(15))]), SILENT, length_s=20.0)
    assert (differences == []) == good


@pytest.mark.parametrize(("t_s", "good"), [(1.1, True), (3.0, False)])
@pytest.mark.parametrize("began", [Begun(0.0, by_stream=False), Begun(20.0, by_stream=True)])
def test_timers_count_from_what_was_done_last_and_no_finer_than_the_stream_that_was_waited_for(t_s, good, began):
    recording, played = scene(SILENT, ([(0.0, ack(15))], [(t_s, ack(15))]), SILENT, length_s=20.0)
    played.begun[1] = Begun(14.0, by_stream=False) if not began.by_stream else began
    assert ([d for v in compare(recording, played, NO_STREAMS) for d in v.differences] == []) == good


def test_what_is_said_twice_at_once_answers_to_what_was_said_again_a_little_later():
    twice = ([(0.1, ack())], [(0.1, ack()), (0.1, ack())])
    assert found(twice, ([(0.0, ack())], []), SILENT, length_s=0.2) == []
    assert found(twice, ([(0.0, ack(3))], []), SILENT, length_s=0.2) == ["missing MISSION_ACK 255 0"]
    assert found(([(0.1, ack())], [(0.1, ack())]), ([(0.0, ack())], []), SILENT, length_s=0.2) == [
        "missing MISSION_ACK 255 0"
    ]


@pytest.mark.parametrize(("times", "good"), [(9, True), (11, True), (4, False)])
def test_items_reached_are_counted_over_all_steps(times, good):
    def reached(count: int) -> list:
        return [(1.0 * n, ("MISSION_ITEM_REACHED", {"seq": 2})) for n in range(count)]

    recorded, here = reached(10), reached(times)
    assert (found((recorded[:1], here[:1]), (recorded[1:], here[1:]), SILENT, length_s=15.0) == []) == good


@pytest.mark.parametrize(("times", "good"), [(20, True), (17, True), (24, True), (15, False), (25, False)])
def test_so_may_the_number_of_repetitions(times, good):
    recorded = [(0.25 * n, request(3)) for n in range(20)]
    here = [(0.25 * n, request(3)) for n in range(times)]
    assert (found((recorded, here), SILENT, length_s=10.0) == []) == good


def test_of_heartbeats_only_what_is_new_counts():
    same = [(0.1 * n, ("HEARTBEAT", BEAT)) for n in range(3)]
    assert found((same, same[1:]), SILENT) == []
    armed = [*same, (0.4, ("HEARTBEAT", BEAT | {"base_mode": 209}))]
    assert found((armed, same), SILENT) == ["missing HEARTBEAT"]
    differs = [(0.1, ("HEARTBEAT", BEAT | {"custom_mode": 4}))]
    assert found((same, differs), SILENT) == ["HEARTBEAT custom_mode: 0 -> 4"]


def test_how_things_stand_counts_unless_it_soon_is_otherwise():
    def current(*parts: tuple[float, int]) -> list:
        """MISSION_CURRENT at 2 Hz: from so many seconds on, that item."""
        told, until = [], [*(t for t, _ in parts[1:]), 10.0]
        for (from_s, seq), to_s in zip(parts, until, strict=True):
            fields = {"seq": seq, "total": 7, "mission_state": 2, "mission_mode": 0}
            told += [(from_s + 0.5 * n, ("MISSION_CURRENT", fields)) for n in range(round((to_s - from_s) * 2))]
        return told

    def differ(recorded: list, here: list) -> list[str]:
        return found((recorded, here), SILENT, length_s=10.0)

    assert differ(current((0, 0), (5, 3)), current((0, 0), (5.5, 3))) == []
    assert differ(current((0, 0), (5, 3)), current((0, 0), (5, 1), (5.5, 3))) == []
    assert differ(current((0, 0), (5, 1), (5.5, 3)), current((0, 0), (5.5, 3))) == []
    assert differ(current((0, 0), (5, 1), (5.5, 0)), current((0, 0))) == []
    assert differ(current((0, 0), (5, 3)), current((0, 0), (5, 2))) == ["MISSION_CURRENT seq: 3 -> 2"]
    assert differ(current((0, 0), (5, 3)), current((0, 0))) == ["missing MISSION_CURRENT"]
    assert differ(current((0, 0)), current((0, 0), (5, 3))) == ["extra MISSION_CURRENT"]
    assert differ(current((0, 1)), current((0, 0))) == ["MISSION_CURRENT seq: 1 -> 0"]


def test_telemetry_counts_by_kind_and_rate():
    def attitudes(count: int) -> list:
        return [(3.0 * n / count, ("ATTITUDE", ATTITUDE)) for n in range(count)]

    assert found((attitudes(30), attitudes(35)), length_s=3.0) == []
    assert found((attitudes(30), attitudes(40)), length_s=3.0) == ["rate of ATTITUDE: 10.00 -> 13.33 Hz"]
    assert found((attitudes(30), []), length_s=3.0) == ["no ATTITUDE"]
    assert found(([], attitudes(30)), length_s=3.0) == ["unheard-of ATTITUDE"]


def test_telemetry_that_was_asked_for_has_to_come():
    what = [(0.1, ("ATTITUDE", ATTITUDE))]
    assert found((what, []), SILENT, sent={0: ground(512, 30.0)}) == ["missing ATTITUDE"]
    assert found((what, what), SILENT, sent={0: ground(512, 30.0)}) == []


def test_signatures_count():
    recording, played = scene(([(0.1, ack())], [(0.1, ack())]), SILENT)
    row = recording.steps[0].heard[0]
    recording.steps[0].heard[0] = Row(row.t_s, row.name, row.message, signed=True)
    assert [d for v in compare(recording, played, NO_STREAMS) for d in v.differences] == ["signed: True -> False"]


def test_a_file_is_cut_into_steps(tmp_path: Path):
    def row(t_s: float, direction: str, name: str, fields: dict, source: Station) -> dict:
        frame = Codec(*source).encode(Message(name, fields))
        return {"t": t_s, "dir": direction, "name": name, "hex": frame.hex()}

    mine = Station(255, 190)
    ask = {"target_system": 1, "target_component": 1, "param_id": "RTL_ALT", "param_index": -1}
    rows = [
        {"t": 0.0, "dir": "note", "text": "scene"},
        row(0.5, "veh->gcs", "HEARTBEAT", BEAT, VEHICLE),
        row(1.0, "gcs->veh", "HEARTBEAT", BEAT, mine),
        row(1.5, "gcs->veh", "PARAM_REQUEST_READ", ask, mine),
        {"t": 1.6, "dir": "veh->gcs", "name": "BAD_DATA", "hex": "3020"},
        row(1.7, "veh->gcs", "ATTITUDE", ATTITUDE, VEHICLE) | {"thinned": 4},
        {"t": 2.0, "dir": "note", "text": "end"},
    ]
    path = tmp_path / "some autopilot" / "made_up.jsonl"
    path.parent.mkdir()
    path.write_text("\n".join(map(json.dumps, rows)), encoding="utf-8")
    recording = read(path)
    assert (recording.autopilot, recording.scene, recording.vehicle) == ("some autopilot", "made_up", VEHICLE)
    assert [(step.t_s, step.end_s, len(step.heard)) for step in recording.steps] == [
        (0.0, 1.5, 1),
        (1.5, 2.0, 2),
        (2.0, 2.0, 0),
    ]
    assert [row.name for row in recording.steps[0].streamed] == ["HEARTBEAT"]
    assert recording.steps[1].title == "scene: PARAM_REQUEST_READ param_id=RTL_ALT param_index=-1"
    assert recording.steps[1].heard[1].more == 4


def test_a_known_difference_covers_by_place_and_line():
    entry = KnownDifference("px4-*", "params", r"missing PARAM_VALUE CAL_\S+", "no such parts")
    assert entry.covers("px4-1.17dev", "params", "missing PARAM_VALUE CAL_MAG0_ID")
    assert not entry.covers("px4-1.17dev", "connect", "missing PARAM_VALUE CAL_MAG0_ID")
    assert not entry.covers("arducopter-4.5.6", "params", "missing PARAM_VALUE CAL_MAG0_ID")
    assert not entry.covers("px4-1.17dev", "params", "missing PARAM_VALUE MPC_XY_CRUISE")
