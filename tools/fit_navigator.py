"""Fit of the navigator models to recordings of real autopilots, with their errors on missions left out of the fit.

    ./tools/run python tools/fit_navigator.py [--recordings tests/recorded/timed_legs] [--only ardupilot|px4] [--no-fit]

Two numbers are fitted for each: on ArduPilot the lag and the drag of the vehicle, on PX4 (whose simulator's drag is
known) what its integral gives back in descents and the error of home's height. The autopilot reported everything else.
Prints the parameters and the residuals for gcs/autopilots/waypoint_models/calibration.py; with `--no-fit` those of the
parameters as they are. A few minutes.
"""

import gzip
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from gcs.autopilots.waypoint_models.calibration import ARDUPILOT, PX4
from gcs.autopilots.waypoint_models.navigator import Navigator, NavigatorOrders
from gcs.autopilots.waypoint_models.predict import passing_times, predict
from gcs.types import Array
from tools.bench.frame import ROOT, options

RECORDINGS = ROOT / "tests" / "recorded" / "timed_legs"
MISSIONS = ("a", "b", "c")
_MS = 1e-3
_LIFTED_M = 0.3


@dataclass(frozen=True)
class Recording:
    """One mission as flown: times (M,) from leaving the start, positions (M, 3), and when each waypoint was passed."""

    name: str
    orders: NavigatorOrders
    t_s: Array
    position_ned_m: Array
    passed_s: Array


@dataclass(frozen=True)
class Model:
    """A navigator with a few parameters free: where a fit begins, what is in use, how to make it from them."""

    name: str
    folder: str
    labels: tuple[str, ...]
    start: tuple[float, ...]
    used: tuple[float, ...]
    make: Callable[[Sequence[float]], Navigator]


def _ardupilot(values: Sequence[float]) -> Navigator:
    return replace(ARDUPILOT, following=replace(ARDUPILOT.following, lag_s=values[0], drag_ps=values[1]))


def _px4(values: Sequence[float]) -> Navigator:
    return replace(PX4, following=replace(PX4.following, unwinding=values[0]), height_error_m=values[1])


_USED = (ARDUPILOT.following.lag_s, ARDUPILOT.following.drag_ps), (PX4.following.unwinding, PX4.height_error_m)
MODELS = (
    Model("ardupilot", "arducopter-4.5.6", ("lag_s", "drag_ps"), (0.2, 0.2), _USED[0], _ardupilot),
    Model("px4", "px4-1.17dev", ("unwinding", "height_error_m"), (2.0, 0.5), _USED[1], _px4),
)


def read_recording(folder: Path, name: str) -> Recording:
    """`timed_legs_<name>` of one autopilot. Raises OSError where it is not there."""
    with gzip.open(folder / f"timed_legs_{name}.jsonl.gz", "rt", encoding="utf-8") as file:
        rows: list[dict[str, Any]] = [json.loads(line) for line in file]
    zero = next(row for row in rows if row.get("text", "").startswith("north 0"))
    zero_ned_m = np.array([zero["x"], zero["y"], zero["z"]])
    plan = [row for row in rows if row.get("text") == "plan"]
    points = zero_ned_m + [[row["n"], row["e"], -row["alt"]] for row in plan]
    left_s = next(row["boot_ms"] for row in rows if row.get("text") == "reached") * _MS
    track = np.array(
        [
            [row["fields"][key] for key in ("time_boot_ms", "x", "y", "z")]
            for row in rows
            if row.get("name") == "LOCAL_POSITION_NED"
        ]
    )
    track[:, 0] = track[:, 0] * _MS - left_s
    rising = track[:, 3] < zero_ned_m[2] - _LIFTED_M
    airborne_s = -float(track[np.argmax(rising), 0])
    flown = track[track[:, 0] >= 0.0]
    orders = NavigatorOrders.through(points, [row["speed"] for row in plan[1:]], airborne_s=airborne_s)
    return Recording(name, orders, flown[:, 0], flown[:, 1:], _passed(orders, flown[:, 0], flown[:, 1:]))


def _passed(orders: NavigatorOrders, t_s: Array, position_ned_m: Array) -> Array:
    """The recorded path comes near each waypoint once, so the nearest sample of all tells which legs lie where."""
    nearest = [
        t_s[np.linalg.norm(position_ned_m[:, :2] - point[:2], axis=1).argmin()] for point in orders.waypoints_ned_m
    ]
    if np.any(np.diff(nearest) <= 0.0):
        raise ValueError("the recorded path crosses itself at a waypoint: times of passing cannot be distinguished")
    return passing_times(t_s, position_ned_m, orders, np.array([*nearest[:-1], t_s[-1]]))


def errors_s(navigator: Navigator, recording: Recording) -> Array:
    """Predicted minus recorded times of passing (N,)."""
    return np.asarray(predict(navigator, recording.orders).passed_s - recording.passed_s)


def fit(model: Model, recordings: Sequence[Recording]) -> list[float]:
    """The free parameters with the least squared errors, every mission weighing the same."""
    start = np.array(model.start)

    def cost(scale: Array) -> float:
        if np.any(scale <= 0.0):
            return 1e6
        navigator = model.make((start * scale).tolist())
        return float(np.mean([np.mean(errors_s(navigator, r) ** 2) for r in recordings]))

    simplex = np.vstack([np.ones(len(start)), np.ones(len(start)) + 0.2 * np.eye(len(start))])
    options = {"initial_simplex": simplex, "xatol": 0.02, "fatol": 1e-3, "maxfev": 60}
    best = minimize(cost, np.ones(len(start)), method="Nelder-Mead", options=options)
    return [round(float(value), 3) for value in start * best.x]


def report(model: Model, folder: Path, *, refit: bool) -> None:
    """Print what the fit gives: in sample, and for each mission with the others alone."""
    recordings = [read_recording(folder / model.folder, name) for name in MISSIONS]
    values = fit(model, recordings) if refit else list(model.used)
    print(f"{model.name}: " + ", ".join(f"{label} {value}" for label, value in zip(model.labels, values, strict=True)))
    for recording in recordings:
        error = errors_s(model.make(values), recording)
        line = f"  {recording.name}: rms {_rms(error):.2f} s, mean {error.mean():+.2f}, worst {_worst(error):+.2f}"
        if refit:
            others = fit(model, [other for other in recordings if other is not recording])
            unseen = errors_s(model.make(others), recording)
            line += f"; unseen rms {_rms(unseen):.2f} s, worst {_worst(unseen):+.2f} with {others}"
        print(line, flush=True)


def _rms(error: Array) -> float:
    return float(np.sqrt(np.mean(error**2)))


def _worst(error: Array) -> float:
    return float(error[np.abs(error).argmax()])


def main() -> None:
    """Fit what is asked for."""
    asked = options(__doc__, recordings=RECORDINGS, only=[model.name for model in MODELS], no_fit=False)
    for model in MODELS:
        if model.name in asked.only:
            report(model, asked.recordings, refit=not asked.no_fit)


if __name__ == "__main__":
    main()
