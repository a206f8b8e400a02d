"""Recorded parameters that appear twice: in the emulated vehicle's table, and in the navigator that predicts it."""

from __future__ import annotations

import pytest

from gcs.autopilots.traits import Autopilot
from sim_bridge.personality import by_name


@pytest.mark.parametrize("known", Autopilot)
def test_the_navigator_has_the_recorded_parameters(known: Autopilot) -> None:
    values = {param.name: param.value for param in by_name(known.key).params}
    for name, assumed in known.navigator.parameters.items():
        assert assumed == pytest.approx(values[name]), name
