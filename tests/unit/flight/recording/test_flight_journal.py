"""What a flight tells while it lasts: by the vehicles' time, with the last T0, and whatever the screen does."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from gcs.flight.monitoring.progress import Event, Step
from gcs.flight.recording.flight_record import FlightJournal
from gcs.flight.recording.flight_state import FlightState, read_flight_state
from gcs.link.protocols.mission.strategy import SentAs, Transfer
from gcs.link.session.unknown_systems import LinkNotice


def test_a_flight_is_recorded_by_its_own_time_though_its_screen_is_gone(tmp_path: Path) -> None:
    def gone(text: str) -> None:
        raise OSError(5, text)

    journal = FlightJournal(
        tmp_path, FlightState("hop", "0" * 64, (), {2: 7}, "stream", False, "", None, 1), gone, gone
    )
    with journal.record:
        journal.on_notice(LinkNotice(7, "was heard twice"))
        time: Any = SimpleNamespace(now_s=lambda: 1700.0)
        journal.keep_time(time)
        journal.on_sent({1: SentAs(Transfer.FILE, "asked for")})
        journal.on_step(Step.FLY, 1650.0)
        journal.on_notice(LinkNotice(7, "was heard twice"))
        journal.on_step(Step.LAND, None)
        journal.on_event(Event(1701.0, 51.0, 1, "ordered to land"))
    lines = [json.loads(line) for line in (tmp_path / "events.jsonl").read_text().splitlines()]
    assert [(line["unix_s"], line["t_s"], line["sysid"]) for line in lines] == [
        (None, None, 2),
        (1700.0, 50.0, 2),
        (1701.0, 51.0, 1),
    ]
    state = read_flight_state(tmp_path)
    assert (state.step, state.t0_unix_s) == (Step.LAND, 1650.0)
    assert state.missions == ({"vehicle": 1, "sent_as": "file", "why": "asked for"},)
