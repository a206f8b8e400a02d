"""Arguments of `sim-bridge`."""

from __future__ import annotations

import pytest

from gcs.errors import UsageError, read_error_text
from sim_bridge.cli import parse_ground, parse_speedup, run


@pytest.mark.parametrize("text", ["x", "0", "-1", "nan", "inf"])
def test_wrong_speedups(text):
    with pytest.raises(UsageError):
        parse_speedup(text)


@pytest.mark.parametrize("text", ["14550", "host:", ":14550", "host:0", "host:99999"])
def test_wrong_grounds(text):
    with pytest.raises(UsageError):
        parse_ground(text)


def test_gcs_reads_an_error_of_the_simulator_as_it_was_raised(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["mission", "--udp", "host:", "--check"]) == UsageError.exit_code
    with pytest.raises(UsageError) as raised:
        parse_ground("host:")
    assert read_error_text(capsys.readouterr().err) == (raised.value.message, raised.value.hint)
