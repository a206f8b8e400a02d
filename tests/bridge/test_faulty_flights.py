"""The same faults give the same flight at any speed-up: links that lose and delay setpoints, bodies that break."""

from __future__ import annotations

import math
import threading

import numpy as np
import pytest

from gcs.mavlink import CopterMode, MessageId
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values import si
from sim_bridge.faults.fault_spec import parse_faults
from sim_bridge.protocol.endpoint_address import EndpointKind, EndpointSpec
from sim_bridge.sim.world import WorldOptions
from tests.bridge.test_links import udp_station
from tests.fleets import ask, running_fleet

BEGINS_S, LASTS_S, FAR_M = 24.0, 10.0, 1.0
PERIOD_S = 0.04
LEAD_MS = 400
FULL_MASK = 0x800  # position, velocity, acceleration and yaw
BAD_LINK = ("1:up.loss=0.25", "1:up.duplicate=0.2", "1:up.reorder=0.1", "1:up.corrupt=0.1", "1:up.delay=0.15,0.1")
BROKEN = ("1:gnss-outage@start:25..28", "1:gnss-jump=0.5,0,0@start:29..31", "1:motor=2,0.02@start:30")


def wanted(t_s: np.ndarray) -> np.ndarray:
    """A smooth excursion from rest to rest: position, velocity, acceleration (N, 3)."""
    s = t_s / LASTS_S
    return np.stack(
        [
            FAR_M * (s**3 * (10 - 15 * s + 6 * s * s)),
            FAR_M / LASTS_S * (30 * s**2 * (1 - s) ** 2),
            FAR_M / LASTS_S**2 * (60 * s * (1 - s) * (1 - 2 * s)),
        ],
        axis=-1,
    )


def flown(scenario: Scenario, speedup: float, *texts: str, beats: int = 1) -> np.ndarray:
    """True states of vehicle 1 along a stamped stream; a ground station that talks more says `beats` > 1."""
    options = WorldOptions(
        links=[EndpointSpec(EndpointKind.UDP_IN, shared=True)],
        speedup=speedup,
        seed=7,
        faults=parse_faults(texts, si.sysids(scenario)),
        record_truth=True,
    )
    with running_fleet(scenario, options, paused=True) as fleet, udp_station(fleet.places[1][0].port) as ground:
        vehicle = fleet.vehicles[0]
        ask(fleet, 0, MessageId.LOCAL_POSITION_NED, 10.0)
        pilot = vehicle.autopilot
        pilot.set_mode(fleet.t_s, CopterMode.GUIDED)
        pilot.arm(fleet.t_s, fleet.airframes.estimate[0])
        pilot.take_off(fleet.t_s, 3.0)
        boot_ms = -round(1000 * vehicle.instruments.simulated_s(0))
        thread = threading.Thread(target=fleet.run, args=(BEGINS_S + LASTS_S + 2.0,))
        thread.start()
        t_s = np.arange(0.0, LASTS_S + PERIOD_S / 2, PERIOD_S)
        stamps_ms = np.rint(1000 * (t_s + BEGINS_S)).astype(int) + boot_ms
        rows = wanted(t_s).tolist()
        sent = 0
        while sent < len(t_s):
            now_ms = ground.hear("LOCAL_POSITION_NED", 1).fields["time_boot_ms"]
            for _ in range(beats):
                ground.beat()
            while sent < len(t_s) and stamps_ms[sent] < now_ms + LEAD_MS:
                p, v, a = rows[sent]
                ground.say(
                    "SET_POSITION_TARGET_LOCAL_NED",
                    **{"time_boot_ms": int(stamps_ms[sent]), "target_system": 1, "target_component": 1},
                    **{"coordinate_frame": 1, "type_mask": FULL_MASK, "x": p, "y": p, "z": -3.0, "vx": v, "vy": v},
                    **{"vz": 0.0, "afx": a, "afy": a, "afz": 0.0, "yaw": math.pi / 4, "yaw_rate": 0.0},
                )
                sent += 1
        thread.join(60.0)
        assert not thread.is_alive()
        assert fleet.truth is not None
        return fleet.truth.state[0]


@pytest.fixture(scope="module")
def sound(simulation1: Scenario) -> np.ndarray:
    return flown(simulation1, math.inf)


@pytest.mark.slow
@pytest.mark.parametrize(
    "texts",
    [
        pytest.param(BAD_LINK, id="bad link", marks=pytest.mark.long),
        pytest.param(BAD_LINK + BROKEN, id="broken body too"),
    ],
)
def test_faults_are_flown_the_same_at_any_speedup(
    simulation1: Scenario, sound: np.ndarray, texts: tuple[str, ...]
) -> None:
    fast = flown(simulation1, math.inf, *texts)
    slow = flown(simulation1, 12.0, *texts, beats=3)
    np.testing.assert_array_equal(fast, slow)
    assert np.abs(fast - sound).max() > 1e-3  # they did make a difference
