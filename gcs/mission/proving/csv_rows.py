"""A file of trajectories, and the rows of a CSV file with their line numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gcs.errors import FileFormatError, UsageError
from gcs.types import Array
from gcs.util.bounded_file import as_utf8

ROWS_MAX = 2_000_000
_COLUMNS_MAX = 200
_NED_AXES = {"ned": ((0, 1, 2), (1, 1, 1)), "enu": ((1, 0, 2), (1, 1, -1)), "nwu": ((0, 1, 2), (1, -1, -1))}
FRAMES = tuple(_NED_AXES)


@dataclass(frozen=True)
class TrackFile:
    """The bytes of a file, its name in errors, and the frame of its x, y, z where the caller states one."""

    data: bytes
    source: str
    stem: str
    frame: str | None = None

    def __post_init__(self) -> None:
        if self.frame not in (None, *FRAMES):
            raise UsageError(f"the frame {self.frame} is not known", hint=f"give {', '.join(FRAMES)}")

    @property
    def is_text(self) -> bool:
        """Whether the bytes are a text in UTF-8 (or UTF-16 with a mark)."""
        return self._text is not None

    @property
    def text(self) -> str:
        """The text of the file. Raises `FileFormatError` where it is none."""
        if self._text is None:
            hint = "give CSV, .setpoints, .skyc or mission files, text as UTF-8; a plan is proved by `gcs verify`"
            raise FileFormatError(f"{self.source}: not a text.", hint=hint)
        return self._text

    @cached_property
    def _text(self) -> str | None:
        try:
            return as_utf8(self.data).decode("utf-8-sig")
        except ValueError:
            return None

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Lines that hold something, with their numbers: cells without blanks. A first line may begin with a hash.

        Comments are left out. One with as many cells as the row before may be data: it is refused.
        """
        count = width = 0
        for number, line in enumerate(self.text.split("\n"), start=1):
            body = line.strip()
            if count == 0 and re.match(r"#\s*(?:duration|t\b|time)", body, re.I):
                body = body.removeprefix("#")
            if not body or body.startswith("#"):
                if width and len(_cells(body)) == width:
                    what = "a row begins with a hash: it may be a comment, or a vehicle's sample"
                    raise self.mistake(number, what, "remove the row, or write the name of the vehicle without a hash")
                continue
            count += 1
            if count > ROWS_MAX:
                raise self.mistake(number, f"more than {ROWS_MAX:,} rows", "give fewer samples")
            if len(body) > _COLUMNS_MAX * 100:
                raise self.mistake(number, f"the line has {len(body):,} characters", "give a table of numbers")
            cells = _cells(body)
            width = len(cells) if len(cells) > 1 else 0
            yield number, cells

    def mistake(self, line: int, what: str, hint: str) -> FileFormatError:
        """The error about one line."""
        return FileFormatError(f"{self.source}, line {line}: {what}.", hint=hint)

    def number(self, cell: str, column: str, line: int) -> float:
        """A finite number. Raises `FileFormatError`."""
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.mistake(line, f"{column} must be a finite number, got '{cell[:40]}'", "correct this row")
        return value


def _cells(body: str) -> list[str]:
    cells = [cell.strip().strip('"') for cell in re.split(r"[,;\t]", body)]
    return cells[:-1] if len(cells) > 1 and not cells[-1] else cells


def is_number(cell: str) -> bool:
    """Whether a cell holds a number, not the name of a column."""
    try:
        float(cell)
    except ValueError:
        return False
    return True


def in_ned(xyz: Array, frame: str) -> Array:
    """Vectors (..., 3) in NED of vectors in a frame of `FRAMES`."""
    axes, signs = _NED_AXES[frame]
    return xyz[..., list(axes)] * np.array(signs, dtype=np.float64)
