"""Loads a recording from a flight's folder, or from a `.tlog` of any ground station."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gcs.autopilots.local_frame import local_frame
from gcs.autopilots.traits import mode_name
from gcs.errors import FileFormatError, counted
from gcs.flight.assessment.judge import Tracks, load_truth
from gcs.flight.monitoring.predicted_tracks import PredictedTracks
from gcs.flight.monitoring.progress import Event, PlanTime, flown_plan_time
from gcs.flight.recording.emulation_record import TRUTH
from gcs.flight.recording.flight_folder import EVENTS, PLAN, PREDICTED, read_events, read_flown_plan
from gcs.flight.recording.flight_state import NAME as STATE
from gcs.flight.recording.flight_state import FlightState, read_flight_state
from gcs.flight.recording.record_table import NAME as RECORD
from gcs.flight.recording.record_table import build_record, read_record, reported_profiles, telemetry_logs
from gcs.flight.recording.recording import Recording, VehicleTrack
from gcs.flight.recording.tlog import LoggedFrame, Tlog, load_tlog
from gcs.frames import Origin, geodetic_to_ned, ned_to_geodetic
from gcs.link.protocols.statustext import StatusText, StatusTextJoiner
from gcs.link.wire.message import GROUND, Message, is_autopilots_beat, is_local_place, local_motion
from gcs.mavlink import GENERIC_AUTOPILOT, MavType, ModeFlag, Severity
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array

_FORMS = ("{}_m", "v_{}_mps")
_ELSEWHERE_S = 1.0
_SAME_HOME_M = 0.5  # homes on level ground
_TOGETHER_S = 0.5  # a global and a local position within that are of one place


@dataclass
class _Heard:
    autopilot: int = GENERIC_AUTOPILOT
    beats: int = 0
    armed: bool = False
    mode: int = 0
    battery_pct: int = -1
    origin: Origin | None = None  # of its local frame
    home_amsl_m: float | None = None  # by HOME_POSITION
    component: int | None = None  # that of the autopilot
    without_place: int = 0  # reports at 0 N 0 E
    # Of each report of a position:
    sources: list[int] = field(default_factory=list)  # components
    below_m: list[float] = field(default_factory=list)  # AMSL altitudes from which relative ones count; NaN: none
    is_global: list[bool] = field(default_factory=list)
    stamps: list[tuple[float, float]] = field(default_factory=list)  # received, boot clock
    motion: list[tuple[float, ...]] = field(default_factory=list)  # lat lon alt or x y z; three velocities
    state: list[tuple[bool, int, int]] = field(default_factory=list)

    def of_one_component(self) -> tuple[_Heard, int]:
        """Itself with the positions of its autopilot alone, else of the component with the most; and how many others.

        A companion computer, a camera or a beacon may report places of its own under the same system id.
        """
        counts = Counter(self.sources)
        kept = self.component if self.component in counts else max(counts, key=lambda one: counts[one])
        chosen = [row for row, source in enumerate(self.sources) if source == kept]
        lists = ("sources", "below_m", "is_global", "stamps", "motion", "state")
        of_kept: dict[str, Any] = {name: [getattr(self, name)[row] for row in chosen] for name in lists}
        return replace(self, **of_kept), len(self.sources) - len(chosen)


def is_ground(message: Message) -> bool:
    """Whether this is the HEARTBEAT of a ground station."""
    return message.name == "HEARTBEAT" and message.fields["type"] == MavType.GCS


def recording_from_telemetry(
    messages: Iterable[tuple[float, Message]],
) -> tuple[tuple[VehicleTrack, ...], tuple[Event, ...], tuple[Event, ...], tuple[str, ...]]:
    """Return tracks, warnings, remarks and notes of messages with their times, in order; without plan, T0 or frame.

    A vehicle's positions are the more frequent ones of GLOBAL_POSITION_INT and LOCAL_POSITION_NED. A local frame begins
    where its vehicle does, and each vehicle has its own. GPS_GLOBAL_ORIGIN, HOME_POSITION or one GLOBAL_POSITION_INT
    beside a local position tell where it lies. A vehicle with none of them keeps its own frame. The common origin is
    the first position of the first vehicle, at the altitude of a home.
    """
    heard: dict[int, _Heard] = {}
    events: list[Event] = []
    remarks: list[Event] = []
    joiner = StatusTextJoiner()

    def note(texts: Iterable[StatusText], t_s: float) -> None:
        for said in texts:
            bad = said.severity <= Severity.WARNING
            (events if bad else remarks).append(Event(t_s, t_s, said.source.sysid, f"reports: {said.text}"))

    t_s = 0.0
    for t_s, message in messages:
        note(joiner.tick(t_s), t_s)  # of those whose other chunks are not in the log
        sysid = message.sysid
        if sysid == GROUND.sysid or is_ground(message):
            continue
        one = heard.setdefault(sysid, _Heard())
        if message.name == "HEARTBEAT":
            remarks += [Event(t_s, t_s, sysid, what) for what in _beat(one, message)]
        elif message.name == "STATUSTEXT":
            note(joiner.receive(message, t_s), t_s)
        else:
            _take(one, message, t_s)
    note(joiner.tick(math.inf), t_s)
    placed: dict[int, _Heard] = {}
    left_out = []
    for sysid, one in sorted(heard.items()):
        if one.without_place:
            left_out.append(
                f"vehicle {sysid}: {counted(one.without_place, 'report')} at 0 N 0 E left out: no position."
            )
        if one.motion:
            placed[sysid], others = one.of_one_component()
            if others:
                text = f"vehicle {sysid}: {counted(others, 'position')} of components besides its autopilot left out."
                left_out.append(text)
    tracks, notes = _tracks(placed)
    return tracks, tuple(events), tuple(remarks), (*notes, *left_out)


def _beat(one: _Heard, message: Message) -> list[str]:
    """Take in a HEARTBEAT; return what has changed, in words."""
    fields = message.fields
    if not is_autopilots_beat(message):  # a gimbal, a camera
        return []
    one.component = message.compid if one.component is None else one.component
    armed, mode = bool(fields["base_mode"] & ModeFlag.ARMED), int(fields["custom_mode"])
    one.autopilot = int(fields["autopilot"])
    said = []
    if one.beats == 0 or mode != one.mode:
        said.append("is in " + mode_name(one.autopilot, mode, int(fields["type"])))
    if armed != one.armed:
        said.append("is armed" if armed else "is disarmed")
    one.beats, one.armed, one.mode = one.beats + 1, armed, mode
    return said


def _take(one: _Heard, message: Message, t_s: float) -> None:
    fields = message.fields
    if message.name == "SYS_STATUS":
        one.battery_pct = int(fields["battery_remaining"])
    elif message.name == "GPS_GLOBAL_ORIGIN":
        one.origin = Origin(fields["latitude"] / 1e7, fields["longitude"] / 1e7, fields["altitude"] / 1e3)
    elif message.name == "HOME_POSITION":
        one.home_amsl_m = one.home_amsl_m if one.home_amsl_m is not None else fields["altitude"] / 1e3
        place = Origin(fields["latitude"] / 1e7, fields["longitude"] / 1e7, fields["altitude"] / 1e3)
        at_m = [float(fields[name]) for name in ("x", "y", "z")]
        if one.origin is None and is_local_place(at_m):
            one.origin = Origin(*(float(part) for part in ned_to_geodetic(-np.array(at_m), place)))
    elif message.name == "GLOBAL_POSITION_INT" and (fields["lat"] or fields["lon"]):
        motion = (fields["lat"] / 1e7, fields["lon"] / 1e7, fields["alt"] / 1e3)
        _note(one, True, t_s, message, (*motion, *(fields[name] / 1e2 for name in ("vx", "vy", "vz"))))
    elif message.name == "GLOBAL_POSITION_INT":
        one.without_place += 1
    elif message.name == "LOCAL_POSITION_NED" and (local := local_motion(message)) is not None:
        _note(one, False, t_s, message, local)


def _note(one: _Heard, is_global: bool, t_s: float, message: Message, motion: tuple[float, ...]) -> None:
    fields = message.fields
    one.sources.append(message.compid)
    one.below_m.append((fields["alt"] - fields["relative_alt"]) / 1e3 if "relative_alt" in fields else math.nan)
    one.is_global.append(is_global)
    one.stamps.append((t_s, fields["time_boot_ms"] / 1e3))
    one.motion.append(motion)
    one.state.append((one.armed, one.mode, one.battery_pct))


def _tracks(heard: dict[int, _Heard]) -> tuple[tuple[VehicleTrack, ...], tuple[str, ...]]:
    placed = {sysid: _on_earth(one) for sysid, one in heard.items()}
    first = next((earth for _, earth, _ in placed.values() if earth is not None), None)
    home_amsl_m, notes = _home_amsl_m(heard, {sysid: frame for sysid, (_, _, frame) in placed.items()})
    found, alone = [], []
    for sysid, one in heard.items():
        chosen, earth, _ = placed[sysid]
        motion = np.array(one.motion)[chosen]
        places = motion[:, :3]
        if earth is None or first is None:
            alone.append(sysid)
        else:
            lat_deg, lon_deg, alt_m = (float(part[0]) for part in first)
            places = geodetic_to_ned(*earth, Origin(lat_deg, lon_deg, alt_m if home_amsl_m is None else home_amsl_m))
        stamps, state = np.array(one.stamps)[chosen], np.array(one.state)[chosen]
        t_s = steady_times(stamps[:, 0], stamps[:, 1])
        order = np.argsort(t_s, kind="stable")
        found.append(
            VehicleTrack(
                sysid,
                one.autopilot,
                t_s[order],
                places[order],
                motion[order, 3:],
                state[order, 0].astype(bool),
                state[order, 1].astype(np.int64),
                state[order, 2].astype(np.int64),
            )
        )
    if alone and len(found) > 1:
        named = ", ".join(map(str, alone))
        notes = (
            *notes,
            f"vehicle{'s' if len(alone) > 1 else ''} {named} reported no position on Earth: "
            "each is drawn in its own local frame, which begins where the vehicle stood.",
        )
    return tuple(found), notes


def _home_amsl_m(heard: dict[int, _Heard], frames: dict[int, Origin | None]) -> tuple[float | None, tuple[str, ...]]:
    """The altitude from which heights count, with a note where it is not that of every vehicle's home.

    It is that of the first vehicle's home: by HOME_POSITION, else as its relative altitudes have it, else the origin of
    its local frame. None for the first position: there is no home, or no position on Earth.
    """
    homes_m: dict[int, float] = {}
    for sysid, one in heard.items():
        if one.home_amsl_m is not None:
            homes_m[sysid] = one.home_amsl_m
        elif not np.isnan(one.below_m).all():
            homes_m[sysid] = float(np.nanmedian(one.below_m))
        elif (frame := frames[sysid]) is not None:
            homes_m[sysid] = frame.alt_amsl_m
    if not homes_m:
        if not any(any(one.is_global) for one in heard.values()):
            return None, ()
        text = "no vehicle reports its home or a relative altitude: heights count from the first position of the log."
        return None, (text,)
    (first, home_m), *_ = homes_m.items()
    apart_m = max(abs(other - home_m) for other in homes_m.values())
    if apart_m <= _SAME_HOME_M:
        return home_m, ()
    text = f"heights count from the home of vehicle {first}; those of other vehicles are up to {apart_m:.1f} m away."
    return home_m, (text,)


def _on_earth(one: _Heard) -> tuple[NDArray[np.bool_], tuple[Array, Array, Array] | None, Origin | None]:
    """Return which reports make the track, their latitudes, longitudes and altitudes, and the local frame's origin.

    Places are None in an unknown frame.
    """
    motion, is_global = np.array(one.motion), np.array(one.is_global)
    origin = one.origin or _frame_origin(one.autopilot, motion, np.array(one.stamps)[:, 1], is_global)
    if is_global.any() and (origin is None or 2 * is_global.sum() >= len(is_global)):
        return is_global, (motion[is_global, 0], motion[is_global, 1], motion[is_global, 2]), origin
    if origin is None:
        return ~is_global, None, None
    frame = local_frame(one.autopilot, origin, np.zeros(3))
    return ~is_global, ned_to_geodetic(frame.common_ned_m(motion[~is_global, :3]), origin), origin


def _frame_origin(autopilot: int, motion: Array, boot_s: Array, is_global: NDArray[np.bool_]) -> Origin | None:
    """Return the origin of a local frame from the global and the local position (N, 6) that are nearest in time."""
    if is_global.all() or not is_global.any():
        return None
    globals_, locals_ = motion[is_global], motion[~is_global]
    after = np.clip(np.searchsorted(boot_s[~is_global], boot_s[is_global]), 0, len(locals_) - 1)
    apart_s = np.abs(boot_s[~is_global][after] - boot_s[is_global])
    nearest = int(np.argmin(apart_s))
    if apart_s[nearest] > _TOGETHER_S:
        return None
    place = Origin(*(float(part) for part in globals_[nearest, :3]))
    moved_m = local_frame(autopilot, place, np.zeros(3)).common_ned_m(locals_[after[nearest], :3])
    return Origin(*(float(part) for part in ned_to_geodetic(-moved_m, place)))


def steady_times(noted_s: Array, boot_s: Array) -> Array:
    """Return the times (N,) of reports by the boot clock; its offset is that of the least delayed report.

    A reboot, a clock that was set, and time at another rate than the clock's begin a new section.
    """
    offset = noted_s - boot_s
    times = np.empty_like(noted_s)
    begin = 0
    for end in range(1, len(offset) + 1):
        if end == len(offset) or abs(offset[end] - offset[begin]) > _ELSEWHERE_S:
            times[begin:end] = boot_s[begin:end] + offset[begin:end].min()
            begin = end
    return times


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
    plan = read_flown_plan(folder)
    events = read_events(folder / EVENTS)
    plan_time = flown_plan_time(t0_unix_s, events)
    frames, unix_s, notes = _joined(logs)
    messages = [frame.message for frame in frames if frame.message is not None]
    record = (
        build_record(plan, plan_time, messages, state.systems) if logs else read_record(folder / RECORD, "name a .tlog")
    )
    _, warnings, remarks, _ = recording_from_telemetry(_timed(frames, plan_time.t_s(unix_s)))
    vehicle_of = {system: vehicle for vehicle, system in state.systems.items()}
    said = sorted((*warnings, *remarks), key=lambda one: one.t_s)
    said = [replace(one, sysid=vehicle_of.get(one.sysid, one.sysid)) for one in said]
    tracks = _from_record(record, plan.sysids)
    events = tuple(_placed(event, plan_time) for event in events if math.isfinite(event.unix_s))
    systems = {state.systems.get(sysid, sysid): sysid for sysid in plan.sysids}
    landings = reported_profiles(messages, systems)
    notes, predicted = (*notes, *map(str, state.incomplete)), None
    if (folder / PREDICTED).exists():
        try:
            predicted = PredictedTracks.load(folder / PREDICTED)
        except FileFormatError as problem:
            notes = (*notes, problem.message)
    truth = None
    if (folder / TRUTH).exists():
        try:
            truth = _true_tracks(folder, plan, plan_time)
        except FileFormatError as problem:
            notes = (*notes, problem.message)
    name = f"{state.mission}, {state.step}"
    recording = Recording(name, tracks, events, tuple(said), plan, notes, landings, predicted, truth)
    return LoadedRecording(_not_empty(recording, folder), plan_time.t_s(unix_s), frames)


def _true_tracks(folder: Path, plan: Plan, plan_time: PlanTime) -> Tracks:
    """The true tracks of emulated vehicles. Raises FileFormatError."""
    truth = load_truth(folder / TRUTH)
    if missing := set(plan.sysids) - set(truth.sysids):
        raise FileFormatError(f"{folder / TRUTH} has no vehicle {min(missing)} of the plan.")
    rows = [truth.sysids.index(sysid) for sysid in plan.sysids]
    return Tracks(plan_time.t_s(truth.unix_s), truth.states[rows][..., POSITION])


def _placed(event: Event, plan_time: PlanTime) -> Event:
    return replace(event, t_s=float(plan_time.t_s(np.array(event.unix_s)))) if math.isnan(event.t_s) else event


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
