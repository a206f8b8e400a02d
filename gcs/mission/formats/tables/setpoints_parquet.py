"""`.parquet` files: the setpoint table as Parquet, with units, plan hash and origin in the metadata.

Pages carry checksums, so that a damaged file is not flown.
"""

import io
import json
from dataclasses import asdict

import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel, ConfigDict, ValidationError

from gcs.errors import FileFormatError
from gcs.frames import Origin
from gcs.mission.formats.tables.setpoint_table import COLUMNS, StreamFile, from_table, to_table
from gcs.util.bounded_parquet import open_parquet

_KEY = b"skein.setpoints"
_TYPES = {name: pa.int32() if name == "sysid" else pa.float64() for name in COLUMNS}


class _Metadata(BaseModel):
    model_config = ConfigDict(strict=True, allow_inf_nan=False)
    plan: str
    origin: Origin | None


def write_setpoints_parquet(file: StreamFile) -> bytes:
    """The bytes of a file; `read_setpoints_parquet` gives back the same values."""
    metadata = {"plan": file.plan_hash, "origin": None if file.origin is None else asdict(file.origin)}
    fields = [pa.field(name, _TYPES[name], nullable=False, metadata={"unit": u}) for name, u in COLUMNS.items()]
    schema = pa.schema(fields, metadata={_KEY: json.dumps(metadata).encode()})
    buffer = io.BytesIO()
    pq.write_table(to_table(file.stream).cast(schema), buffer, compression="zstd", write_page_checksum=True)
    return buffer.getvalue()


def read_setpoints_parquet(data: bytes, source: str) -> StreamFile:
    """Contents of a file; `source` names it in errors. Raises `FileFormatError` for anything else or damaged."""
    try:
        file = open_parquet(data)
        schema = file.schema_arrow
        metadata = _Metadata.model_validate_json((schema.metadata or {}).get(_KEY, b""))
        found = dict(zip(schema.names, schema.types, strict=True))
        if found != _TYPES:
            raise ValueError(f"columns are {', '.join(schema.names)[:120]}")
        stream = from_table(file.read())
    except (ValueError, OSError, pa.ArrowException, ValidationError) as error:
        ours = not isinstance(error, ValidationError)
        reason = str(error).splitlines()[0] if ours else "not a setpoint file of this program"
        text = f"{source}: {reason[:200].rstrip('.')}."
        raise FileFormatError(text, hint="write the file again with `gcs export`") from error
    return StreamFile(stream, metadata.plan, metadata.origin)
