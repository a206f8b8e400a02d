"""Drawings of the shapes that generators make, in characters, from the places that the planner uses."""

from __future__ import annotations

from gcs.scenario.formations import places_up_m
from gcs.scenario.schema.formation_table import Generator

ROWS: tuple[tuple[tuple[Generator, int], ...], ...] = (
    (("line", 4), ("line", 5), ("column", 4)),
    (("vee", 5), ("triangle", 6), ("grid", 5), ("circle", 6)),
)
_ALONG, _ACROSS = 2, 5  # lines and characters of one spacing
_APART = 6  # characters between drawings

TEXT = """A generator makes places for any number of vehicles. The leader has the first place, the others follow in the
order of their system ids; the drawings have vehicle 1 as the leader. Their front is up: north, or `heading_deg`.

- `line`: abreast. Vehicles 2, 3, 4, ... stand by turns to the right and to the left of the leader. A line of an odd
  number is centred on the leader; an even one has one vehicle more on the right.
- `column`: one behind the other, in order.
- `vee`: two arms that fall back at 45 degrees, by turns on the right and on the left.
- `triangle`: rows of 1, 2, 3, ... behind the leader, each filled from left to right.
- `grid`: rows of equal length, as square as possible; each row is filled from its middle.
- `circle`: the leader in front, the others clockwise.
- `sphere`: the leader is the lowest.

"""


def shape_drawings() -> str:
    """The text and the drawings, as one section of a page."""
    return TEXT + "\n\n".join(f"```text\n{_side_by_side(row)}\n```" for row in ROWS) + "\n"


def drawing(generator: Generator, count: int) -> list[str]:
    """The lines of one drawing: vehicles by number, north up."""
    north, east, _ = places_up_m(generator, count, 1.0).T
    lines, columns = (north.max() - north) * _ALONG, (east - east.min()) * _ACROSS
    drawn = [[" "] * (round(columns.max()) + 1) for _ in range(round(lines.max()) + 1)]
    for number, (line, column) in enumerate(zip(lines, columns, strict=True), start=1):
        drawn[round(line)][round(column)] = str(number)
    return ["".join(line) for line in drawn]


def _side_by_side(row: tuple[tuple[Generator, int], ...]) -> str:
    blocks = [[f"{generator}, {count}", "", *drawing(generator, count)] for generator, count in row]
    height = max(map(len, blocks))
    lines = []
    for index in range(height):
        parts = []
        for block in blocks:
            width = max(map(len, block)) + _APART
            parts.append((block[index] if index < len(block) else "").ljust(width))
        lines.append("".join(parts).rstrip())
    return "\n".join(lines)
