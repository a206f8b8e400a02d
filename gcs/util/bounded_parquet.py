"""Untrusted Parquet: rows, columns and unpacked sizes are checked in its directory before anything is unpacked."""

import io

import pyarrow.parquet as pq

from gcs.util.bounded_file import MIB, in_mib

ROWS_MAX = 4_000_000
_COLUMNS_MAX = 64
_UNPACKED_MAX = 1024 * MIB
_GROUPS_MAX = 10_000
_TEXT_MAX_BYTES = 4 * MIB  # of a text in the directory


def open_parquet(data: bytes) -> pq.ParquetFile:
    """The file, not yet unpacked. Raises ValueError, OSError or an error of Arrow."""
    file = pq.ParquetFile(
        io.BytesIO(data),
        page_checksum_verification=True,
        thrift_string_size_limit=_TEXT_MAX_BYTES,
        thrift_container_size_limit=_GROUPS_MAX,
    )
    found = file.metadata
    if found.num_rows > ROWS_MAX:
        raise ValueError(f"{found.num_rows:,} rows; the limit is {ROWS_MAX:,}")
    if found.num_columns > _COLUMNS_MAX or found.num_row_groups > _GROUPS_MAX:
        raise ValueError(f"{found.num_columns} columns in {found.num_row_groups} groups; the limit is {_COLUMNS_MAX}")
    groups = [found.row_group(n) for n in range(found.num_row_groups)]
    size = sum(group.column(n).total_uncompressed_size for group in groups for n in range(found.num_columns))
    if size > _UNPACKED_MAX or sum(group.num_rows for group in groups) != found.num_rows:
        raise ValueError(f"it unpacks to {in_mib(size)}; the limit is {in_mib(_UNPACKED_MAX)}")
    return file
