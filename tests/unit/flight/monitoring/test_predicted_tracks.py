"""A vehicle outside the band of its own predicted track is told soon, and one inside it never."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs.errors import FileFormatError
from gcs.flight.monitoring.monitor import VehicleView
from gcs.flight.monitoring.predicted_tracks import BAND_M, BAND_S, OffTrack, PredictedTracks, TrackWatch
from gcs.types import Array
from tests import near_miss

T0 = 1_700_000_000.0


def out_and_back() -> PredictedTracks:
    """Vehicle 7 rests at the origin for 10 s, flies north at 2 m/s for 20 s and comes back; 9 rests 5 m to the east."""
    t_s = np.arange(0.0, 50.05, 0.1)
    north_m = 2.0 * np.interp(t_s, [0.0, 10.0, 30.0, 50.0], [0.0, 0.0, 20.0, 0.0])
    moving = np.stack([north_m, 0.0 * t_s, 0.0 * t_s - 8.0], axis=-1)
    return PredictedTracks((9, 7), 0.0, np.array([np.full_like(moving, [0.0, 5.0, -8.0]), moving]))


def view(t_s: float, place: tuple[float, ...], mps: tuple[float, ...] = (0.0,) * 3, sysid: int = 7) -> VehicleView:
    return VehicleView(sysid, np.array(place), np.array(mps), T0 + t_s)


def ahead(seen: VehicleView, t_s: float, *seconds: float) -> Array:
    (path,) = out_and_back().ahead([seen], T0, T0 + t_s, np.array(seconds))
    return path


def test_a_slow_vehicle_goes_on_slowly_along_its_own_track_and_turns_there() -> None:
    slow = view(20.0, (16.0, 0.5, -8.2), (1.0, 0.0, 0.0))  # 2 s late, at half the speed
    np.testing.assert_allclose(ahead(slow, 20.0, 0.0, 4.0), [[16.0, 0.5, -8.2], [20.0, 0.5, -8.2]], atol=1e-6)
    np.testing.assert_allclose(ahead(slow, 21.0, 0.0), [[17.0, 0.5, -8.2]], atol=1e-6)  # its report is 1 s old
    near_end = view(29.0, (38.0, 0.0, -8.0), (2.0, 0.0, 0.0))
    np.testing.assert_allclose(ahead(near_end, 29.0, 1.0, 3.0)[:, 0], [40.0, 36.0], atol=1e-6)
    standing = view(20.0, (16.0, 0.0, -8.0))
    np.testing.assert_allclose(ahead(standing, 20.0, 5.0), [[16.0, 0.0, -8.0]], atol=1e-6)


def test_where_a_track_rests_time_passes_as_predicted() -> None:
    np.testing.assert_allclose(ahead(view(7.0, (0.0, 0.0, -8.0)), 7.0, 2.0, 5.0)[:, 0], [0.0, 4.0], atol=1e-6)


def test_where_a_track_comes_back_the_place_nearest_in_time_counts() -> None:
    assert ahead(view(25.0, (31.0, 0.0, -8.0), (2.0, 0.0, 0.0)), 25.0, 1.0)[0, 0] == pytest.approx(33.0)
    assert ahead(view(36.0, (31.0, 0.0, -8.0), (-2.0, 0.0, 0.0)), 36.0, 1.0)[0, 0] == pytest.approx(29.0)


def told(*reports: VehicleView, until_s: float = 45.0, tracks: PredictedTracks | None = None) -> list[list[OffTrack]]:
    """What the watch says after each report of one vehicle."""
    watch = TrackWatch(tracks or out_and_back(), until_s)
    first = view(0.0, (0.0, 0.0 if reports[0].sysid == 7 else 5.0, -8.0), sysid=reports[0].sysid)
    watch.look({first.sysid: first}, T0, (first.sysid,))
    return [watch.look({one.sysid: one}, T0, (one.sysid,)) for one in reports]


def late(t_s: float, by_m: float) -> VehicleView:
    return view(t_s, (2.0 * (t_s - 10.0) - by_m, 0.0, -8.0))


EDGE_M = 2.0 * BAND_S + 1.0  # on its track


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_vehicle_outside_its_band_is_told_once_until_it_is_back(sign: float) -> None:
    inside, outside = sign * (EDGE_M - 0.2), sign * (EDGE_M + 0.2)
    flown = [late(20.0, inside), late(20.1, outside), late(20.5, outside), late(20.7, outside), late(21.0, outside)]
    found = told(*flown, late(21.1, inside), late(22.0, outside), late(22.6, outside))
    assert [len(each) for each in found] == [0, 0, 0, 1, 0, 0, 0, 1]
    (off,) = found[3]
    assert (off.sysid, off.late_s) == (7, pytest.approx(sign * (EDGE_M + 0.2) / 2.0, abs=0.15))
    assert off.off_m < 0.25
    assert str(off).startswith(f"{abs(off.late_s):.1f} s {'late' if sign > 0.0 else 'early'} on its predicted track")


def test_to_the_side_and_in_height_the_band_is_as_wide() -> None:
    for side, up in ((BAND_M - 0.05, 0.0), (0.0, BAND_M - 0.05), (0.7 * BAND_M, 0.7 * BAND_M)):
        assert told(*(view(t_s, (20.0, side, -8.0 - up)) for t_s in (20.0, 21.0))) == [[], []]
        wider = (view(t_s, (20.0, 1.2 * side, -8.0 - 1.2 * up)) for t_s in (20.0, 21.0))
        assert [len(each) for each in told(*wider)] == [0, 1]


def test_what_an_autopilot_may_do_widens_the_band_of_its_vehicle_alone() -> None:
    wide = out_and_back()
    wide.band_s = PredictedTracks((9, 7), 0.0, wide._ned_m, spread_s=np.array([0.0, 1.0])).band_s
    by_m = EDGE_M + 1.0
    assert told(late(20.0, by_m), late(21.0, by_m), tracks=wide) == [[], []]
    assert len(told(late(20.0, by_m + 1.5), late(21.0, by_m + 1.5), tracks=wide)[1]) == 1
    assert len(told(*(view(t_s, (2.0, 5.0, -8.0), sysid=9) for t_s in (20.0, 21.0)), tracks=wide)[1]) == 1


def test_a_silent_vehicle_and_one_before_t0_or_in_the_landing_are_not_judged() -> None:
    off = (0.0, 30.0, -8.0)
    assert told(*[view(20.0, off)] * 3) == [[], [], []]
    assert told(*(view(t_s, off) for t_s in (-3.0, -2.0, -1.0))) == [[], [], []]
    assert told(*(view(t_s, off) for t_s in (46.0, 47.0, 48.0))) == [[], [], []]
    assert told(view(np.nan, (np.nan,) * 3)) == [[]]


def test_the_watch_knows_who_is_inside_before_it_tells() -> None:
    watch = TrackWatch(out_and_back(), 45.0)
    watch.look({7: late(19.9, 0.0)}, T0, (7,))
    for t_s, by_m, inside in ((20.0, 0.0, True), (20.1, 9.0, False), (20.2, 0.0, True)):
        watch.look({7: late(t_s, by_m)}, T0, (7,))
        assert watch.inside(7) is inside


def test_a_vehicle_that_starts_beside_its_track_comes_onto_it_first() -> None:
    """Its receiver has its pad 3 m to the east."""
    watch = TrackWatch(out_and_back(), 45.0)

    def told_at(t_s: float, north_m: float, east_m: float) -> int:
        return len(watch.look({7: view(t_s, (north_m, east_m, -8.0))}, T0, (7,)))

    assert [told_at(t_s, 0.0, 3.0) for t_s in (0.0, 1.0, 2.0)] == [0, 0, 0]
    assert [told_at(t_s, 2.0 * t_s - 20.0, 3.0 - (t_s - 10.0)) for t_s in (11.0, 12.0, 13.0)] == [0, 0, 0]
    assert [told_at(t_s, 2.0 * t_s - 20.0, 2.0) for t_s in (14.0, 15.0)] == [0, 1], "it was on its track"
    stays = TrackWatch(out_and_back(), 45.0)
    found = [(t_s, stays.look({7: view(t_s, (0.0, 3.0, -8.0))}, T0, (7,))) for t_s in np.arange(0.0, 20.0, 0.5)]
    assert min(t_s for t_s, off in found if off) == pytest.approx(13.5, abs=1.0), "it does not leave its hover"


def test_in_the_recorded_near_miss_the_slow_vehicle_is_told_in_time_and_no_other_ever() -> None:
    watch, found = TrackWatch(near_miss.tracks(), 250.0), {}
    for t_s in np.arange(0.0, near_miss.CLIMBED_S, 0.2).tolist():
        views = {}
        for row, sysid in enumerate(near_miss.plan().sysids):
            values = near_miss.reported(row, t_s)
            views[sysid] = VehicleView(sysid, values[:3], values[3:], T0 + t_s)
        found |= {(off.sysid, t_s): str(off) for off in watch.look(views, T0, tuple(views))}
    assert {sysid for sysid, _ in found} == {near_miss.LATE}
    first_s = min(t_s for _, t_s in found)
    assert 120.0 < first_s < 124.5 < near_miss.NEAREST_S - 80.0
    assert found[near_miss.LATE, first_s].startswith("2.4 s late on its predicted track and 0.7 m off it")


def test_attach_finds_the_tracks_that_the_flight_had(tmp_path: Path) -> None:
    seen, path = view(20.0, (16.0, 0.5, -8.2), (1.0, 0.0, 0.0)), tmp_path / "predicted.npz"
    tracks = out_and_back()
    tracks.band_s = tracks.band_s + 0.7
    tracks.save(path)
    read = PredictedTracks.load(path)
    seconds = np.array([0.0, 4.0])
    np.testing.assert_array_equal(
        read.ahead([seen], T0, T0 + 20.0, seconds), tracks.ahead([seen], T0, T0 + 20.0, seconds)
    )
    np.testing.assert_allclose(read.band_s, tracks.band_s)
    assert (read.sysids, read.band_m) == (tracks.sysids, tracks.band_m)
    path.write_bytes(path.read_bytes()[:-300])
    with pytest.raises(FileFormatError, match="no predicted tracks"):
        PredictedTracks.load(path)
    with pytest.raises(FileFormatError, match="No such file"):
        PredictedTracks.load(tmp_path / "nothing.npz")
