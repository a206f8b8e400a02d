"""The picture of a proof: a call for every failure and for the nearest pair, at its place and time."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib import pyplot as plt

import gcs
from gcs.flight.plots.proof_plot import draw_proof
from gcs.mission.proving.timed_samples import through


def crossing(beside_m: float) -> list[gcs.PolynomialTrack]:
    """Two that cross at (10, 10) at 5 s, one of them so far beside it."""
    ends = np.array(
        [[[0.0, 10.0, -10.0], [20.0, 10.0, -10.0]], [[10.0 + beside_m, 0.0, -10.0], [10.0 + beside_m, 20.0, -10.0]]]
    )
    return [gcs.PolynomialTrack(name, through(np.array([0.0, 10.0]), of)) for name, of in zip("ab", ends, strict=True)]


@pytest.mark.parametrize(("limits", "calls"), [({}, 1), ({"speed_mps": 1.5}, 2), ({"speed_mps": 3.0}, 1)])
def test_every_failed_check_and_the_nearest_pair_are_marked(limits: dict[str, float], calls: int) -> None:
    tracks = crossing(0.2)
    report = gcs.prove(tracks, gcs.TrackLimits(0.1, **limits))
    figure = draw_proof(tracks, report, None)
    chart, *panels = figure.axes
    texts = [text.get_text() for text in chart.texts if text.get_text()]
    assert len(texts) == calls
    assert any(text.startswith("separation: 0.14") and text.endswith(("at 5.0 s", "at 5.1 s")) for text in texts)
    assert len(panels) == 3
    marks = [line for line in chart.lines if line.get_marker() == "o"]
    assert len(marks) == calls
    np.testing.assert_allclose(
        np.mean([line.get_xydata().mean(axis=0) for line in marks], axis=0), [10.0, 10.0], atol=0.5
    )
    title = figure.get_suptitle()
    assert title == ("proved at every instant" if report.ok else "NOT proved: 1 of 3 checks")
    plt.close(figure)


def test_one_vehicle_alone_has_no_panel_of_separation() -> None:
    (alone, _) = crossing(0.0)
    figure = draw_proof([alone], gcs.prove([alone], gcs.TrackLimits(speed_mps=5.0)), None)
    assert len(figure.axes) == 3
    plt.close(figure)


def test_a_hundred_vehicles_have_no_legend(simulation1: gcs.Scenario) -> None:
    places = np.stack([np.array([[10.0 * n, 100.0, -30.0], [10.0 * n, 300.0, -30.0]]) for n in range(100)])
    tracks = [gcs.PolynomialTrack(f"v{n}", through(np.array([0.0, 100.0]), of)) for n, of in enumerate(places)]
    figure = draw_proof(tracks, gcs.prove(tracks, gcs.TrackLimits(5.0), simulation1), simulation1)
    legend = figure.axes[0].get_legend()
    assert legend is None or all("v1" not in text.get_text() for text in legend.get_texts())
    plt.close(figure)
