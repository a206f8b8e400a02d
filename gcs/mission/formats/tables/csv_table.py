"""Tables of numbers as CSV below a few lines of comment: what they are, how many rows they have, their units.

Knows: comments (`# name (remark): value`), header, exact numbers, how to tell that rows are missing. Does not know:
what the columns mean. Comments may be missing; then nobody notices rows that were cut off.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping

import pyarrow as pa
import pyarrow.csv as arrow_csv


def write_csv(title: str, told: Mapping[str, str], units: Mapping[str, str], table: pa.Table) -> bytes:
    """The bytes of a file with the columns of `units`, in their order; `told` become comments."""
    lines = [f"# {title}", *(f"# {name}: {value}" for name, value in told.items())]
    lines += [f"# rows: {table.num_rows}", f"# units: {','.join(units.values())}", ",".join(units), ""]
    buffer = io.BytesIO()
    buffer.write("\n".join(lines).encode())
    arrow_csv.write_csv(table.select(list(units)), buffer, arrow_csv.WriteOptions(include_header=False))
    return buffer.getvalue()


def read_csv(data: bytes | str, units: Mapping[str, str]) -> tuple[dict[str, str], pa.Table]:
    """What the comments tell, and the table in float64. Raises ValueError with line and reason."""
    data = (data.encode() if isinstance(data, str) else data).removeprefix(b"\xef\xbb\xbf")
    comments, body = _split(data, ",".join(units))
    told = dict(filter(None, map(_named, comments)))
    if not body.strip():
        raise ValueError("no rows")
    try:
        table = arrow_csv.read_csv(
            io.BytesIO(body),
            arrow_csv.ReadOptions(use_threads=False, column_names=list(units)),
            arrow_csv.ParseOptions(quote_char=False, ignore_empty_lines=False),
            arrow_csv.ConvertOptions(
                column_types=dict.fromkeys(units, pa.float64()), null_values=[], strings_can_be_null=False
            ),
        )
    except pa.ArrowInvalid as error:
        raise ValueError(_with_line(str(error), len(comments) + 1)) from error
    if told.get("rows", str(table.num_rows)) != str(table.num_rows):
        raise ValueError(f"{told['rows'][:20]} rows are announced, but there are {table.num_rows}")
    if told.get("units", ",".join(units.values())) != ",".join(units.values()):
        raise ValueError(f"units are {told['units'][:120]}, not {','.join(units.values())}")
    return told, table


def _split(data: bytes, header: str) -> tuple[list[str], bytes]:
    """The comment lines, and everything below the header."""
    comments = []
    while data.startswith(b"#"):
        line, _, data = data.partition(b"\n")
        comments.append(line.decode("utf-8", errors="replace").strip())
    head, _, body = data.partition(b"\n")
    if head.strip() != header.encode():
        raise ValueError(f"line {len(comments) + 1} is not the header '{header}'")
    return comments, body


def _named(comment: str) -> tuple[str, str] | None:
    found = re.fullmatch(r"# (\w+)(?: \([^)]*\))?: (.*)", comment)
    return (found[1], found[2]) if found else None


def _with_line(message: str, above: int) -> str:
    """Arrow counts rows; people count lines."""
    found = re.search(r"Row #(\d+): (.*)", message, re.S)
    return f"line {int(found[1]) + above}: {found[2][:120]}" if found else message[:120]
