"""Orders between the first armed vehicle and T0: the start waits for `continue`, or all vehicles land on their pads."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gcs
from gcs.errors import FlightError
from gcs.flight.assessment.judge import load_truth
from gcs.flight.monitoring.progress import AskedOrder, InFlight, Watcher
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan

pytestmark = pytest.mark.slow
HELD_S = 6.0


class Operator(Watcher):
    """Orders to hold in the take-off, and then what it is given."""

    def __init__(self, then: AskedOrder) -> None:
        self.then = then
        self.held_at = ""

    async def follow(self, flight: InFlight) -> None:
        while not all(flight.snapshot().armed.values()):
            await asyncio.sleep(0.02)
        self.held_at = flight.snapshot().phase
        flight.ask(AskedOrder.HOLD, by="a test")
        await asyncio.sleep(HELD_S)
        assert flight.snapshot().plan_time_s is None, "T0 is not fixed while the start is held"
        flight.ask(self.then, by="a test")
        await asyncio.Future()


def flown(plan: Plan, to: Path, then: AskedOrder) -> tuple[gcs.Flown | FlightError, list[dict[str, Any]], Path]:
    operator = Operator(then)
    try:
        found: gcs.Flown | FlightError = gcs.fly(plan, emulated=gcs.Emulated("5"), to=to, watcher=operator)
    except FlightError as failure:
        found = failure
    assert operator.held_at == "take-off"
    (folder,) = [one for one in to.iterdir() if one.is_dir()]
    return found, [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()], folder


def test_a_start_that_was_held_is_flown_later_as_planned(hop: Plan, tmp_path: Path) -> None:
    found, events, _ = flown(hop, tmp_path, AskedOrder.CONTINUE)
    assert isinstance(found, gcs.Flown) and found.verdict is not None and found.verdict.ok
    held, on = [one for one in events if "were asked to" in one["what"]]
    assert held["rule"].startswith("the start waits: vehicles 1, 2, 3 brake and hold until the next order")
    assert on["data"]["by"] == "a test"
    assert found.times.t0_unix_s > on["unix_s"] > held["unix_s"] + HELD_S


def test_an_aborted_start_lands_all_on_their_pads(hop: Plan, tmp_path: Path) -> None:
    found, events, folder = flown(hop, tmp_path, AskedOrder.LAND)
    assert isinstance(found, FlightError)
    assert found.message.startswith("the start was aborted: land ordered by a test")
    ends = load_truth(folder / "truth.npz").states[:, -1, POSITION]
    assert np.linalg.norm(ends - hop.pads_ned_m, axis=1).max() < 1.0
    assert "ordered to land where they are" in [one["what"] for one in events]
