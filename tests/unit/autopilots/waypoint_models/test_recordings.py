"""The navigators against recorded flights of real autopilots (`tests/recorded/timed_legs`), each one left out in turn.

The free values are chosen on the two other missions, out of a grid that knows nothing of the values in use.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest

from gcs.autopilots.traits import Autopilot
from gcs.types import Array
from tools.fit_navigator import MISSIONS, MODELS, RECORDINGS, Model, errors_s, fit, read_recording

# What vehicles may have: lags of 0.05 to 0.2 s and drags of 0.1 to 0.5 1/s; integrals that give back up to three times,
# heights that are off by up to 0.6 m.
GRIDS = {
    "ardupilot": ((0.05, 0.1, 0.2), (0.1, 0.25, 0.4)),
    "px4": ((0.5, 1.25, 2.0, 3.0), (0.3, 0.45, 0.6)),
}
GOALS_S = {"ardupilot": 0.5, "px4": 2.0}  # RMS of all waypoints of a mission that was not fitted
SHORTEST = {"ardupilot": "b", "px4": "c"}  # to fit
EACH = pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)


class Residual(NamedTuple):
    """Predicted minus recorded arrival times of one mission, s."""

    navigator: str
    mission: str
    rms_s: float
    mean_s: float
    worst_s: float
    unseen_rms_s: float  # with values fitted to the other two missions


RESIDUALS = (
    Residual("ardupilot", "a", 0.13, -0.02, -0.18, 0.16),
    Residual("ardupilot", "b", 0.06, 0.05, 0.12, 0.37),
    Residual("ardupilot", "c", 0.08, -0.03, -0.16, 0.10),
    Residual("px4", "a", 0.77, 0.30, 1.28, 1.28),
    Residual("px4", "b", 0.72, -0.44, -1.31, 0.95),
    Residual("px4", "c", 0.38, -0.08, -1.20, 1.76),
)


def rms_s(error_s: Array) -> float:
    return float(np.sqrt(np.mean(error_s**2)))


@lru_cache
def tried(model: Model) -> dict[tuple[float, ...], dict[str, Array]]:
    """The errors (N,) at each recording's waypoints, for each pair of values of the grid."""
    recordings = [read_recording(RECORDINGS / model.folder, name) for name in MISSIONS]
    values = product(*GRIDS[model.name])
    return {pair: {one.name: errors_s(model.make(pair), one) for one in recordings} for pair in values}


@pytest.mark.slow
@EACH
@pytest.mark.parametrize("mission", MISSIONS)
def test_a_mission_that_was_not_fitted_is_predicted(model: Model, mission: str) -> None:
    found = tried(model)
    others = [name for name in MISSIONS if name != mission]
    best = min(found, key=lambda pair: sum(rms_s(found[pair][name]) ** 2 for name in others))
    unseen = found[best][mission]
    print(f"{model.name} {mission}: {best}, rms {rms_s(unseen):.2f} s, worst {unseen[np.abs(unseen).argmax()]:+.2f}")
    assert rms_s(unseen) <= GOALS_S[model.name]


@EACH
@pytest.mark.parametrize("mission", MISSIONS)
def test_the_prediction_is_better_than_the_times_that_were_asked_for(model: Model, mission: str) -> None:
    """Length over speed, what a mission asks for, is off by several times as much."""
    recording = read_recording(RECORDINGS / model.folder, mission)
    places = np.vstack([recording.orders.start_ned_m, recording.orders.waypoints_ned_m])
    asked_s = np.cumsum(np.linalg.norm(np.diff(places[:, :2], axis=0), axis=1) / recording.orders.speeds_mps)
    predicted = errors_s(Autopilot.named(model.name).navigator, recording)
    assert rms_s(predicted) < 0.25 * rms_s(asked_s - recording.passed_s)


@pytest.mark.parametrize("residual", RESIDUALS, ids=lambda r: f"{r.navigator}-{r.mission}")
def test_the_table_of_residuals_is_what_the_recordings_say(residual: Residual) -> None:
    model = next(model for model in MODELS if model.name == residual.navigator)
    recording = read_recording(RECORDINGS / model.folder, residual.mission)
    error = errors_s(Autopilot.named(residual.navigator).navigator, recording)
    assert rms_s(error) == pytest.approx(residual.rms_s, abs=0.03)
    assert error.mean() == pytest.approx(residual.mean_s, abs=0.03)
    assert error[np.abs(error).argmax()] == pytest.approx(residual.worst_s, abs=0.05)


BEYOND = (("a", 0.07, 0.25, 10.0), ("b", 0.07, 0.25, 4.2), ("c", 0.21, 0.95, 2.1))


@pytest.mark.parametrize(("mission", "rms_beyond_s", "worst_s", "wide_s"), BEYOND)
def test_what_px4_was_recorded_to_do_lies_between_the_ends_of_what_it_may_do(
    mission: str, rms_beyond_s: float, worst_s: float, wide_s: float
) -> None:
    """Two vehicles differ besides by twice the square root of two times the RMS outside of both ends."""
    recording = read_recording(RECORDINGS / "px4-1.17dev", mission)
    early_s, late_s = (errors_s(end, recording) for end in Autopilot.PX4.navigator.reactions)
    beyond_s = np.maximum(early_s, 0.0) + np.minimum(late_s, 0.0)
    assert rms_s(beyond_s) <= rms_beyond_s
    assert np.abs(beyond_s).max() <= worst_s
    assert wide_s - 0.3 < (late_s - early_s).max() <= wide_s
    assert 2.0 * np.sqrt(2.0) * rms_beyond_s <= 0.6 < Autopilot.PX4.traits.apart_s


@pytest.mark.parametrize(
    "residual",
    [
        pytest.param(r, marks=pytest.mark.slow if r.mission == SHORTEST[r.navigator] else pytest.mark.long)
        for r in RESIDUALS
    ],
    ids=lambda r: f"{r.navigator}-{r.mission}",
)
def test_the_errors_of_missions_without_fit_are_those_of_the_table(residual: Residual) -> None:
    model = next(model for model in MODELS if model.name == residual.navigator)
    recordings = {name: read_recording(RECORDINGS / model.folder, name) for name in MISSIONS}
    left_out = recordings.pop(residual.mission)
    unseen = rms_s(errors_s(model.make(fit(model, list(recordings.values()))), left_out))
    assert unseen == pytest.approx(residual.unseen_rms_s, abs=0.1)
