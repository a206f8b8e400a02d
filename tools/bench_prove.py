"""Benchmark of `gcs prove`: 100 tracks of 10 minutes, and 1,000 of 5 minutes, far apart and in close formation.

In the last two cases no vehicle is sampled at the time of another.

./tools/run python tools/bench_prove.py [--json FILE]

Cubics through samples at a common rate. Vehicles that are far apart wander within 12 m of places 40 m apart; those in
formation wander within 0.4 m of places 3 m apart, along one winding course. Each case is a process of its own.
"""

import time
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d

import gcs
from gcs.mission.proving.timed_samples import through
from tools.bench.frame import apart, finish, options, serve
from tools.bench.memory import peak_mb

CASES = (  # formation, own times, vehicles, minutes, samples a second, separation in m, and the goal in s
    (False, False, 100, 10, 10.0, 2.0, 60.0),
    (False, False, 1000, 5, 2.0, 2.0, 600.0),
    (True, False, 1000, 5, 2.0, 1.5, 600.0),
    (False, True, 1000, 5, 2.0, 2.0, 600.0),
    (True, True, 1000, 5, 2.0, 1.5, 600.0),
)


def measure(
    close: bool, own_times: bool, vehicles: int, minutes: int, rate_hz: float, separation_m: float, goal_s: float
) -> dict[str, Any]:
    """One proof in this process."""
    rng = np.random.default_rng(0)
    t_s = np.arange(0.0, 60.0 * minutes + 1e-9, 1.0 / rate_hz)
    side, spacing_m, wander_m = int(np.ceil(np.sqrt(vehicles))), *((3.0, 0.4) if close else (40.0, 12.0))
    walk = np.cumsum(rng.normal(0.0, 1.0, (len(t_s), 3)), axis=0)
    course = 20.0 * close * gaussian_filter1d(walk, 5.0 * rate_hz, axis=0)
    tracks = []
    for row in range(vehicles):
        own = gaussian_filter1d(rng.normal(0.0, 1.0, (len(t_s), 3)), 2.0 * rate_hz, axis=0)
        place = np.array([spacing_m * (row // side), spacing_m * (row % side), -30.0])
        flown = course + place + own * wander_m / np.abs(own).max()
        motion = through(t_s, flown, np.gradient(flown, t_s, axis=0))
        if own_times:
            at_s = t_s + np.pad(rng.uniform(-0.3, 0.3, len(t_s) - 2) / rate_hz, 1)
            motion = through(at_s, motion(at_s), motion(at_s, 1))
        tracks.append(gcs.PolynomialTrack(f"v{row}", motion))
    began_s, began_cpu_s = time.perf_counter(), time.process_time()
    report = gcs.prove(tracks, gcs.TrackLimits(separation_m))
    took_s = time.perf_counter() - began_s
    return {
        "flight": ("close formation" if close else "far apart") + (", own times" if own_times else ""),
        "vehicles": vehicles,
        "minutes": minutes,
        "proved": report.ok,
        "s": took_s,
        "cpu_s": time.process_time() - began_cpu_s,
        "memory_mb": peak_mb(),
        "goal_s": goal_s,
        "met": took_s <= goal_s,
    }


def main() -> None:
    """Run all cases and print them."""
    serve(measure)
    asked = options(__doc__, json=None)
    finish("trajectories of any planner, proved", [apart(__file__, *case) for case in CASES], asked.json)


if __name__ == "__main__":
    main()
