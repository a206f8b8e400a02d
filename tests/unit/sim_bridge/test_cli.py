"""Arguments of `sim-bridge`."""

from __future__ import annotations

import pytest

from gcs.errors import UsageError
from sim_bridge.cli import parse_ground, parse_speedup


@pytest.mark.parametrize("text", ["x", "0", "-1", "nan", "inf"])
def test_wrong_speedups(text):
    with pytest.raises(UsageError):
        parse_speedup(text)


@pytest.mark.parametrize("text", ["14550", "host:", ":14550", "host:0", "host:99999"])
def test_wrong_grounds(text):
    with pytest.raises(UsageError):
        parse_ground(text)
