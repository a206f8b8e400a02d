"""Vendor quirks: what is read although the format forbids it. Each is a warning.

The lines of a text file that count have no byte order mark, comments and blank lines.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum

from gcs.errors import FileFormatError

MARK = "\ufeff"
_REMARK = re.compile(r"#|//")


class QuirkKind(StrEnum):
    """A kind of quirk; the value says what readers do with it."""

    VERSION = "An older version of a format (QGC WPL 100 and 120, `.mission`) is read as its program wrote it."
    MARK = "A byte order mark is skipped."
    REMARK = "Comments (# and //), before, between and behind the rows, are skipped."
    BLANK = "Blank lines between the rows are skipped."
    SEPARATOR = "Columns may be separated by blanks, and have blanks around them."
    SEQ = "Wrong, double and missing item numbers: the order of the items counts."
    JUMP = "Jumps in JSON files to a number of the file are changed to the place of the item with it."
    CURRENT = "The column `current` is ignored."
    YAW = "The column `yaw` of QGC WPL 100 is ignored."
    EMPTY = "Empty parameters are 0."
    NO_PLACE = "Empty, null and NaN coordinates of commands without a position are 0."
    ALTITUDE = "The `Altitude` that QGroundControl writes beside the parameters is ignored: parameter 7 counts."
    FRACTION = "In frame 2, parameters 5 and 6 lose their decimals, as on the wire."
    HOME = "A home row in another frame than 0 is home; its altitude counts as AMSL."
    FIRMWARE = "An autopilot that the file names, and that has no row here, yields to `--autopilot`."
    RETURN = "The return point of a list of fence points has no altitude: 0 m above home."
    RALLY = "Break altitude, landing direction and flags of rally points are ignored."
    FENCE_1 = "An empty fence of version 1 in a `.plan` is none."
    FENCE_EMPTY = "Fence polygons without a corner in a `.plan` are skipped."
    RALLY_1 = "Rally points of version 1 in a `.plan` are read as those of version 2."


@dataclass(frozen=True)
class Quirk:
    """One kind of quirk in a file: the line and text of the first, and how many there are."""

    kind: QuirkKind
    source: str
    line: int
    text: str
    count: int = 1

    def __str__(self) -> str:
        return self.text if self.count == 1 else f"{self.text} ({self.count} times in this file; this is the first)"


class QuirkList:
    """The quirks of one file while it is read, one for each kind."""

    def __init__(self, source: str) -> None:
        self._source = source
        self._first: dict[QuirkKind, tuple[int, str]] = {}
        self._counts: dict[QuirkKind, int] = {}

    def add(self, kind: QuirkKind, text: str, line: int | Callable[[], int]) -> None:
        """Count one. Its line is asked for only if it is the first of its kind."""
        if kind not in self._first:
            self._first[kind] = (line() if callable(line) else line, text)
        self._counts[kind] = self._counts.get(kind, 0) + 1

    def found(self) -> tuple[Quirk, ...]:
        """All quirks, in order of their lines."""
        every = [Quirk(kind, self._source, *self._first[kind], count) for kind, count in self._counts.items()]
        return tuple(sorted(every, key=lambda quirk: quirk.line))


def decoded(text: str | bytes, source: str) -> str:
    """The text in a file's bytes. Raises `FileFormatError`."""
    if isinstance(text, str):
        return text
    try:
        return text.decode("utf-8")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{source}: not a text file (byte {error.start}).") from error


def without_mark(text: str, quirks: QuirkList) -> str:
    """A text without its byte order mark."""
    if text.startswith(MARK):
        quirks.add(QuirkKind.MARK, "the file begins with a byte order mark", 1)
    return text.removeprefix(MARK)


def first_line(data: bytes) -> str:
    """The first line that counts; empty if there is none."""
    lines = data.decode("utf-8", errors="replace").removeprefix(MARK).splitlines()
    return next((body for line in lines if (body := _REMARK.split(line, maxsplit=1)[0].strip())), "")


def significant_lines(text: str, quirks: QuirkList) -> Iterator[tuple[int, str]]:
    """The numbered lines that hold something besides comments, without these; blank lines at the end do not count."""
    lines = without_mark(text, quirks).splitlines()
    while lines and not lines[-1].strip():
        lines.pop()
    for number, line in enumerate(lines, start=1):
        body, *remark = _REMARK.split(line, maxsplit=1)
        if remark:
            quirks.add(QuirkKind.REMARK, "a comment, skipped; QGroundControl does not read the file with it", number)
        elif not line.strip():
            quirks.add(QuirkKind.BLANK, "a blank line, skipped; QGroundControl does not read the file with it", number)
        if body.strip():
            yield number, body.rstrip() if remark else body
