"""What does a byte cost the parser? Lawful frames, noise, and bytes made to keep it busy, in ns per byte.

./tools/run python tools/measure_parser.py [--json FILE]

`work` is the number of checksum bytes (and 32 for each failed header) per byte, the measure that tests bound;
`dropped` the share that was left unread.
"""

from __future__ import annotations

import argparse
import json
import random
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

from gcs.link.wire.codec import _SCANNER, Codec
from gcs.link.wire.message import Message
from gcs.link.wire.signing_keys import signing_with

DATAGRAM_BYTES = 65_000
REPEATS = 15


def inputs() -> dict[str, bytes]:
    """The datagrams by name."""
    codec, signing = Codec(1, 1), signing_with(bytes(range(32)), 0.0)
    axes = dict.fromkeys(("x", "y", "z", "vx", "vy", "vz"), 1.5)
    said = Message("LOCAL_POSITION_NED", {"time_boot_ms": 5, **axes})
    signed = codec.encode(said, signing.signature(1.0) if signing else None)
    plain = codec.encode(said)
    damaged = plain[:20] + b"\x55" + plain[21:]
    periods = {
        "frames": plain,
        "signed frames": signed,
        "every second one damaged": plain + damaged,
        "console text": b"APM: EKF3 IMU0 is using GPS\r\n",
        "noise": random.Random(1).randbytes(DATAGRAM_BYTES),
        "0xFE": b"\xfe",
        "0xFD": b"\xfd",
        "0xFD 0xFE": b"\xfd\xfe",
        "headers of MAVLink 1": bytes([0xFE, 251, 0, 1, 1, 110]),
        "headers of MAVLink 2": bytes([0xFD, 255, 0, 0, 0, 1, 1, 0, 0, 0]),
        "signed headers": bytes([0xFD, 255, 1, 0, 0, 1, 1, 0, 0, 0]),
        "unknown messages": bytes([0xFD, 5, 0, 0, 0, 1, 1, 255, 255, 255]),
    }
    return {name: (period * (DATAGRAM_BYTES // len(period) + 1))[:DATAGRAM_BYTES] for name, period in periods.items()}


def measure(data: bytes) -> dict[str, float]:
    """Decode one datagram several times; the fastest counts."""
    best_s = float("inf")
    for _ in range(REPEATS):
        began_s = time.perf_counter()
        Codec(255, 190).decode(data)
        best_s = min(best_s, time.perf_counter() - began_s)
    found = _SCANNER.scan(data)
    size = len(data)
    return {
        "ns_per_byte": 1e9 * best_s / size,
        "datagram_ms": 1e3 * best_s,
        "work": found.work / size,
        "dropped": found.dropped / size,
        "frames": len(found.frames),
    }


def main() -> None:
    """Measure all inputs and show a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    results = {name: measure(data) for name, data in inputs().items()}
    table = Table(f"{DATAGRAM_BYTES:,} bytes of", "ns per byte", "ms", "work", "dropped", "frames")
    for name, r in results.items():
        table.add_row(
            name,
            f"{r['ns_per_byte']:.0f}",
            f"{r['datagram_ms']:.1f}",
            f"{r['work']:.2f}",
            f"{r['dropped']:.0%}",
            f"{r['frames']:.0f}",
        )
    Console(width=110).print(table)
    if options.json:
        options.json.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
