"""A flight over a hill at one height above the ground, as a person would write it."""

from __future__ import annotations

from pathlib import Path

from gcs.frames import Origin
from gcs.scenario.sources.template import FirstFlight, scenario_text

_HEIGHT_M = 30.0
_ROUTE = "{ position_m = [80.0, 30.0] }", "{ position_m = [180.0, -20.0] }"
_HILL = """
[terrain]
mountains = { north_m = [120.0, 60.0], east_m = [10.0, -60.0], height_m = [25.0, 15.0], spread_north_m = [50.0, 40.0], \
spread_east_m = [60.0, 40.0] }
"""


def hill_scenario(folder: Path, *changes: tuple[str, str]) -> Path:
    """The file of the flight, with some of its text replaced."""
    flight = FirstFlight(3, "line", 10.0, 0.0, 250.0, _HEIGHT_M)
    text = scenario_text(Path("hill"), Origin(-35.363262, 149.165237, 584.0), flight=flight) + _HILL
    legs = f"route = [{', '.join(_ROUTE)}]\nlegs = {{ height_above_ground_m = {_HEIGHT_M} }}\n"
    lines = []
    for line in text.split("\n"):
        if line.startswith(("start =", "end =")):
            line = line.replace(f", {_HEIGHT_M}]", "]")  # noqa: PLW2901
        lines += ["time = { flight_s = 120.0 }", legs] if line.startswith("time =") else [line]
    text = "\n".join(lines)
    for old, new in (("height_m = [0.0, 50.0]", "height_m = [0.0, 90.0]"), *changes):
        assert old in text, old
        text = text.replace(old, new)
    file = folder / "scenario.toml"
    file.write_text(text, encoding="utf-8")
    return file
