"""The navigators compared with recorded flights of real autopilots, if the recordings are available."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.autopilots.navigation.calibration import RESIDUALS, Residual
from gcs.autopilots.traits import Autopilot
from tools.fit_navigator import MODELS, RECORDINGS, errors_s, read_recording

FOLDERS = {model.name: RECORDINGS / model.folder for model in MODELS}
GOALS_S = {"ardupilot": 1.5, "px4": 2.0}


@pytest.mark.parametrize("residual", RESIDUALS, ids=lambda r: f"{r.navigator}-{r.mission}")
def test_arrivals_are_predicted_as_well_as_the_table_says(residual: Residual) -> None:
    folder = FOLDERS[residual.navigator]
    if not (folder / f"timed_legs_{residual.mission}.jsonl.gz").exists():
        pytest.skip(f"no recording timed_legs_{residual.mission} of {folder.name}")
    error = errors_s(Autopilot.named(residual.navigator).navigator, read_recording(folder, residual.mission))
    assert np.sqrt(np.mean(error**2)) == pytest.approx(residual.rms_s, abs=0.03)
    assert error.mean() == pytest.approx(residual.mean_s, abs=0.03)
    assert error[np.abs(error).argmax()] == pytest.approx(residual.worst_s, abs=0.05)


def test_the_errors_on_missions_without_fit_are_within_the_goals() -> None:
    assert len(RESIDUALS) == 6
    for residual in RESIDUALS:
        assert residual.unseen_rms_s <= GOALS_S[residual.navigator], residual
