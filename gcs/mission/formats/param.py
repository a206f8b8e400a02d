"""Parameter files: `.param` for Mission Planner and MAVProxy, `.params` for QGroundControl.

A line of a `.param` file is `NAME,VALUE`. A line of a `.params` file holds vehicle, component, name, value and
MAV_PARAM_TYPE, separated by tabs. A parameter that a newer version renamed stands in a file under both names, each in
its own unit: a vehicle takes the names that it has.
"""

import math
import re
from dataclasses import dataclass

from gcs.autopilots.columns import ParameterFileStyle
from gcs.autopilots.parameter_names import has_new_names
from gcs.autopilots.traits import Autopilot
from gcs.errors import FileFormatError

_COMPONENT = 1  # the autopilot
_INT32, _REAL32 = 6, 9  # MAV_PARAM_TYPE
_NAME = re.compile(r"[A-Z0-9_]{1,16}")
_COLUMNS = 5


@dataclass(frozen=True)
class ParameterFile:
    """Contents of one file. Values of integer parameters are ints: PX4 stores and sends them differently."""

    firmware: Autopilot
    sysid: int
    values: tuple[tuple[str, int | float], ...]


def write_parameters(file: ParameterFile) -> str:
    """The text of a file; `read_parameters` gives back the same values."""
    if file.firmware.traits.parameter_file is ParameterFileStyle.QGROUNDCONTROL:
        lines = [f"# Onboard parameters for Vehicle {file.sysid}", "#", "# Vehicle-Id Component-Id Name Value Type"]
        lines += [
            f"{file.sysid}\t{_COMPONENT}\t{name}\t{value!r}\t{_INT32 if isinstance(value, int) else _REAL32}"
            for name, value in file.values
        ]
    else:
        lines = [f"# vehicle {file.sysid}"]
        if has_new_names(file.firmware, dict(file.values)):
            lines.append("# renamed parameters stand here under both names; a vehicle takes those of its version")
        lines += [f"{name},{value!r}" for name, value in file.values]
    return "\n".join(lines) + "\n"


def read_parameters(text: str | bytes, source: str, firmware: Autopilot) -> ParameterFile:
    """Contents of a file in the style of `firmware`. Raises `FileFormatError` with file, line and reason."""
    try:
        lines = (text if isinstance(text, str) else text.decode("utf-8-sig")).splitlines()
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{source}: not a text file (byte {error.start}).") from error
    sysid = 0
    values: dict[str, int | float] = {}
    for number, line in enumerate(lines, start=1):
        try:
            found = re.fullmatch(r"# (?:vehicle|Onboard parameters for Vehicle) (\d{1,9})", line.strip())
            if found:
                sysid = int(found[1])
            if not line.strip() or line.lstrip().startswith("#"):
                continue
            name, value = _ROWS[firmware.traits.parameter_file](line)
            if not _NAME.fullmatch(name):
                raise ValueError(f"'{name[:40]}' is not the name of a parameter")
            if name in values:
                raise ValueError(f"{name} has a value already")
            values[name] = value
        except ValueError as error:
            raise FileFormatError(f"{source}, line {number}: {error}.") from error
    return ParameterFile(firmware, sysid, tuple(values.items()))


def _mission_planner(line: str) -> tuple[str, int | float]:
    parts = re.split(r"[,\s]+", line.strip())
    if len(parts) != 2:
        raise ValueError("expected NAME,VALUE")
    whole = re.fullmatch(r"[+-]?\d{1,10}", parts[1])
    return parts[0], int(parts[1]) if whole else _number(parts[1])


def _qgroundcontrol(line: str) -> tuple[str, int | float]:
    parts = line.split()
    if len(parts) != _COLUMNS:
        raise ValueError(f"{len(parts)} columns instead of {_COLUMNS}")
    if parts[4] == str(_REAL32):
        return parts[2], _number(parts[3])
    if not (re.fullmatch(r"[1-8]", parts[4]) and re.fullmatch(r"[+-]?\d{1,10}", parts[3])):
        raise ValueError(f"'{parts[3][:20]}' of type '{parts[4][:20]}' is not a number")
    return parts[2], int(parts[3])


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"'{text[:40]}' is not a number") from None
    if not math.isfinite(value):
        raise ValueError(f"'{text[:40]}' is not finite")
    return value


_ROWS = {ParameterFileStyle.MISSION_PLANNER: _mission_planner, ParameterFileStyle.QGROUNDCONTROL: _qgroundcontrol}
