"""The speeds of an autopilot's own landing, in closed form and as recorded; the emulated autopilots land with them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.autopilots.columns import LandingProfile
from gcs.autopilots.traits import TRAITS, Autopilot
from gcs.flight.monitoring.expected_motion import ExpectedMotion
from gcs.flight.recording.load_recording import load_recording
from sim_bridge.personality import ARDUPILOT, PX4, Intent, Personality
from tests.real_flights import unpacked
from tests.unit.sim_bridge import bodies

HEIGHTS = st.floats(0.5, 80.0)


@given(st.floats(0.2, 5.0), HEIGHTS, st.floats(0.0, 2.0))
def test_a_constant_speed_descends_linearly(speed_mps: float, from_m: float, delay_s: float) -> None:
    profile = LandingProfile((0.0,), (speed_mps,), delay_s)
    assert profile.duration_s(from_m, 0.0) == pytest.approx(delay_s + from_m / speed_mps)
    t_s = np.linspace(0.0, profile.duration_s(from_m, 0.0), 7)
    expected = from_m - speed_mps * np.maximum(t_s - delay_s, 0.0)
    np.testing.assert_allclose(profile.height_m(from_m, 0.0, t_s), expected, atol=1e-9)


@given(st.floats(0.3, 1.0), st.floats(1.1, 3.0), st.floats(2.0, 6.0), st.floats(7.0, 12.0))
def test_a_speed_linear_in_height_takes_a_logarithm_of_time(slow: float, fast: float, low: float, high: float) -> None:
    profile = LandingProfile((low, high), (slow, fast))
    expected = (high - low) / (fast - slow) * math.log(fast / slow)
    assert profile.duration_s(high, low) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("autopilot", Autopilot)
@given(HEIGHTS)
def test_a_descent_falls_from_its_height_to_the_ground_and_stays(autopilot: Autopilot, from_m: float) -> None:
    profile = TRAITS[autopilot].landing.profile()
    t_s = np.linspace(-1.0, profile.duration_s(from_m, 0.0) + 5.0, 200)
    height_m = profile.height_m(from_m, 0.0, t_s)
    assert height_m[0] == from_m
    assert height_m[-1] == 0.0
    assert (np.diff(height_m) <= 0.0).all()


def test_the_parameters_of_a_vehicle_set_its_speeds() -> None:
    slow = TRAITS[Autopilot.ARDUPILOT].landing.profile({"LAND_SPEED": 30.0, "LAND_ALT_LOW": 500.0})
    np.testing.assert_allclose(slow.speed_mps(np.array([1.0, 5.2, 30.0])), [0.3, 0.3, 1.5])
    high = TRAITS[Autopilot.ARDUPILOT].landing.profile({"LAND_SPEED_HIGH": 200.0})
    assert high.speed_mps(np.array([50.0])) == 2.0
    px4 = TRAITS[Autopilot.PX4].landing.profile({"MPC_Z_V_AUTO_DN": 2.0, "MPC_LAND_ALT1": 20.0})
    np.testing.assert_allclose(px4.speed_mps(np.array([5.0, 20.0, 40.0])), 0.95 * np.array([0.7, 2.0, 2.0]))


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_parameters_by_which_nothing_could_land_count_as_not_known(value: float) -> None:
    for autopilot, traits in TRAITS.items():
        for name in traits.landing.parameters:
            profile = traits.landing.profile({name: value})
            assert np.isfinite(profile.duration_s(30.0, 0.0)), (autopilot, name)


@pytest.mark.parametrize(
    ("heights", "speeds"),
    [
        ((1.0, 1.0), (1.0, 1.0)),
        ((1.0, np.nan), (1.0, 1.0)),
        ((1.0,), (0.0,)),
        ((1.0,), (np.inf,)),
        ((1.0,), (1.0, 2.0)),
    ],
)
def test_a_profile_that_is_none_is_refused(heights: tuple[float, ...], speeds: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="landing profile"):
        LandingProfile(heights, speeds)


# Horizontal deviation from where they began to land, vertical and median vertical deviation of six real vehicles, m.
# Below the landing points, which the flat ground of the simulators does not have, nothing is compared. The estimates of
# PX4's simulator drift.
FLOWN = {
    "arducopter-4.5.6-stream": (0.1, 0.7, 0.4),
    "px4-1.17dev-stream": (0.9, 1.2, 1.0),
    "mixed-stream": (1.0, 3.0, 0.6),
    "arducopter-4.5.6-follow-wind": (0.1, 1.1, 0.6),
}


@pytest.mark.parametrize("name", FLOWN)
def test_recorded_landings_keep_to_the_profile(name: str, tmp_path: Path) -> None:
    recording = load_recording(unpacked(name, tmp_path)).recording
    plan = recording.plan
    assert plan is not None
    expected = ExpectedMotion(plan, recording.landings)
    begin_s = plan.phase("landing").start_s
    beside, above, unlike_plan = [], [], []
    for row, track in enumerate(recording.tracks):
        t_s, places = track.t_s[track.t_s > begin_s], track.position_ned_m[track.t_s > begin_s]
        states = expected.of_vehicle(row, t_s)
        down = (states[:, 2] < plan.landing_points_ned_m[row, 2] - 0.2) & (t_s < plan.t_end_s)
        off = places[down] - states[down, :3]
        beside.append(np.linalg.norm(off[:, :2] - off[0, :2], axis=1).max())  # of where it began to land
        above.append(np.abs(off[:, 2]).max())
        planned = plan.states(t_s[down])[row, :, 2]
        unlike_plan.append(np.abs(places[down, 2] - planned).max())
    assert max(beside) <= FLOWN[name][0]
    assert max(above) <= FLOWN[name][1]
    assert np.median(above) <= FLOWN[name][2]
    assert max(unlike_plan) > 4.0


@pytest.mark.parametrize(("autopilot", "personality"), [(Autopilot.ARDUPILOT, ARDUPILOT), (Autopilot.PX4, PX4)])
def test_the_emulated_autopilots_land_with_the_same_speeds(
    autopilot: Autopilot, personality: Personality, monkeypatch: pytest.MonkeyPatch
) -> None:
    strong = replace(bodies.LIMITS, vertical_mps=4.0, vertical_mps2=3.0)
    monkeypatch.setattr(bodies, "LIMITS", strong)
    body = bodies.Body(personality)
    body.fly(24.0)
    body.mode(Intent.LAND)
    begin_s, from_m = body.t_s, body.height_m
    profile = TRAITS[autopilot].landing.profile()
    worst_m = 0.0
    while body.height_m > 0.3:
        body.run(0.5)
        expected_m = float(profile.height_m(from_m, 0.0, np.array([body.t_s - begin_s]))[0])
        worst_m = max(worst_m, abs(body.height_m - expected_m))
    assert worst_m < 1.3  # it keeps the speeds that PX4 falls short of by 5 %
