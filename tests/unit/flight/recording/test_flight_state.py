"""The state of a flight on disk: broken ones are passed over, and one process holds a flight."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from gcs.errors import FileFormatError, UsageError
from gcs.flight.recording.flight_state import NAME, held_folder, newest_unfinished, read_flight_state

STATE = {
    "format": "skein-flight-1",
    "mission": "hop",
    "plan_hash": "",
    "links": ["udpin:127.0.0.1:1"],
    "systems": {},
    "mode": "stream",
    "follow": False,
    "step": "flying",
    "t0_unix_s": 1.0,
    "pid": 1 << 22,
}


def flight(root: Path, name: str, text: str, age_s: float = 0.0) -> Path:
    folder = root / name
    folder.mkdir()
    state = folder / NAME
    state.write_text(text)
    at_s = state.stat().st_mtime - age_s
    os.utime(state, (at_s, at_s))
    return folder


@pytest.mark.parametrize(
    "text",
    [
        "",
        '{"format": "skein-fl',
        "null",
        "[1, 2]",
        json.dumps(STATE | {"format": "skein-flight-9"}),
        json.dumps(STATE | {"mode": "balloon"}),
        json.dumps(STATE | {"step": "lunch"}),
        json.dumps(STATE | {"t0_unix_s": "noon"}),
        json.dumps(STATE | {"pid": None}),
        json.dumps(STATE | {"systems": {"1": "x"}}),
        json.dumps(STATE | {"links": None}),
    ],
)
def test_a_broken_state_is_passed_over_and_told(tmp_path: Path, text: str) -> None:
    before = flight(tmp_path, "before", json.dumps(STATE), 60.0)
    broken = flight(tmp_path, "broken", text)
    with pytest.raises(FileFormatError, match=NAME):
        read_flight_state(broken)
    said: list[str] = []
    assert newest_unfinished(tmp_path, said.append) == before
    (line,) = said
    assert str(broken) in line and "passed over" in line


def test_a_folder_is_held_by_one_process(tmp_path: Path) -> None:
    folder = flight(tmp_path, "now", json.dumps(STATE))
    refused = pytest.raises(UsageError, match="still flown by process 4194304")
    with held_folder(folder), refused, held_folder(folder):
        pass
    with held_folder(folder):
        pass


def test_a_number_that_belongs_to_a_later_process_holds_nothing(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as later:
        text = json.dumps(STATE | {"pid": later.pid})
        with pytest.raises(UsageError, match=str(later.pid)), held_folder(flight(tmp_path, "now", text)):
            pass
        if Path("/proc/uptime").exists():
            with held_folder(flight(tmp_path, "yesterday", text, 86_400.0)):
                pass
        later.kill()
