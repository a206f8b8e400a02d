"""Tables of numbers as CSV below comments: title, values by name, number of rows, units.

A comment has the form `# name (remark): value`. Comments may be missing; missing rows are then not found.
"""

import io
import re
from collections.abc import Mapping

import pyarrow as pa
import pyarrow.csv as arrow_csv

_UNITS = {"sysid": "1", "s": "s", "m": "m", "mps": "m/s", "mps2": "m/s2", "rad": "rad", "radps": "rad/s"}
_UNITS |= {"N": "N", "Nm": "N m"}


def with_units(names: str) -> dict[str, str]:
    """The units of columns by name: names end in their units, for readers that lose the comments."""
    return {name: _UNITS[name.rpartition("_")[2]] for name in names.split()}


def write_csv(title: str, comments: Mapping[str, str], units: Mapping[str, str], table: pa.Table) -> bytes:
    """The bytes of a file with the columns of `units`, in their order, below these comments."""
    lines = [f"# {title}", *(f"# {name}: {value}" for name, value in comments.items())]
    lines += [f"# rows: {table.num_rows}", f"# units: {','.join(units.values())}", ",".join(units), ""]
    buffer = io.BytesIO()
    buffer.write("\n".join(lines).encode())
    arrow_csv.write_csv(table.select(list(units)), buffer, arrow_csv.WriteOptions(include_header=False))
    return buffer.getvalue()


def read_csv(data: bytes | str, units: Mapping[str, str]) -> tuple[dict[str, str], pa.Table]:
    """The comments by name, and the table in float64. Raises ValueError with line and reason."""
    data = (data.encode() if isinstance(data, str) else data).removeprefix(b"\xef\xbb\xbf")
    lines, body = _split(data, ",".join(units))
    comments = dict(filter(None, map(_named, lines)))
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
        row = re.search(r"Row #(\d+): (.*)", str(error), re.S)  # Arrow counts the rows of the table
        text = f"line {int(row[1]) + len(lines) + 1}: {row[2][:120]}" if row else str(error)[:120]
        raise ValueError(text) from error
    if comments.get("rows", str(table.num_rows)) != str(table.num_rows):
        raise ValueError(f"{comments['rows'][:20]} rows announced, found {table.num_rows}")
    if comments.get("units", ",".join(units.values())) != ",".join(units.values()):
        raise ValueError(f"units are {comments['units'][:120]}, not {','.join(units.values())}")
    return comments, table


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
