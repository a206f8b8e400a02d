"""A return ends when its vehicle rests above the end; a vehicle that does not follow gets a new reference."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gcs.flight.contingency import manoeuvres
from gcs.flight.contingency.manoeuvres import MotionReference, OrderedTracks, WayBack
from gcs.flight.contingency.policy import Order
from gcs.flight.monitoring.monitor import VehicleView
from gcs.flight.monitoring.progress import Action
from gcs.mission.returns.routed_motion import PiecewiseMotion
from gcs.mission.returns.rtl_cases import ReturnSpeeds
from gcs.types import Array
from tests.unit.flight.contingency.straight_plan import straight_plan, yaw_rad

T0_UNIX_S = 1000.0
# As the documents say.
ARRIVES_S, HOVER_M, LEFT_M, NEAR_M, RENEWALS_MAX, RENEWS_S, STILL_MPS = 8.0, 1.0, 2.0, 0.5, 3, 2.0, 0.3
# From (0, 0) to (20, 0) between 10 s and 30 s of plan time.
TRACK = MotionReference(
    PiecewiseMotion(
        np.array([[0.0, 10.0, 20.0]]),
        np.array([[[0.0, 0.0, -5.0], [10.0, 0.0, -5.0], [20.0, 0.0, -5.0]]]),
        np.array([[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 0.0]]]),
    ),
    10.0,
    0.0,
)


def seen(t_s: float, north_m: float, north_mps: float = 0.0, down_m: float = -5.0) -> VehicleView:
    """A report that came at plan time `t_s`."""
    view = VehicleView(3)
    view.unix_s = T0_UNIX_S + t_s
    view.position_ned_m, view.velocity_ned_mps = np.array([north_m, 0.0, down_m]), np.array([north_mps, 0.0, 0.0])
    return view


@pytest.mark.parametrize(
    ("t_s", "north_m", "north_mps", "arrived"),
    [
        (29.9, 20.0, 0.0, False),  # the reference has not ended
        (30.1, 20.0, 0.0, True),
        (30.1, 20.0 - 1.1 * NEAR_M, 0.0, False),
        (30.1, 20.0 + 0.9 * NEAR_M, 0.9 * STILL_MPS, True),
        (30.1, 20.0, 1.1 * STILL_MPS, False),  # it passes
        (30.0, 20.0, 0.0, False),
        (29.9 + ARRIVES_S, 15.0, 1.0, False),
        (30.1 + ARRIVES_S, 15.0, 1.0, True),  # it had its time
    ],
)
def test_a_return_ends_when_the_vehicle_rests_above_its_end(
    t_s: float, north_m: float, north_mps: float, arrived: bool
) -> None:
    way = WayBack(Order(3, Action.RETURN, ""), TRACK)
    assert way.has_arrived(seen(t_s, north_m, north_mps, down_m=-7.0), t_s) is arrived


@pytest.mark.parametrize(
    ("t_s", "off_m", "renewals", "left"),
    [
        (20.0, 0.9 * LEFT_M, 0, False),
        (20.0, 1.1 * LEFT_M, 0, True),
        (10.0 + 0.9 * RENEWS_S, 1.1 * LEFT_M, 0, False),  # it may still follow
        (10.0 + RENEWS_S, 1.1 * LEFT_M, 0, True),
        (20.0, 1.1 * LEFT_M, RENEWALS_MAX - 1, True),
        (20.0, 1.1 * LEFT_M, RENEWALS_MAX, False),
    ],
)
def test_a_vehicle_that_does_not_follow_gets_a_new_reference(
    t_s: float, off_m: float, renewals: int, left: bool
) -> None:
    way = WayBack(Order(3, Action.RETURN, ""), TRACK, renewals)
    assert way.is_left(seen(t_s, TRACK.at(0, t_s)[0] - off_m), T0_UNIX_S, t_s) is left
    late = seen(t_s - 0.5, TRACK.at(0, t_s)[0] - off_m - 0.5 * 1.5, 1.5)  # it flew on since its report
    assert way.is_left(late, T0_UNIX_S, t_s) is left


@pytest.mark.parametrize(
    ("t_s", "north_m", "north_mps", "push_mps2"),
    [
        (9.0, 0.0, 0.0, 0.0),  # it waits to begin
        (10.0, 0.0, 0.0, 0.2),
        (15.0, 2.5, 1.0, 0.2),
        (25.0, 17.5, 1.0, -0.2),
        (30.0, 20.0, 0.0, 0.0),
        (31.0, 20.0, 0.0, 0.0),  # it rests
    ],
)
def test_a_motion_is_even_pushes_between_its_knots(
    t_s: float, north_m: float, north_mps: float, push_mps2: float
) -> None:
    expected = (north_m, 0.0, -5.0, north_mps, 0.0, 0.0, push_mps2, 0.0, 0.0, 0.0)
    assert TRACK.at(0, t_s) == pytest.approx(expected)
    assert (TRACK.begin_s, TRACK.end_s, TRACK.end_ned_m.tolist()) == (10.0, 30.0, [20.0, 0.0, -5.0])


class Open:
    """Ways over open ground: straight, or none."""

    none = False

    def __init__(self, plan: object) -> None:
        self.asked: list[float] = []

    def depth_m(self, tracks: Array, t_s: Array) -> Array:
        return np.zeros(len(t_s))

    def way_ned_m(self, from_ned_m: Array, to_ned_m: Array, t_s: float) -> Array | None:
        self.asked.append(t_s)
        return None if self.none else np.array([from_ned_m[:2], to_ned_m[:2]])


ROW, ALTITUDES_M, SAFE_NED_M = 1, (30.0, 20.0, 25.0), (50.0, 60.0, -2.0)


@pytest.fixture
def tracks(monkeypatch: pytest.MonkeyPatch) -> OrderedTracks:
    """Orders to vehicle 1 in row 1, whose pad is 5 m south; vehicle 2 has a safe point."""
    monkeypatch.setattr(manoeuvres, "ReturnRoutes", Open)
    returns: Any = SimpleNamespace(speeds=ReturnSpeeds(2.0, 5.0, 1.0, 0.0), altitudes_m=ALTITUDES_M)
    chosen: Any = {2: SimpleNamespace(chosen=SimpleNamespace(target_ned_m=SAFE_NED_M))}
    chosen[3] = SimpleNamespace(chosen=SimpleNamespace(target_ned_m=None))
    return OrderedTracks(straight_plan(), returns, chosen)


@pytest.mark.parametrize("begin_s", [30.0, 100.0])  # beyond the end of the plan too
@pytest.mark.parametrize(
    ("action", "sysid", "end_ned_m", "top_m"),
    [
        (Action.HOLD, 1, [103.0 + 3.0, 0.0, -8.0], 8.0),  # 3 m/s at 1.5 m/s²
        (Action.SPREAD, 1, [103.0 + 3.0, 0.0, -10.0], 10.0),
        (Action.RETURN, 1, [-5.0, 0.0, -HOVER_M], 20.0),
        (Action.RETURN, 2, [-5.0, 0.0, -HOVER_M], 20.0),
        (Action.DIVERT, 1, [-5.0, 0.0, -HOVER_M], 20.0),  # nothing was chosen
        (Action.DIVERT, 3, [-5.0, 0.0, -HOVER_M], 20.0),
        (Action.DIVERT, 2, [50.0, 60.0, -2.0 - HOVER_M], 20.0),
    ],
)
def test_an_order_leads_from_where_the_vehicle_will_be_to_where_it_ends(
    tracks: OrderedTracks, action: Action, sysid: int, end_ned_m: list[float], top_m: float, begin_s: float
) -> None:
    """The report is a second old: at 3 m/s the vehicle is 3 m on."""
    view = VehicleView(sysid, np.array([100.0, 0.0, -8.0]), np.array([3.0, 0.0, 0.0]), T0_UNIX_S + begin_s - 1.0)
    order = Order(sysid, action, "")
    track = tracks.reference(order, view, ROW, T0_UNIX_S, begin_s)
    assert track is not None
    assert track.begin_s == begin_s
    assert track.at(0, begin_s)[:6] == pytest.approx((103.0, 0.0, -8.0, 3.0, 0.0, 0.0))
    assert track.at(0, begin_s)[9] == pytest.approx(yaw_rad(min(begin_s, 60.0)))
    assert track.end_ned_m == pytest.approx(end_ned_m)
    heights_m = [-track.at(0, float(t_s))[2] for t_s in np.linspace(begin_s, track.end_s, 400)]
    assert max(heights_m) == pytest.approx(top_m, abs=0.05)
    returns = action in (Action.RETURN, Action.DIVERT)
    assert tracks.routes.asked == [begin_s] * returns  # type: ignore[attr-defined]
    if returns:
        assert tracks.end_ned_m(order, ROW) == pytest.approx(np.add(end_ned_m, [0.0, 0.0, HOVER_M]))


def test_a_return_without_a_way_has_no_reference(tracks: OrderedTracks, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Open, "none", True)
    view = VehicleView(1, np.array([100.0, 0.0, -8.0]), np.zeros(3), T0_UNIX_S)
    assert tracks.reference(Order(1, Action.RETURN, ""), view, ROW, T0_UNIX_S, 0.0) is None
    assert tracks.reference(Order(1, Action.HOLD, ""), view, ROW, T0_UNIX_S, 0.0) is not None
