"""Telemetry logs of any ground station: whole, cut, damaged, of other dialects, and no logs at all."""

from __future__ import annotations

import random
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs.autopilots.local_frame import local_frame
from gcs.errors import FileFormatError
from gcs.flight.recording.load_recording import load_recording, recording_from_telemetry, steady_times
from gcs.flight.recording.tlog import load_tlog, mend_times
from gcs.frames import Origin, ned_to_geodetic
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message
from tests.hostile.man_in_the_middle import Lies
from tests.replay.recording import find, read

START_S = 1_700_000_000.0
HERE = Origin(-35.36, 149.16, 584.0)
BEAT = {"type": 2, "autopilot": 3, "base_mode": 1, "custom_mode": 4, "system_status": 4, "mavlink_version": 3}


def frame(message: Message, unix_s: float) -> bytes:
    return struct.pack(">Q", round(unix_s * 1e6)) + Codec(message.sysid, 1).encode(message)


def flight(seconds: int = 20) -> list[tuple[float, Message]]:
    """Vehicle 1 reports its position on Earth, vehicle 2 in its own frame, 3 m east, both going north at 2 m/s."""
    own = local_frame(BEAT["autopilot"], HERE, np.zeros(3))
    corner = ned_to_geodetic(np.array([0.0, 3.0, 0.0]), HERE)
    origin = {"latitude": round(float(corner[0]) * 1e7), "longitude": round(float(corner[1]) * 1e7)}
    told = [(0.0, Message("GPS_GLOBAL_ORIGIN", {**origin, "altitude": 584_000, "time_usec": 0}, 2, 1))]
    for n in range(5 * seconds):
        t_s, boot = n / 5, {"time_boot_ms": 7000 + 200 * n}
        lat, lon, alt = (float(part) for part in ned_to_geodetic(np.array([2 * t_s, 0.0, -4.0]), HERE))
        place = {"lat": round(lat * 1e7), "lon": round(lon * 1e7), "alt": round(alt * 1e3), "relative_alt": 4000}
        north_m = 2 * t_s * own.counts[0]
        there = {**boot, **place, "vx": 200, "vy": 0, "vz": 0, "hdg": 0}
        local = {**boot, "x": float(np.float32(north_m)), "y": 0.0, "z": -4.0, "vx": 2.0, "vy": 0.0, "vz": 0.0}
        beat = BEAT | {"base_mode": 129 if t_s >= 2 else 1, "custom_mode": 9 if t_s >= 15 else 4}
        told += [(t_s, Message("GLOBAL_POSITION_INT", there, 1, 1)), (t_s, Message("LOCAL_POSITION_NED", local, 2, 1))]
        told += [(t_s, Message("HEARTBEAT", beat, sysid, 1)) for sysid in (1, 2) if n % 5 == 0]
    told.append((8.0, Message("STATUSTEXT", {"severity": 3, "text": "Compass error", "id": 0, "chunk_seq": 0}, 1, 1)))
    return sorted(told, key=lambda one: one[0])


def written(path: Path, told: list[tuple[float, Message]]) -> bytes:
    data = b"".join(frame(message, START_S + t_s) for t_s, message in told)
    path.write_bytes(data)
    return data


def test_a_whole_log_is_read_whole(tmp_path: Path) -> None:
    told = flight()
    written(tmp_path / "a.tlog", told)
    log = load_tlog(tmp_path / "a.tlog")
    assert [one.message for one in log.frames] == [message for _, message in told]
    assert log.unix_s - START_S == pytest.approx([t_s for t_s, _ in told], abs=1e-5)
    assert log.notes == ()


def test_what_is_cut_or_damaged_is_left_out_and_said(tmp_path: Path) -> None:
    told = flight()
    data = bytearray(written(tmp_path / "a.tlog", told))
    data[1000:1040] = b"\xfd" * 40
    (tmp_path / "a.tlog").write_bytes(data[:-4])
    log = load_tlog(tmp_path / "a.tlog")
    assert len(told) - 4 <= len(log.frames) < len(told)
    sent = [message for _, message in told]
    assert all(one.message in sent for one in log.frames if one.message)
    assert len(log.notes) == 2
    assert "a.tlog is damaged" in log.notes[0]
    assert "its writer was cut off" in log.notes[1]


def test_bytes_that_rot_anywhere_never_end_in_anything_but_a_sentence(tmp_path: Path) -> None:
    path, dice = tmp_path / "a.tlog", random.Random(1)
    whole = written(path, flight(4))
    for _ in range(150):
        data = bytearray(whole)
        for _ in range(dice.randrange(1, 60)):
            at = dice.randrange(len(data))
            data[at : at + dice.randrange(3)] = dice.randbytes(dice.randrange(4))
        path.write_bytes(data[: dice.randrange(len(data))])
        try:
            log = load_tlog(path)
        except FileFormatError as error:
            assert "has no telemetry" in error.message
            continue
        assert len(log.unix_s) == len(log.frames)
        assert (np.diff(log.unix_s) >= 0.0).all()
        recording_from_telemetry((t, one.message) for t, one in zip(log.unix_s, log.frames, strict=True) if one.message)


@pytest.mark.parametrize("data", [b"", b"{}", bytes(5000), random.Random(2).randbytes(200_000)])
def test_what_is_no_log_is_refused(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "b.tlog").write_bytes(data)
    with pytest.raises(FileFormatError, match="has no telemetry"):
        load_tlog(tmp_path / "b.tlog")
    with pytest.raises(FileFormatError, match="No such file"):
        load_tlog(tmp_path / "none.tlog")


def test_frames_of_other_dialects_and_of_mavlink_1_are_kept(tmp_path: Path) -> None:
    other = bytes((0xFD, 2, 0, 0, 1, 1, 1)) + (60_000).to_bytes(3, "little") + b"abcd"
    first = bytes.fromhex("fe09000101000400000002038100038930")  # a heartbeat of system 1, from a MAVLink 1 link
    lines = [(0.0, first), (0.1, other), (0.2, frame(Message("HEARTBEAT", BEAT, 1, 1), 0.0)[8:])]
    data = b"".join(struct.pack(">Q", round((START_S + t) * 1e6)) + one for t, one in lines)
    (tmp_path / "c.tlog").write_bytes(data)
    log = load_tlog(tmp_path / "c.tlog")
    assert [one.data for one in log.frames] == [one for _, one in lines]
    assert [one.sysid for one in log.frames] == [1, 1, 1]
    assert log.notes[-1].startswith(("1 of 3", "2 of 3"))


def test_times_are_mended() -> None:
    times, left_out_s, back_s = mend_times(
        np.array([0.0, 0.0, 10.0, 11.0, 9e9, 12.0, 11.9, 13.0, 5000.0, 5001.0, 2.0, 3.0])
    )
    assert times == pytest.approx([10, 10, 10, 11, 12, 12, 12, 13, 13, 14, 14, 15])
    assert (left_out_s, back_s) == pytest.approx((4987.0, 4999.0))


@pytest.mark.parametrize("wrong_s", [-1e8, 6e8])
def test_a_wrong_time_before_the_fix_moves_no_flight(wrong_s: float) -> None:
    stamps_s = np.concatenate([START_S + wrong_s + np.arange(5.0), START_S + np.arange(60.0)])
    times, *_ = mend_times(stamps_s)
    assert times[5:] == pytest.approx(stamps_s[5:])
    assert (np.diff(times) >= 0.0).all() and times[0] >= START_S - 10.0


def test_the_modes_of_a_plane_keep_their_numbers() -> None:
    told = [(t_s, replace(one, fields=one.fields | {"type": 1}) if one.name == "HEARTBEAT" else one)
            for t_s, one in flight()]  # fmt: skip
    _, _, remarks, _ = recording_from_telemetry(told)
    assert {one.what for one in remarks if "mode" in one.what} == {"is in mode 4", "is in mode 9"}


def test_a_text_of_which_a_chunk_is_lost_is_shown_with_a_gap() -> None:
    def chunk(number: int, words: str) -> Message:
        return Message("STATUSTEXT", {"severity": 2, "text": words, "id": number, "chunk_seq": 1}, 1, 1)

    told = flight()
    told += [(3.0, chunk(7, "of the fence")), (told[-1][0], chunk(8, "at the end"))]
    _, events, _, _ = recording_from_telemetry(sorted(told, key=lambda one: one[0]))
    whats = [event.what for event in events if "[...]" in event.what]
    assert whats == ["reports: [...]of the fence", "reports: [...]at the end"]


def test_a_clock_that_steps_back_is_told(tmp_path: Path) -> None:
    log = tmp_path / "set.tlog"
    stamps_s = [START_S, START_S + 1.0, START_S + 2.0, START_S - 58.0, START_S - 57.0, START_S - 56.0]
    log.write_bytes(b"".join(frame(Message("HEARTBEAT", BEAT, 1, 1), unix_s) for unix_s in stamps_s))
    read = load_tlog(log)
    assert read.unix_s - START_S == pytest.approx([0, 1, 2, 2, 3, 4])
    assert any(note.startswith("times step back, 60 s together") for note in read.notes)


def test_reports_are_true_when_they_were_made_not_when_they_came() -> None:
    boot_s = np.arange(0.0, 20.0, 0.1)
    late_s = np.random.default_rng(3).uniform(0.02, 0.3, len(boot_s))
    rebooted = np.where(boot_s < 10.0, boot_s, boot_s - 10.0)
    found = steady_times(1000.0 + boot_s + late_s, rebooted)
    assert np.abs(found - 1000.0 - boot_s).max() < 0.04


def test_vehicles_of_any_kind_are_placed_beside_each_other() -> None:
    tracks, events, remarks, notes = recording_from_telemetry(flight())
    assert [track.sysid for track in tracks] == [1, 2]
    assert notes == ()
    t_s = np.array([1.0, 7.33])
    for track, east_m in zip(tracks, (0.0, 3.0), strict=True):
        places, rates = track.at(t_s)
        assert places == pytest.approx(np.array([[2.0, east_m, -4.0], [14.66, east_m, -4.0]]), abs=0.02)
        assert rates == pytest.approx(np.array([[2.0, 0.0, 0.0]] * 2), abs=1e-6)
    assert [str(event) for event in events] == ["t = 8.0 s: vehicle 1 reports: Compass error"]
    said = [(one.t_s, one.what) for one in remarks if one.sysid == 2]
    assert said == [(0.0, "is in GUIDED"), (2.0, "is armed"), (15.0, "is in LAND")]


def climb(home: bool, relative: bool) -> list[tuple[float, Message]]:
    """A log that begins in flight, 20 m above a home at 500 m."""
    told: list[tuple[float, Message]] = []
    if home:
        place = {"latitude": 461000000, "longitude": 92000000, "altitude": 500_000, "x": 0.0, "y": 0.0, "z": 0.0}
        told.append((0.0, Message("HOME_POSITION", place, 1, 1)))
    for n in range(30):
        place = {"lat": 461000000, "lon": 92000000, "alt": 520_000 + 1000 * n, "vx": 0, "vy": 0, "vz": 0, "hdg": 0}
        place |= {"time_boot_ms": 200 * n} | ({"relative_alt": 20_000 + 1000 * n} if relative else {})
        told.append((0.2 * n, Message("GLOBAL_POSITION_INT", place, 1, 1)))
    return told


@pytest.mark.parametrize(("home", "relative", "first_m"), [(1, 0, 20.0), (0, 1, 20.0), (1, 1, 20.0), (0, 0, 0.0)])
def test_heights_count_from_the_home_of_the_log(home: int, relative: int, first_m: float) -> None:
    (track,), _, _, notes = recording_from_telemetry(climb(bool(home), bool(relative)))
    assert -track.position_ned_m[[0, -1], 2] == pytest.approx([first_m, first_m + 29.0], abs=1e-3)
    assert bool(notes) == (not home and not relative)
    assert all("heights count from the first position of the log" in note for note in notes)


@pytest.mark.parametrize("beats", [True, False])
def test_a_vehicle_is_where_its_autopilot_says_and_nowhere_without_a_fix(beats: bool) -> None:
    told = climb(home=False, relative=True)
    others = [(t_s, replace(one, compid=191, fields=one.fields | {"lat": 462000000})) for t_s, one in told[:20]]
    lost = [(t_s, replace(one, fields=one.fields | {"lat": 0, "lon": 0})) for t_s, one in told[:3]]
    hearts = [(0.0, Message("HEARTBEAT", BEAT | {"autopilot": 8}, 1, 191)), (0.0, Message("HEARTBEAT", BEAT, 1, 1))]
    mixed = sorted([*told, *others, *lost], key=lambda one: one[0])
    (track,), _, _, notes = recording_from_telemetry([*hearts[: 2 * beats], *mixed])
    (alone,), *_ = recording_from_telemetry(told)
    assert track.position_ned_m == pytest.approx(alone.position_ned_m)
    assert notes == (
        "vehicle 1: 3 reports at 0 N 0 E left out: no position.",
        "vehicle 1: 20 positions of components besides its autopilot left out.",
    )


def test_a_component_with_the_autopilot_counts_also_with_fewer_positions() -> None:
    told = climb(home=False, relative=True)
    others = [(t_s, replace(one, compid=191)) for t_s, one in told]
    (track,), _, _, notes = recording_from_telemetry([(0.0, Message("HEARTBEAT", BEAT, 1, 1)), *told[:10], *others])
    assert len(track.t_s) == 10 and "30 positions of components" in notes[0]


@pytest.mark.parametrize("begins", [0, 7])
def test_a_log_without_stamps_has_the_times_of_its_vehicles(tmp_path: Path, begins: int) -> None:
    """The clock of vehicle 2 was started earlier, and vehicle 1 is started again on the way."""
    frames = []
    for n in range(100):
        place = {"lat": 461000000, "lon": 92000000 + n, "alt": 520_000, "relative_alt": 0, "vx": 0, "vy": 0, "vz": 0}
        for sysid, boot_ms in ((1, 200 * (n % 60)), (2, 900_000 + 200 * n)):
            frames.append(
                Codec(sysid, 1).encode(
                    Message("GLOBAL_POSITION_INT", place | {"time_boot_ms": boot_ms, "hdg": 0}, sysid, 1)
                )
            )
    path = tmp_path / "raw.tlog"
    path.write_bytes(b"".join(frames)[begins:])
    log = load_tlog(path)
    assert len(log.frames) == 200 - bool(begins)
    assert np.ptp(log.unix_s) == pytest.approx(19.8, abs=0.3)
    assert "no time stamps" in log.notes[0] and len(log.notes) == 1 + bool(begins)
    recording = load_recording(path).recording
    for track in recording.tracks:
        assert np.diff(track.t_s).min() >= 0.0 and np.ptp(track.t_s) == pytest.approx(19.8, abs=0.5)


def test_a_log_without_any_time_is_refused(tmp_path: Path) -> None:
    (tmp_path / "raw.tlog").write_bytes(Codec(1, 1).encode(Message("HEARTBEAT", BEAT, 1, 1)) * 20)
    with pytest.raises(FileFormatError, match="no time stamps, and no message in it has"):
        load_tlog(tmp_path / "raw.tlog")


def test_a_vehicle_without_a_position_on_earth_is_named() -> None:
    tracks, _, _, notes = recording_from_telemetry([one for one in flight() if one[1].name != "GPS_GLOBAL_ORIGIN"])
    assert len(tracks) == 2
    assert "vehicle 2 reported no position on Earth" in notes[0]


@pytest.mark.parametrize("told", ["GPS_GLOBAL_ORIGIN", "HOME_POSITION", "GLOBAL_POSITION_INT"])
def test_vehicles_with_a_local_frame_each_begin_at_their_own_pads(told: str) -> None:
    """Every frame begins where its vehicle stood; one message of each vehicle tells where that is."""
    messages: list[tuple[float, Message]] = []
    for sysid, east_m in ((1, 0.0), (2, 5.0), (3, 10.0)):
        pad = ned_to_geodetic(np.array([0.0, east_m, 0.0]), HERE)
        lat, lon, alt = (round(float(part) * scale) for part, scale in zip(pad, (1e7, 1e7, 1e3), strict=True))
        place = {"latitude": lat, "longitude": lon, "altitude": alt, "x": 0.0, "y": 0.0, "z": 0.0}
        if told == "GLOBAL_POSITION_INT":
            place = {"lat": lat, "lon": lon, "alt": alt, "time_boot_ms": 30, "vx": 0, "vy": 0, "vz": 0}
        messages.append((0.03, Message(told, place, sysid, 1)))
        for n in range(40):
            local = {"time_boot_ms": 100 * n, "x": 0.5 * n, "y": 0.0, "z": -0.1 * n, "vx": 5.0, "vy": 0.0, "vz": -1.0}
            messages.append((0.1 * n, Message("LOCAL_POSITION_NED", local, sysid, 1)))
    tracks, _, _, notes = recording_from_telemetry(sorted(messages, key=lambda one: one[0]))
    assert notes == ()
    for track, east_m in zip(tracks, (0.0, 5.0, 10.0), strict=True):
        assert len(track.t_s) == 40  # the one global position does not stand for all of them
        assert track.position_ned_m[[0, -1]] == pytest.approx(
            np.array([[0.0, east_m, 0.0], [19.5, east_m, -3.9]]), abs=0.03
        )


def test_a_level_flight_of_20_km_is_level_in_either_frame() -> None:
    """Relative altitudes and the local z of autopilots count from a level surface, at any distance from home."""
    lat, lon, alt = (
        round(float(part) * scale)
        for part, scale in zip((HERE.lat_deg, HERE.lon_deg, HERE.alt_amsl_m), (1e7, 1e7, 1e3), strict=True)
    )
    origin = {"latitude": lat, "longitude": lon, "altitude": alt, "time_usec": 0}
    messages = [(0.0, Message("GPS_GLOBAL_ORIGIN", origin, 2, 1))]
    for n in range(41):
        boot, place_m = {"time_boot_ms": 100 * n}, np.array([400.0 * n, -300.0 * n, -20.0])
        lat_deg, lon_deg, _ = ned_to_geodetic(place_m, HERE)
        place = {"lat": round(float(lat_deg) * 1e7), "lon": round(float(lon_deg) * 1e7), "alt": 604_000}
        there = {**boot, **place, "relative_alt": 20_000, "vx": 0, "vy": 0, "vz": 0, "hdg": 0}
        local = {**boot, **dict(zip("xyz", place_m.tolist(), strict=True)), "vx": 0.0, "vy": 0.0, "vz": 0.0}
        messages.append((0.1 * n, Message("GLOBAL_POSITION_INT", there, 1, 1)))
        messages.append((0.1 * n, Message("LOCAL_POSITION_NED", local, 2, 1)))
    tracks, _, _, notes = recording_from_telemetry(messages)
    assert notes == ()
    for track in tracks:
        assert np.ptp(track.position_ned_m[:, 2]) <= 0.01
    apart_m = tracks[0].position_ned_m - tracks[1].position_ned_m
    assert np.abs(apart_m).max() <= 0.02  # a unit of degE7 is 1.1 cm


@pytest.mark.parametrize(("autopilot", "mode"), [("arducopter-4.5.6", "AUTO"), ("px4-1.17dev", "MISSION")])
def test_originals_are_read_as_well(tmp_path: Path, autopilot: str, mode: str) -> None:
    """A recorded flight of a real autopilot along a square, as a ground station would have logged it."""
    found = find(autopilot, "auto_flight")
    if found is None:
        pytest.skip(
            f"the large recording {autopilot}/auto_flight is neither in the tree nor beside it in shared/traces"
        )
    steps = read(found).steps
    rows = [row for step in steps for row in ([step.sent] if step.sent else []) + step.streamed + step.heard]
    rows = sorted((row for row in rows if row.frame), key=lambda row: row.t_s)
    log = b"".join(struct.pack(">Q", round((START_S + row.t_s) * 1e6)) + row.frame for row in rows)
    (tmp_path / "original.tlog").write_bytes(log)
    recording = load_recording(tmp_path / "original.tlog").recording
    (track,) = recording.tracks
    assert -track.position_ned_m[:, 2].min() > 4.0
    assert 5.0 < np.ptp(track.position_ned_m[:, 0]) < 30.0
    assert f"is in {mode}" in [one.what for one in recording.remarks]


@pytest.mark.parametrize("seed", range(40))
def test_tracks_of_vehicles_that_lie_are_numbers(seed: int) -> None:
    """A right checksum does not make a position: fields are NaN, infinite, or of another planet."""
    lies, codec = Lies(seed, 0.5), Codec(9, 9)
    place = {"latitude": round(HERE.lat_deg * 1e7), "longitude": round(HERE.lon_deg * 1e7), "altitude": 584_000}
    still = dict.fromkeys(("x", "y", "z", "approach_x", "approach_y", "approach_z"), 0.0)
    home = Message("HOME_POSITION", {**place, **still, "q": [1.0, 0.0, 0.0, 0.0]}, 2, 1)
    told = [
        (t_s, lie)
        for t_s, message in [(0.0, home), *flight()[1:]]
        for _, data in lies(Codec(message.sysid, 1).encode(message), False)
        for lie in codec.decode(data)
    ]
    assert lies.told
    tracks, _, _, _ = recording_from_telemetry(told)
    for track in tracks:
        assert np.isfinite(track.t_s).all()
        assert (np.abs(track.position_ned_m) < 1e8).all()  # the diameter of the Earth is 1.3e7
