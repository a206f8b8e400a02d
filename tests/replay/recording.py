"""Recorded conversations: rows of a file as messages, cut into steps.

Knows: the files' format (JSON lines, gzipped when large, one frame in hex per row). Does not know: the emulated
vehicles, what a difference is.

A step begins with a message of the ground station, or with a note of its script, and lasts until the next one.
Heartbeats and streams of setpoints begin none: they are the same all the time.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message, Station

TRACES = Path(__file__).resolve().parents[3] / "shared" / "traces"
KEPT = Path(__file__).resolve().parents[2] / "tests" / "recorded" / "scenes"  # the small ones, in every clone
KEPT_SCENES = ("mission_upload_ok", "fence_and_rally", "read_back")
SCENES = (
    "connect",
    "params",
    "mission_upload_ok",
    "mission_upload_bad",
    "fence_and_rally",
    "arm_refusals",
    "auto_flight",
    "guided_flight",
    "timesync",
    "signing",
    "read_back",
    "requests",
)
AUTOPILOTS = ("arducopter-4.5.6", "arducopter-4.7dev", "px4-1.17dev")

_SIGNED = 0x01
_STREAMED = frozenset({"HEARTBEAT", "SET_POSITION_TARGET_LOCAL_NED"})


@dataclass(frozen=True)
class Row:
    """One message on the link, or a note. `more` counts messages of its kind that were left out before it."""

    t_s: float
    name: str
    message: Message | None = None
    frame: bytes = b""
    signed: bool = False
    more: int = 0


@dataclass
class Step:
    """What the ground station did, and what the vehicle said until its next doing."""

    number: int
    t_s: float
    title: str
    sent: Row | None  # None where the step is only a note
    streamed: list[Row] = field(default_factory=list)  # heartbeats and setpoints of the ground station meanwhile
    heard: list[Row] = field(default_factory=list)
    end_s: float = 0.0


@dataclass(frozen=True)
class Recording:
    """One scene with one autopilot."""

    autopilot: str
    scene: str
    steps: tuple[Step, ...]
    vehicle: Station

    @property
    def end_s(self) -> float:
        """When it ends."""
        return self.steps[-1].end_s

    def heard(self) -> Iterator[tuple[Step, Row]]:
        """All rows of the vehicle, with the step they belong to."""
        for step in self.steps:
            for row in step.heard:
                yield step, row


def find(autopilot: str, scene: str, folder: Path = TRACES) -> Path | None:
    """The file of a scene in a folder or among those kept in the tree, or None where there is none."""
    folders = (folder, KEPT)
    names = (of / autopilot / f"{scene}{suffix}" for of in folders for suffix in (".jsonl", ".jsonl.gz"))
    return next((path for path in names if path.exists()), None)


def read(path: Path) -> Recording:
    """Read a scene. Raises OSError and ValueError for a file that is no recording."""
    data = path.read_bytes()
    lines = (gzip.decompress(data) if path.suffix == ".gz" else data).splitlines()
    codec = Codec(255, 190)
    steps: list[Step] = []
    note = ""
    for line in lines:
        row: dict[str, Any] = json.loads(line)
        t_s = float(row["t"])
        if row["dir"] == "note":
            note = str(row.get("label") or row["text"])
            steps.append(Step(len(steps), t_s, note, None))
            continue
        heard = _row(row, codec)
        if row["dir"] == "gcs->veh" and heard.name not in _STREAMED:
            steps.append(Step(len(steps), t_s, f"{note}: {describe(heard)}" if note else describe(heard), heard))
        elif row["dir"] == "gcs->veh":
            steps[-1].streamed.append(heard)
        else:
            steps[-1].heard.append(heard)
    for step, following in pairwise(steps):
        step.end_s = following.t_s
    steps[-1].end_s = float(json.loads(lines[-1])["t"])
    return Recording(path.parent.name, path.name.split(".")[0], tuple(steps), _vehicle(steps))


def describe(row: Row) -> str:
    """A ground station's message in a few words."""
    if row.message is None:
        return row.name
    fields = row.message.fields
    told = {
        key: fields[key]
        for key in ("command", "param1", "param2", "seq", "count", "mission_type", "param_id", "param_index")
        if key in fields
    }
    return f"{row.name} {' '.join(f'{key}={value}' for key, value in told.items())}".strip()


def _row(row: dict[str, Any], codec: Codec) -> Row:
    frame = bytes.fromhex(row["hex"])
    messages = codec.decode(frame) if row["name"] != "BAD_DATA" else []
    return Row(
        t_s=float(row["t"]),
        name=row["name"],
        message=messages[0] if messages else None,
        frame=frame,
        signed=bool(len(frame) > 2 and frame[0] == 0xFD and frame[2] & _SIGNED),
        more=int(row.get("thinned", 0)),
    )


def _vehicle(steps: list[Step]) -> Station:
    for step in steps:
        for row in step.heard:
            if row.name == "HEARTBEAT" and row.message is not None:
                return row.message.source
    raise ValueError("the recording has no heartbeat of a vehicle")
