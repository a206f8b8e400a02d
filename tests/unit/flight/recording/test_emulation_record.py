"""What fixes an emulated flight is kept, and two flights are compared bit by bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.errors import FileFormatError
from gcs.flight.contingency.choices import FlightMode, NavigatorChoice, OnLeaderLoss, OnLoss, TimeKeeping
from gcs.flight.recording.emulation_record import (
    EMULATION,
    TRUTH,
    EmulationRecord,
    first_difference_s,
    read_emulation,
    write_emulation,
)
from gcs.flight.setup.simulator_process import Emulated

RECORD = EmulationRecord(
    TimeKeeping(FlightMode.MISSION, emulated=True, navigator=NavigatorChoice.OWN, gates=2),
    Emulated("max", 2**53, ("3:die@60",), "3@270", None),
    follow=False,
    on_loss=OnLoss.RETURN,
    on_leader_loss=OnLeaderLoss.RETURN,
)


def test_what_is_written_is_read(tmp_path: Path) -> None:
    write_emulation(tmp_path, RECORD)
    assert read_emulation(tmp_path) == RECORD


@pytest.mark.parametrize("text", [None, "", "{}", "[]", '{"keeping": 3}'])
def test_a_folder_without_it_is_refused_by_name(tmp_path: Path, text: str | None) -> None:
    if text is not None:
        (tmp_path / EMULATION).write_text(text)
    with pytest.raises(FileFormatError, match=EMULATION):
        read_emulation(tmp_path)


def truth(folder: Path, steps: int, last_bit: tuple[int, int] | None = None) -> Path:
    folder.mkdir(exist_ok=True)
    t_s = np.arange(steps) / 50.0
    state = np.random.default_rng(1).normal(size=(2, 40, 12))[:, :steps].copy()
    if last_bit is not None:
        row, step = last_bit
        state[row, step, 5] = np.nextafter(state[row, step, 5], np.inf)
    np.savez(folder / TRUTH, t_s=t_s, state=state, mode=np.zeros((2, steps), int), sysid=np.array([1, 2]))
    return folder


@given(st.integers(0, 1), st.integers(0, 29))
def test_one_bit_of_one_vehicle_is_found(tmp_path_factory: pytest.TempPathFactory, row: int, step: int) -> None:
    root = tmp_path_factory.mktemp("truths")
    one, same, other = truth(root / "a", 30), truth(root / "b", 30), truth(root / "c", 30, (row, step))
    assert first_difference_s(one, same) is None
    assert first_difference_s(one, other) == first_difference_s(other, one) == step / 50.0


def test_a_longer_flight_is_another_one(tmp_path: Path) -> None:
    one, longer = truth(tmp_path / "a", 30), truth(tmp_path / "b", 33)
    assert first_difference_s(one, longer) == first_difference_s(longer, one) == 30 / 50.0


def test_a_flight_without_true_states_cannot_be_compared(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=TRUTH):
        first_difference_s(tmp_path, tmp_path)
