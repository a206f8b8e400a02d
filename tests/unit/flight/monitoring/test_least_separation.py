"""The least separation that a flight tells: nothing is predicted, old reports make it neither less nor more."""

import numpy as np
import pytest

from gcs.flight.monitoring.least_separation import LeastSeparation
from gcs.flight.monitoring.progress import FlightPart

RADIUS_M = 6.0


def circle(t_s: float, phase: float, speed_mps: float = 4.0) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity of a vehicle that turns."""
    rate = speed_mps / RADIUS_M
    at = phase + rate * t_s
    place = RADIUS_M * np.array([np.cos(at), np.sin(at), 0.0])
    return place, speed_mps * np.array([-np.sin(at), np.cos(at), 0.0])


def on_plan(unix_s: float) -> FlightPart:
    """Every time is after T0."""
    return FlightPart.FLIGHT


@pytest.mark.parametrize("late_s", [0.0, 0.4, 1.1, 1.9])
def test_reports_of_any_age_tell_the_separation_of_vehicles_that_turn(late_s: float) -> None:
    least = LeastSeparation()
    for tick in range(200):
        t_s = 0.1 * tick
        least.receive(1, t_s, *circle(t_s, 0.0))
        if tick % 5 == 0 and t_s >= late_s:
            least.receive(2, t_s - late_s, *circle(t_s - late_s, 1.0))
        least.look((1, 2), on_plan, {})
    nearest = least.nearest[FlightPart.FLIGHT]
    assert nearest.distance_m == pytest.approx(2.0 * RADIUS_M * np.sin(0.5), abs=0.02)


def test_a_short_approach_between_calls_is_seen() -> None:
    least = LeastSeparation()
    still = np.zeros(3)
    for tick in range(31):
        t_s = 0.2 * tick
        passing = np.array([4.0 * (t_s - 3.0), 0.5, 0.0])  # at 3.0 s beside vehicle 1
        least.receive(1, t_s, still, still)
        least.receive(2, t_s, passing, np.array([4.0, 0.0, 0.0]))
        if tick % 10 == 3:  # at 0.6, 2.6 and 4.6 s
            least.look((1, 2), on_plan, {})
    assert least.nearest[FlightPart.FLIGHT].distance_m == pytest.approx(0.5, abs=0.01)
    assert least.nearest[FlightPart.FLIGHT].unix_s == pytest.approx(3.0, abs=0.06)


def test_between_reports_that_are_seconds_apart_nothing_is_known() -> None:
    least = LeastSeparation()
    still = np.zeros(3)
    for t_s, north_m in ((0.0, 10.0), (2.5, -10.0)):
        least.receive(2, t_s, np.array([north_m, 0.0, 0.0]), np.array([-8.0, 0.0, 0.0]))
    for tick in range(26):
        least.receive(1, 0.1 * tick, still, still)
        least.look((1, 2), on_plan, {})
    assert least.nearest[FlightPart.FLIGHT].distance_m == pytest.approx(10.0)
