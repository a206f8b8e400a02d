"""Two readings of Eq. 51's limits of U2 and U3: the same numbers as forces on the arm and as moments.

Knows: what is compared, and the picture over Figs. 10, 13, 17 and 20. Does not know: sentences.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import gcs
from gcs.physics.quadrotor import Array
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.si import torque_limits
from tools.bench_flights import fly_one
from tools.paper.drawing import save
from tools.paper.run import ROOT, Run
from tools.paper.track import ENDS_S, Track
from tools.paper.unstated import FORCES, MOMENTS, as_moments
from tools.pictures.scenery import colour

TITLE = "Two readings of the limits of U2 and U3 (Eq. 51)"
MISSIONS = ("simulation1", "simulation2")
SEEDS = 3  # flights in wind, of each simulation and reading
PICTURE = "readings.png"
_DRAWN_S = 15.0  # of each end; between the ends both readings do the same
_PANELS = ("pitch, deg", "roll, deg", "U2, N", "U3, N", "U4, N m")
ROWS = {
    "turn_radps2": ("roll and pitch accelerate by at most", "{:.2f} rad/s²"),
    "share_of_yaw": ("the same, of what U4 does to the yaw", "{:.1f} times"),
    "verified": ("verified", "{}"),
    "pitch_rate_degps": ("largest pitch rate (limit 10°/s)", "{:.1f}°/s"),
    "roll_deg": ("largest roll", "{:.1f}°"),
    "pitch_deg": ("largest pitch", "{:.1f}°"),
    "u2_share": ("U2, largest, of its limit", "{:.0f} %"),
    "u3_share": ("U3, largest, of its limit", "{:.0f} %"),
    "u2_cruise_N": ("U2 between the ends, RMS", "{:.6f} N"),
    "u3_cruise_N": ("U3 between the ends, RMS", "{:.6f} N"),
    "energy_J": ("energy of the leader, Eq. 32", "{:.1f} J"),
    "apart_m": ("leader's way apart from the other reading's, at most", "{:.2f} m"),
    "held": ("flights in wind that the judge accepts", "{}"),
    "rms_m": ("position RMS of these flights, worst vehicle, mean", "{:.3f} m"),
    "worst_m": ("position error at most", "{:.2f} m"),
}


def measure(run: Run) -> dict[str, Any]:
    """Both readings of both simulations: planned, verified, flown, drawn."""
    found: dict[str, Any] = {}
    tracks: dict[tuple[str, str], Track] = {}
    for name in MISSIONS:
        scenario = gcs.load_scenario(ROOT / "missions" / name)
        run.log(f"plan {name}, U2 and U3 as moments")
        for reading, plan in {FORCES: run.plan(name), MOMENTS: gcs.make_plan(as_moments(scenario))}.items():
            tracks[name, reading] = Track(plan)
            found[f"{name}, {reading}"] = _figures(tracks[name, reading]) | _flown(run, plan)
        apart = tracks[name, MOMENTS].states[:, :3] - tracks[name, FORCES].states[:, :3]
        apart_m = float(np.linalg.norm(apart, axis=1).max())
        for reading in (FORCES, MOMENTS):
            found[f"{name}, {reading}"]["apart_m"] = apart_m
    save(_drawn(tracks), run, PICTURE)
    return {"columns": found}


def page(record: dict[str, Any]) -> list[str]:
    """Why one was chosen, the table, the picture."""
    columns = record["columns"]
    lines = [
        "Eq. 51 prints the limits of U2 and U3 in N m. Eqs. 1 and 2 make U2 and U3 forces: Eq. 2 sums thrusts without "
        "an arm, and Eq. 1 multiplies them by the arm l = 0.075 m. As moments the same numbers are 13 times wider. The "
        "scenarios read them as forces (`roll_pitch_force_N`): a plan within these limits also keeps the other, "
        "and the reverse is false. For the other reading: the unit as printed, and a vehicle that rolls more quickly "
        "than it yaws, as real ones do. `roll_pitch_moment_Nm` gives it.",
        "",
        f"| | {' | '.join(columns)} |",
        "| --- |" + " ---: |" * len(columns),
    ]
    for key, (text, shown) in ROWS.items():
        cells = ["not flown" if column[key] is None else shown.format(column[key]) for column in columns.values()]
        lines.append(f"| {text} | {' | '.join(cells)} |")
    return [
        *lines,
        "",
        "The wider limits let the vehicle turn quickly at the ends, until the rates of Eq. 51 bind instead; pitch and "
        "roll differ most there. Between the ends U2 and U3 are a small share of their limits in both readings, but "
        "they are not equal, and the ways differ as the table says. Flights in wind are too few for more than an order "
        "of size. The last columns of the tables above name the sentences whose verdict depends on the reading. "
        "The ends of Figs. 10, 13, 17 and 20:",
        "",
        f"![Figs. 10, 13, 17 and 20 at their ends, in both readings](paper/{PICTURE})",
    ]


def _figures(track: Track) -> dict[str, Any]:
    plan = track.plan
    vehicle, limits = plan.quadrotor, plan.scenario.limits
    most = np.array(torque_limits(limits, vehicle.arm_m))
    turn = vehicle.arm_m * most[0] / vehicle.inertia_kgm2[0]
    share = 100.0 * np.abs(track.controls[:, 1:]).max(axis=0) / most
    cruise = np.sqrt((track.controls[track.cruise, 1:] ** 2).mean(axis=0))
    return {
        "turn_radps2": turn,
        "share_of_yaw": turn / (most[2] / vehicle.inertia_kgm2[2]),
        "verified": "yes" if gcs.verify(plan).ok else "no",
        "pitch_rate_degps": float(np.degrees(np.abs(track.states[:, 10]).max())),
        "roll_deg": float(np.abs(track.roll_deg).max()),
        "pitch_deg": float(np.abs(track.pitch_deg).max()),
        "u2_share": float(share[0]),
        "u3_share": float(share[1]),
        "u2_cruise_N": float(cruise[0]),
        "u3_cruise_N": float(cruise[1]),
        "energy_J": track.energy_J,
    }


def _flown(run: Run, plan: Plan) -> dict[str, Any]:
    """Flights by setpoints in the wind of the page's other flights."""
    if run.short:
        return {"held": None, "rms_m": None, "worst_m": None}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "plan.skein"
        gcs.save_plan(plan, gcs.verify(plan), file)
        flights = []
        for seed in range(SEEDS):
            run.log(f"fly {plan.scenario.name}, seed {seed}")
            flights.append(fly_one(file, "stream", seed, Path(folder) / f"{seed}"))
    done = [flight for flight in flights if "ended" not in flight]
    return {
        "held": f"{sum(flight['held'] for flight in done)} of {len(flights)}",
        "rms_m": float(np.mean([flight["rms_m"] for flight in done])) if done else None,
        "worst_m": max(flight["worst_m"] for flight in done) if done else None,
    }


def _drawn(tracks: dict[tuple[str, str], Track]) -> Figure:
    figure = Figure(figsize=(11.0, 9.0), layout="constrained")
    panels = figure.subplots(len(_PANELS), 4, sharey="row")
    assert _DRAWN_S <= ENDS_S
    for (name, reading), track in tracks.items():
        left = 2 * MISSIONS.index(name)
        from_end_s = track.t_s - track.end_s
        for column, at_s, part in (
            (left, track.t_s, track.t_s <= _DRAWN_S),
            (left + 1, from_end_s, from_end_s >= -_DRAWN_S),
        ):
            for row, values in enumerate(_values(track)):
                axes, hue = panels[row, column], colour(int(reading == MOMENTS))
                axes.plot(at_s[part], values[part], color=hue, lw=1.4, label=reading)
                axes.grid(alpha=0.3)
            panels[0, column].set_title(f"{name}, {'first' if column == left else 'last'} {_DRAWN_S:g} s", fontsize=9)
            panels[-1, column].set_xlabel("time, s" if column == left else "time to the arrival, s")
    for row, name in enumerate(_PANELS):
        panels[row, 0].set_ylabel(name)
    panels[0, 0].legend(fontsize=8)
    return figure


def _values(track: Track) -> tuple[Array, ...]:
    return (track.pitch_deg, track.roll_deg, *track.controls[:, 1:].T)
