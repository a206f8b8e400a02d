"""The lines of a text file that count: without byte order mark, comments and blank lines, which are counted."""

from __future__ import annotations

import re
from collections.abc import Iterator

from gcs.errors import FileFormatError
from gcs.mission.formats.foreign.oddities import Odd, OddityList

MARK = "\ufeff"
_REMARK = re.compile(r"#|//")


def decoded(text: str | bytes, source: str) -> str:
    """The text in a file's bytes. Raises `FileFormatError`."""
    if isinstance(text, str):
        return text
    try:
        return text.decode("utf-8")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{source}: not a text file (byte {error.start}).") from error


def without_mark(text: str, oddities: OddityList) -> str:
    """A text without its byte order mark."""
    if text.startswith(MARK):
        oddities.add(Odd.MARK, "the file begins with a byte order mark", 1)
    return text.removeprefix(MARK)


def first_line(data: bytes) -> str:
    """The first line that counts; empty if there is none."""
    lines = data.decode("utf-8", errors="replace").removeprefix(MARK).splitlines()
    return next((body for line in lines if (body := _REMARK.split(line, maxsplit=1)[0].strip())), "")


def significant_lines(text: str, oddities: OddityList) -> Iterator[tuple[int, str]]:
    """The numbered lines that hold something besides comments, without these; blank lines at the end do not count."""
    lines = without_mark(text, oddities).splitlines()
    while lines and not lines[-1].strip():
        lines.pop()
    for number, line in enumerate(lines, start=1):
        body, *remark = _REMARK.split(line, maxsplit=1)
        if remark:
            oddities.add(Odd.REMARK, "a comment, skipped; QGroundControl does not read the file with it", number)
        elif not line.strip():
            oddities.add(Odd.BLANK, "a blank line, skipped; QGroundControl does not read the file with it", number)
        if body.strip():
            yield number, body.rstrip() if remark else body
