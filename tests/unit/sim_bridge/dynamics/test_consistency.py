"""Whether filters are as wrong as they say: NEES and NIS of two hundred seeded flights against their 95 % bounds.

NEES: squared error in units of the filter's own covariance; 200 times its mean over the flights is chi-square with
200 n degrees of freedom. NIS: the same for innovations. The flights are one batch: up, hover, run, in wind and gusts,
which filters know nothing of.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2

from gcs.types import Array
from sim_bridge.dynamics.estimator import GATE_SIGMA
from sim_bridge.dynamics.presets import PRESETS
from sim_bridge.dynamics.sensors import BARO_PERIOD_S, GRADES, RTK, Sensors
from sim_bridge.dynamics.wind_field import parse_wind
from tests.unit.sim_bridge.flights import course, stand, steps

FLIGHTS = 200
UPDATE_STEPS = steps(BARO_PERIOD_S)


@dataclass
class Consistency:
    """Means over the flights, one per instant."""

    nees: Array
    states: int
    nis: dict[str, Array]


def bounds(freedom, flights=FLIGHTS):
    """Between which 95 % of all means over the flights lie."""
    return chi2.ppf([0.025, 0.975], freedom * flights) / flights


def watched(airframes, seconds):
    """Fly and look at the filters after every update in which all vehicles are in the air."""
    vehicles = len(airframes.landed)
    home = airframes.estimate[:, :3].copy()
    flight, motors_on = course(yaw_swing_rad=0.3), np.ones(vehicles, dtype=bool)
    known = np.flatnonzero(airframes.estimator.ekf.P[0].diagonal() > 0.0)  # rtk has no slow error of position
    nees, nis = [], {"fix": [], "compass": [], "baro": []}
    for k in range(steps(seconds)):
        airframes.step(flight.at(k, home), motors_on)
        if airframes.landed.any() or round(airframes.t_s / 0.02) % UPDATE_STEPS:
            continue
        ratios, ekf = airframes.estimator.ratios, airframes.estimator.ekf
        nis["baro"].append(np.mean((GATE_SIGMA * ratios.baro) ** 2))
        if ekf.y.shape[1] == 1:
            nis["compass"].append(np.mean((GATE_SIGMA * ratios.compass) ** 2))
            continue  # the slow error of GNSS is only there when there is a fix
        nis["fix"].append(np.mean(np.asarray(ekf.y.T.dot(ekf.SI).dot(ekf.y))))
        truth = np.concatenate((airframes.truth[:, :9], airframes.sensors.slow_errors.T), axis=1)
        off = (airframes.estimator.mean - truth)[:, known]
        covariance = airframes.estimator.ekf.P[:, known[:, None], known]
        nees.append(np.mean(np.einsum("vi,vi->v", off, np.linalg.solve(covariance, off[..., None])[..., 0])))
    return Consistency(np.array(nees), len(known), {name: np.array(values) for name, values in nis.items()})


def fleet(name, grade, vehicles, seed):
    preset = PRESETS[name]
    pads = 20.0 * np.stack([np.arange(vehicles) % 20, np.arange(vehicles) // 20, np.zeros(vehicles)], axis=1)
    return stand(preset.quadrotor, preset.limits, grade, pads, seed, parse_wind("1@200", "light"))


@pytest.fixture(
    scope="module",
    params=[pytest.param(("f150", "rtk", 11), marks=pytest.mark.slow), ("field", "gnss", 3)],
    ids=["f150-rtk", "field-gnss"],
)
def flights(request):
    name, grade, seed = request.param
    return watched(fleet(name, GRADES[grade], FLIGHTS, seed), 18.0)


def test_errors_are_as_large_as_the_filters_say(flights):
    low, high = bounds(flights.states)
    assert len(flights.nees) > 50
    assert low < flights.nees.mean() < high
    assert np.mean((low < flights.nees) & (flights.nees < high)) > 0.9


@pytest.mark.parametrize(("sensor", "freedom"), [("fix", 6), ("baro", 1), ("compass", 1)])
def test_innovations_are_as_large_as_the_filters_say(flights, sensor, freedom):
    low, high = bounds(freedom)
    nis = flights.nis[sensor]
    assert low < nis.mean() < high
    assert np.mean((low < nis) & (nis < high)) > 0.85


def test_innovations_have_no_memory(flights):
    for nis in flights.nis.values():
        off = nis - nis.mean()
        assert abs((off[1:] * off[:-1]).mean() / off.var()) < 4.0 / np.sqrt(len(nis))


def test_a_receiver_half_again_as_noisy_as_its_data_sheet_is_found_out():
    airframes = fleet("f150", RTK, 50, 13)
    worse = replace(
        RTK, gnss_horizontal_m=1.5 * RTK.gnss_horizontal_m, gnss_horizontal_mps=1.5 * RTK.gnss_horizontal_mps
    )
    airframes.sensors = Sensors(worse, 50, 14)
    found = watched(airframes, 8.0)
    assert found.nis["fix"].mean() > bounds(6, 50)[1]


@pytest.mark.parametrize(
    ("name", "grade"),
    [
        pytest.param(name, grade, marks=pytest.mark.slow if (name, grade) == ("field", "gnss") else pytest.mark.long)
        for name in PRESETS
        for grade in GRADES
    ],
)
def test_long_flights_stay_consistent(name, grade):
    long = watched(fleet(name, GRADES[grade], FLIGHTS, 15), 100.0)
    low, high = bounds(long.states)
    assert low < long.nees.mean() < high
    assert np.mean((low < long.nees) & (long.nees < high)) > 0.75
    for sensor, freedom in (("fix", 6), ("baro", 1), ("compass", 1)):
        low, high = bounds(freedom)
        assert low < long.nis[sensor].mean() < high
