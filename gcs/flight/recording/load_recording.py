"""Loads a recording from a flight's folder, or from a `.tlog` of any ground station."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa

from gcs.errors import FileFormatError
from gcs.flight.progress import Event
from gcs.flight.recording.flight_folder import EVENTS, PLAN, read_events
from gcs.flight.recording.flight_state import NAME as STATE
from gcs.flight.recording.flight_state import FlightState, read_flight_state
from gcs.flight.recording.from_telemetry import is_ground, recording_from_telemetry
from gcs.flight.recording.record_table import NAME as RECORD
from gcs.flight.recording.record_table import build_record, read_record, reported_profiles, telemetry_logs
from gcs.flight.recording.recording import Recording, VehicleTrack
from gcs.flight.recording.tlog import LoggedFrame, Tlog, load_tlog
from gcs.link.wire.message import GROUND, Message
from gcs.physics.quadrotor import Array
from gcs.plan.trajectory.plan_file import read_plan

_FORMS = ("{}_m", "v_{}_mps")


class LoadedRecording:
    """A recording, and the frames that vehicles sent with their times, to send them again."""

    def __init__(self, recording: Recording, t_s: Array, frames: tuple[LoggedFrame, ...]) -> None:
        stations = {frame.sysid for frame in frames if frame.message is not None and is_ground(frame.message)}
        chosen = [n for n, frame in enumerate(frames) if frame.sysid not in {GROUND.sysid, *stations}]
        self.recording = recording
        self.t_s = t_s[chosen]  # (F,)
        self.frames = tuple(frames[n].data for n in chosen)


def load_recording(path: Path) -> LoadedRecording:
    """Return the recording of a log, or of a folder with logs or `record.parquet`. Raises FileFormatError."""
    if not path.is_dir():
        return _bare(path.name, [load_tlog(path)])
    logs = telemetry_logs(path)
    state = read_flight_state(path) if (path / STATE).is_file() else None
    if state is None or state.t0_unix_s is None or not (path / PLAN).is_file():
        if not logs:
            raise FileFormatError(f"{path} has no telemetry.", hint="name a flight's folder or a .tlog")
        return _bare(path.name, [load_tlog(log) for log in logs])
    return _flight(path, state, state.t0_unix_s, [load_tlog(log) for log in logs])


def _flight(folder: Path, state: FlightState, t0_unix_s: float, logs: list[Tlog]) -> LoadedRecording:
    plan, _ = read_plan(folder / PLAN)
    frames, unix_s, notes = _joined(logs)
    messages = [frame.message for frame in frames if frame.message is not None]
    record = (
        build_record(plan, t0_unix_s, messages, state.systems) if logs else read_record(folder / RECORD, "name a .tlog")
    )
    _, warnings, remarks, _ = recording_from_telemetry(_timed(frames, unix_s - t0_unix_s))
    vehicle_of = {system: vehicle for vehicle, system in state.systems.items()}
    said = sorted((*warnings, *remarks), key=lambda one: one.t_s)
    said = [replace(one, sysid=vehicle_of.get(one.sysid, one.sysid)) for one in said]
    tracks = _from_record(record, plan.sysids)
    events = tuple(_placed(event, t0_unix_s) for event in read_events(folder / EVENTS) if math.isfinite(event.unix_s))
    systems = {state.systems.get(sysid, sysid): sysid for sysid in plan.sysids}
    landings = reported_profiles(messages, systems)
    notes = (*notes, *map(str, state.incomplete))
    recording = Recording(f"{state.mission}, {state.step}", tracks, events, tuple(said), plan, notes, landings)
    return LoadedRecording(_not_empty(recording, folder), unix_s - t0_unix_s, frames)


def _placed(event: Event, t0_unix_s: float) -> Event:
    """Return an event from before T0 was known with its time counted from T0."""
    return replace(event, t_s=event.unix_s - t0_unix_s) if math.isnan(event.t_s) else event


def _bare(name: str, logs: list[Tlog]) -> LoadedRecording:
    frames, unix_s, notes = _joined(logs)
    t_s = unix_s - unix_s[0]
    tracks, events, remarks, more = recording_from_telemetry(_timed(frames, t_s))
    recording = Recording(name, tracks, events, remarks, None, (*notes, *more))
    return LoadedRecording(_not_empty(recording, Path(name)), t_s, frames)


def _joined(logs: list[Tlog]) -> tuple[tuple[LoggedFrame, ...], Array, tuple[str, ...]]:
    frames = tuple(frame for log in logs for frame in log.frames)
    unix_s = np.concatenate([log.unix_s for log in logs]) if logs else np.empty(0)
    return frames, np.maximum.accumulate(unix_s), tuple(note for log in logs for note in log.notes)


def _timed(frames: tuple[LoggedFrame, ...], t_s: Array) -> Iterator[tuple[float, Message]]:
    return ((float(t), frame.message) for t, frame in zip(t_s, frames, strict=True) if frame.message is not None)


def _not_empty(recording: Recording, path: Path) -> Recording:
    if not any(len(track.t_s) for track in recording.tracks):
        raise FileFormatError(
            f"{path}: no vehicle reports a position.", hint="name a log with LOCAL_POSITION_NED or GLOBAL_POSITION_INT"
        )
    return recording


def _from_record(record: pa.Table, sysids: tuple[int, ...]) -> tuple[VehicleTrack, ...]:
    columns = {name: record.column(name).to_numpy() for name in record.column_names}
    motion = [np.stack([columns[form.format(a)] for a in ("north", "east", "down")], axis=1) for form in _FORMS]
    tracks = []
    for sysid in sysids:
        mine = np.flatnonzero(columns["sysid"] == sysid)
        mine = mine[np.argsort(columns["t_s"][mine], kind="stable")]
        autopilot = int(columns["autopilot"][mine[-1]]) if len(mine) and "autopilot" in columns else 0
        values = (columns["t_s"], *motion, columns["armed"], columns["mode"], columns["battery_pct"])
        tracks.append(VehicleTrack(sysid, autopilot, *(column[mine] for column in values)))
    return tuple(tracks)
