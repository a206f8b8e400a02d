"""Position errors of emulated vehicles in wind, in hover and in flight.

./tools/run python tools/measure_wind.py [--seconds 60] [--seed 1]

Both presets with RTK-grade receivers, four vehicles each: up to 6 m, a hover of `--seconds`, then 60 m there and back
as fast as their limits allow. Errors are of true positions against the reference, the first 10 s of wind left out.
"""

import numpy as np
from numpy.typing import NDArray

from gcs.scenario.sources.load import load_scenario
from sim_bridge.autopilot.guidance.motion_primitives import MotionLimits, transfer
from sim_bridge.autopilot.guidance.piece import DERIVATIVES, Piece, PieceBatch, hold
from sim_bridge.dynamics.airframes import CONTROL_PERIOD_S, Airframes, Craft
from sim_bridge.dynamics.presets import PRESETS
from sim_bridge.dynamics.sensors import RTK
from sim_bridge.dynamics.wind_field import parse_wind
from tools.bench.frame import ROOT, options, show

SCENARIO_OF = {"f150": "simulation1", "field": "field"}
WINDS = {
    "f150": (("", ""), ("1@240", ""), ("1@240", "light"), ("2@240", "light")),
    "field": (("", ""), ("3@240", "light"), ("5@240", "moderate"), ("8@240", "moderate")),
}
PADS_NED_M = np.array([[0.0, 0.0, 0.0], [0.0, 5.0, 0.0], [-5.0, 0.0, 0.0], [-5.0, 5.0, 0.0]])
SETTLE_S = 10.0
UP_M, AWAY_M = 6.0, 60.0


def measure(name: str, wind: str, gusts: str, seconds: float, seed: int) -> dict[str, float]:
    """Distances of all vehicles from the reference, standing and flying, in m."""
    preset, scenario = PRESETS[name], load_scenario(ROOT / "missions" / SCENARIO_OF[name])
    motion = MotionLimits.of(preset.quadrotor, scenario.limits)
    airframes = Airframes(
        Craft(preset.quadrotor, preset.limits),
        lambda north, east: np.zeros_like(north),
        PADS_NED_M,
        np.zeros(len(PADS_NED_M)),
        RTK,
        seed=seed,
        wind=parse_wind(wind, gusts),
    )
    places = [np.append(pad, 0.0) for pad in PADS_NED_M]
    pieces = [hold(0.0, place) for place in places]
    _follow(airframes, pieces, 4.0)
    pieces = _go(airframes, pieces, (0.0, 0.0, -UP_M), motion)
    _follow(airframes, pieces, max(piece.end_s for piece in pieces) - airframes.t_s + SETTLE_S)
    standing = _follow(airframes, pieces, seconds)
    flying = []
    for north_m in (AWAY_M, -AWAY_M):
        pieces = _go(airframes, pieces, (north_m, 0.0, 0.0), motion)
        flying.append(_follow(airframes, pieces, max(piece.end_s for piece in pieces) - airframes.t_s))
    found = {}
    for where, off_m in (("hover", standing), ("on the way", np.concatenate(flying))):
        found[f"{where}, RMS"] = float(np.sqrt(np.mean(off_m**2)))
        found[f"{where}, most"] = float(off_m.max())
    return found


def _go(
    airframes: Airframes, pieces: list[Piece], step: tuple[float, float, float], motion: MotionLimits
) -> list[Piece]:
    """From where the pieces end, by so much."""
    now_s, after = airframes.t_s, []
    for piece in pieces:
        flat = np.zeros((DERIVATIVES, 4))
        flat[0] = piece.at(min(piece.end_s, now_s))[0]
        after.append(transfer(now_s, flat, flat[0] + np.append(step, 0.0), motion))
    return after


def _follow(airframes: Airframes, pieces: list[Piece], seconds: float) -> NDArray[np.float64]:
    """Distances (steps, V) from what the pieces want."""
    off, end_s = [], airframes.t_s + seconds
    batch, on = PieceBatch(pieces), np.ones(len(pieces), dtype=bool)
    while airframes.t_s < end_s - 0.5 * CONTROL_PERIOD_S:
        for row, piece in enumerate(pieces):
            if airframes.t_s >= piece.end_s:
                pieces[row] = hold(piece.end_s, piece.at(piece.end_s))
                batch.put(row, pieces[row])
        reference = batch.reference(airframes.t_s)
        airframes.step(reference, on)
        off.append(np.linalg.norm(airframes.truth[:, :3] - batch.reference(airframes.t_s)[:, 0, :3], axis=1))
    return np.array(off)


def main() -> None:
    """Measure and print."""
    asked = options(__doc__, seconds=60.0, seed=1)
    rows = [
        {"preset": name, "wind": wind or "none", "gusts": gusts or "none"}
        | measure(name, wind, gusts, asked.seconds, asked.seed)
        for name, winds in WINDS.items()
        for wind, gusts in winds
    ]
    show("distance from the reference, m", rows)


if __name__ == "__main__":
    main()
