"""Signing keys from a file or the environment, never from the command line. No `repr` and no error shows a key.

A key is 64 hexadecimal digits, or 32 bytes of a file that is no text. Any other text is a passphrase whose SHA-256 is
the key, as in Mission Planner, QGroundControl and MAVProxy.
"""

import hashlib
import os
import re
import select
import time
from collections.abc import Mapping
from io import RawIOBase
from pathlib import Path

from gcs.errors import UsageError
from gcs.link.wire.signing import EPOCH_UNIX_S, KEY_BYTES, TICKS_PER_S, Signing
from gcs.util.bounded_file import KEY_FILE, open_regular

VARIABLE = "SKEIN_SIGNING_KEY"
_SHORTEST = 8
_OTHERS = 0o077
_PATIENCE_S = 20.0  # for a program that writes the key into a pipe


def load_key(file: Path | None, environment: Mapping[str, str] = os.environ) -> bytes | None:
    """Return the key in `file`, else that of the environment variable SKEIN_SIGNING_KEY, else None.

    The file may be a pipe, as of a program that prints the key. Raises `UsageError` if it cannot be read, other users
    may read it, or it contains no key.
    """
    if file is None:
        text = environment.get(VARIABLE)
        return None if text is None else _key(text.encode(), f"the variable {VARIABLE}")
    try:
        with os.fdopen(open_regular(file, error=UsageError, pipes=True), "rb", buffering=0) as opened:
            if os.fstat(opened.fileno()).st_mode & _OTHERS:
                raise UsageError(f"the signing key {file} can be read by other users.", hint=f"run: chmod 600 {file}")
            data = _read_all(opened, file)
    except OSError as error:
        raise UsageError(f"the signing key {file} cannot be read: {error.strerror}.") from None
    return _key(data, f"the file {file}")


def _read_all(opened: RawIOBase, file: Path) -> bytes:
    """Read to the end, a pipe too, but never wait without end."""
    data = b""
    end_s = time.monotonic() + _PATIENCE_S
    while len(data) <= KEY_FILE.largest_bytes:
        if not select.select([opened], [], [], max(end_s - time.monotonic(), 0.0))[0]:
            raise UsageError(f"the signing key {file} did not arrive within {_PATIENCE_S:g} s.")
        piece = opened.read(KEY_FILE.largest_bytes + 1)
        if not piece:
            break
        data += piece
    return data


def signing_with(key: bytes | None, now_s: float, unix_s: float | None = None) -> Signing | None:
    """Return the signing state at `now_s` of the clock it is used with; None without a key."""
    if key is None:
        return None
    signing = Signing()
    signing.set_up(key, signing_ticks(unix_s), now_s)
    return signing


def signing_ticks(unix_s: float | None = None) -> int:
    """Return the signing time at `unix_s`, now by default; 0 by a clock that was never set, which vehicles advance."""
    return max(round(((time.time() if unix_s is None else unix_s) - EPOCH_UNIX_S) * TICKS_PER_S), 0)


def _key(data: bytes, source: str) -> bytes:
    try:
        text = data.decode().strip()
    except UnicodeDecodeError:
        if len(data) == KEY_BYTES:
            return data
        raise UsageError(f"{source} contains neither text nor a key of {KEY_BYTES} bytes.") from None
    if len(data) > KEY_FILE.largest_bytes or len(text) < _SHORTEST:
        raise UsageError(
            f"{source} contains no signing key.",
            hint=f"write {2 * KEY_BYTES} hexadecimal digits, or a passphrase of {_SHORTEST} characters or more",
        )
    if re.fullmatch(rf"[0-9a-fA-F]{{{2 * KEY_BYTES}}}", text):
        key = bytes.fromhex(text)
        if not any(key):
            raise UsageError(f"{source} contains a key of zeros, which means no signing.")
        return key
    return hashlib.sha256(text.encode()).digest()
