"""Parameter files of both ground stations, and pymavlink's reading of one of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.errors import FileFormatError
from gcs.mission.formats.param import ParameterFile, read_parameters, write_parameters

VALUES = (("RTL_ALT", 5123), ("FENCE_ALT_MAX", 61.5))


def test_mission_planners_table() -> None:
    text = write_parameters(ParameterFile(Autopilot.ARDUPILOT, 3, VALUES))
    assert text == "# vehicle 3\nRTL_ALT,5123\nFENCE_ALT_MAX,61.5\n"


def test_both_names_of_a_parameter_are_explained() -> None:
    text = write_parameters(ParameterFile(Autopilot.ARDUPILOT, 3, (*VALUES, ("RTL_ALT_M", 51.23))))
    assert text.splitlines()[1].startswith("# renamed parameters stand here under both names")
    assert text.splitlines()[2:] == ["RTL_ALT,5123", "FENCE_ALT_MAX,61.5", "RTL_ALT_M,51.23"]


def test_qgroundcontrols_table() -> None:
    text = write_parameters(ParameterFile(Autopilot.PX4, 3, (("RTL_CONE_ANG", 0), ("RTL_RETURN_ALT", 51.23))))
    assert text.splitlines()[-2:] == ["3\t1\tRTL_CONE_ANG\t0\t6", "3\t1\tRTL_RETURN_ALT\t51.23\t9"]
    assert all(line.startswith("#") for line in text.splitlines()[:-2])


def test_pymavlink_reads_the_same(tmp_path: Path) -> None:
    from pymavlink import mavparm

    path = tmp_path / "uav1.param"
    path.write_text(write_parameters(ParameterFile(Autopilot.ARDUPILOT, 1, VALUES)))
    loaded = mavparm.MAVParmDict()
    assert loaded.load(str(path))
    assert dict(loaded) == dict(VALUES)


def test_what_other_programs_write() -> None:
    text = "#NOTE: made elsewhere\r\nRTL_ALT 1500.000000\r\n\r\nRTL_SPEED\t0\r\n"
    file = read_parameters(text.encode(), "x", Autopilot.ARDUPILOT)
    assert file.values == (("RTL_ALT", 1500.0), ("RTL_SPEED", 0))


@pytest.mark.parametrize(
    ("text", "firmware", "reason"),
    [
        ("RTL_ALT", Autopilot.ARDUPILOT, "line 1: expected NAME,VALUE"),
        ("# x\nRTL_ALT,high", Autopilot.ARDUPILOT, "line 2: 'high' is not a number"),
        ("RTL_ALT,inf", Autopilot.ARDUPILOT, "line 1: 'inf' is not finite"),
        ("rtl_alt,1", Autopilot.ARDUPILOT, "line 1: 'rtl_alt' is not the name"),
        ("RTL_ALT,1\nRTL_ALT,2", Autopilot.ARDUPILOT, "line 2: RTL_ALT has a value already"),
        ("1\t1\tRTL_TYPE\t0", Autopilot.PX4, "line 1: 4 columns instead of 5"),
        ("1\t1\tRTL_TYPE\t0.5\t6", Autopilot.PX4, "line 1: '0.5' of type '6'"),
        ("1\t1\tRTL_TYPE\t0\t77", Autopilot.PX4, "line 1: '0' of type '77'"),
        ("1\t1\tRTL_TYPE\t1e99999\t9", Autopilot.PX4, "line 1: '1e99999' is not finite"),
    ],
)
def test_a_mistake_is_named(text: str, firmware: Autopilot, reason: str) -> None:
    with pytest.raises(FileFormatError, match=f"x, {reason}"):
        read_parameters(text, "x", firmware)


def test_binary_is_not_text() -> None:
    with pytest.raises(FileFormatError, match="not a text file"):
        read_parameters(b"\xff\xfe", "x", Autopilot.PX4)
