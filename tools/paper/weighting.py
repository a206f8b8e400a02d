"""Figs. 6 and 7 (§2.5.3): four weights ask for a straight way in from a height.

Knows: the study's four flights and the paper's sentences on them. Does not know: formations.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

import gcs
from gcs.plan.trajectory.plan import Plan
from tools.paper import unstated
from tools.paper.claims import Claim, beside, kept, table
from tools.paper.drawing import save
from tools.paper.run import ROOT, Run
from tools.paper.track import SETTLED_S, STEP_S, Track, turns
from tools.pictures.scenery import colour

TITLE = "Terminal weighting (§2.5.3, Figs. 6 and 7)"
FLIGHTS = {"1": "constant", "t²": "squared", "1/(tf-t+0.5)": "scenario", "1/(tf-t+0.5)²": "inverse_square"}
MISSIONS = {q: f"terminal_weighting/{name}.toml" for q, name in FLIGHTS.items()}
CONSTANT, SQUARED, CHOSEN, INVERSE = FLIGHTS
_ASKED_DEG = 90.0
_CREEPING_MPS = 1.0
HEADING_SCALE = next(value for value in unstated.VALUES if value.key == "heading_scale_deg")
SCALES_DEG = (5.0, 10.0, 30.0)  # and the one of the scenarios
_LATE_S, _CREEP_S = 10.0, 3.0  # the last seconds before it creeps into its stop


def measure(run: Run) -> dict[str, Any]:
    """Plan the four, draw them, judge the sentences."""
    tracks = {q: Track(run.plan(mission)) for q, mission in MISSIONS.items()}
    bent = {scale: _with_scale(run, scale) for scale in SCALES_DEG[: 1 if run.short else None]}
    save(_from_above(tracks, bent[SCALES_DEG[0]]), run, "fig06.png")
    save(_heights(tracks), run, "fig07.png")
    own_deg = run.plan(MISSIONS[CHOSEN]).scenario.objective.heading_scale_deg
    return {
        "claims": kept(claims(tracks), "W"),
        "varied": unstated.vary(run, [*MISSIONS.values()], judged),
        "courses": [
            {
                "scale_deg": scale,
                "off_deg": [_off_deg(t) for t in those.values()],
                "creeps_s": _creeps_s(run, None if scale == own_deg else scale),
            }
            for scale, those in [*bent.items(), (own_deg, tracks)]
        ],
    }


def _with_scale(run: Run, scale_deg: float) -> dict[str, Track]:
    """The four flights with another heading scale."""
    run.log(f"heading scale {scale_deg:g}°")
    changed = {q: gcs.load_scenario(ROOT / "missions" / mission) for q, mission in MISSIONS.items()}
    return {q: Track(gcs.make_plan(unstated.with_value(s, HEADING_SCALE, scale_deg))) for q, s in changed.items()}


def _creeps_s(run: Run, scale_deg: float | None) -> float:
    """How long Simulation 2 is slow between its ends, with its own heading scale or another."""
    plan = run.plan("simulation2")
    if scale_deg is not None:
        plan = gcs.make_plan(unstated.with_value(plan.scenario, HEADING_SCALE, scale_deg))
    track = Track(plan)
    return STEP_S * float(np.count_nonzero(track.speed_mps[track.cruise] < _CREEPING_MPS))


def _off_deg(track: Track) -> float:
    """How far the course is off the one asked for, late in the flight."""
    return float(np.abs(track.course_deg[track.last(_LATE_S, _CREEP_S)] - _ASKED_DEG).max())


def judged(plans: dict[str, Plan]) -> list[Claim]:
    """The sentences on other plans of the four flights."""
    return claims({q: Track(plans[mission]) for q, mission in MISSIONS.items()})


def page(record: dict[str, Any]) -> list[str]:
    """Figures beside the sentences, and the table."""
    found = record["claims"]
    return [
        *beside("paper/fig06.png", 6, "one vehicle from above, by the weight Q", found),
        *beside("paper/fig07.png", 7, "the same in 3D, and its height before the arrival", found),
        *table(found, [unstated.column(record["varied"], number) for number in range(len(found))]),
        "",
        "The smaller the heading scale, the more a wrong heading costs. All studies share one scale. The sentences "
        "hardly decide it: the last columns of the tables name the few that change. The largest of these values was "
        "chosen, against this study: from no Q does it bend the path into the course asked for. The smallest does for "
        "two of them, but lets Simulation 2 creep before its end. The table has the course off from 10 s to 3 s before "
        f"the arrival, and how long Simulation 2 is slower than {_CREEPING_MPS:g} m/s between its ends.",
        "",
        f"| heading scale | {' | '.join(f'Q = {q}' for q in FLIGHTS)} | Simulation 2 creeps |",
        "| ---: |" + " ---: |" * (len(FLIGHTS) + 1),
        *(
            f"| {row['scale_deg']:g}° | {' | '.join(f'{off:.0f}°' for off in row['off_deg'])} "
            f"| {row['creeps_s']:.0f} s |"
            for row in record["courses"]
        ),
    ]


def claims(tracks: dict[str, Track]) -> list[Claim]:
    """Every sentence that can be tested."""
    bends = {_key(q): t.bend_m(SETTLED_S) for q, t in tracks.items()}
    off = {_key(q): _off_deg(t) for q, t in tracks.items()}
    lost = {_key(q): t.at_to_go(t.height_m, 60.0) - t.at_to_go(t.height_m, _LATE_S) for q, t in tracks.items()}
    high = {_key(q): t.at_to_go(t.height_m, _LATE_S) for q, t in tracks.items()}
    most = {_key(q): float(t.height_m.max()) for q, t in tracks.items()}
    descent = {_key(q): _descent_s(t) for q, t in tracks.items()}
    shake = {_key(q): float(np.sqrt(np.mean(t.acceleration_ned_mps2[t.last(60.0), 2] ** 2))) for q, t in tracks.items()}
    turned = turns(tracks[CHOSEN].velocity_ned_mps[tracks[CHOSEN].last(60.0), 2])
    rises = {_key(q): float(np.diff(t.height_m[t.last(SETTLED_S)]).max()) for q, t in tracks.items()}
    return [
        _claim(
            (6,),
            "all four weights end in a straight stretch",
            "the last 20 s bend by at most {constant:.1f}, {squared:.1f}, {chosen:.1f}, {inverse:.1f} m",
            bends,
            max(bends.values()) < 3.0,
            "every flight settles on one line before it brakes",
        ),
        _claim(
            (6,),
            "the end requires it to fly from the 90° direction to the target",
            "yaw at the arrival off by at most {yaw:.1g}°; from 10 s to 3 s before it the course is off by up to "
            "{constant:.0f}°, {squared:.0f}°, {chosen:.0f}°, {inverse:.0f}°",
            off | {"yaw": max(abs(float(t.yaw_deg[-1]) - _ASKED_DEG) for t in tracks.values())},
            max(abs(float(t.yaw_deg[-1]) - _ASKED_DEG) for t in tracks.values()) < 0.1,
            "Eq. 16 sets the yaw. Whether the course follows depends on the heading scale, see below; with Q = 1 it "
            "never does, because constant velocity is then best (Jensen)",
            "the direction is ψ of Eqs. 16 and 33 at the arrival, which is a constraint; not the course",
        ),
        _claim(
            (7,),
            "Q = 1 changes its height much late in the flight and cannot be relied on to come from above",
            "10 s before the arrival at {constant:.1f} m; t² at {squared:.1f}, 1/(tf-t+0.5) at {chosen:.1f} m",
            high,
            high["constant"] < min(high["squared"], high["chosen"]) - 1.5,
            "it gives its height up earlier than the weights that still grow",
        ),
        _claim(
            (7,),
            "t² and 1/(tf-t+0.5)² are higher than 1/(tf-t+0.5)",
            "10 s before the arrival {squared:.1f} and {inverse:.1f} m against {chosen:.1f} m",
            high,
            min(high["squared"], high["inverse"]) > high["chosen"],
            "with each Q divided by its mean, none is as large as 1/(tf-t+0.5) in the seconds that decide",
        ),
        _claim(
            (7,),
            "t² and 1/(tf-t+0.5)² take longer to come down than 1/(tf-t+0.5)",
            "from nine tenths of their height {squared:.1f} and {inverse:.1f} s against {chosen:.1f} s",
            descent,
            min(descent["squared"], descent["inverse"]) > descent["chosen"],
            "one weighs the last seconds too little to keep the height, the other never asks for all of it",
        ),
        _claim(
            (7,),
            "1/(tf-t+0.5) does not climb so high",
            "highest {chosen:.1f} m; t² {squared:.1f} m, 1/(tf-t+0.5)² {inverse:.1f} m",
            most,
            most["chosen"] < min(most["squared"], most["inverse"]),
            "the inverse square spends all of its weight at the very end and never climbs",
        ),
        _claim(
            (7,),
            "with 1/(tf-t+0.5) the height varies smoothly",
            "v_z turns {turned:.0f} time in the last minute; vertical acceleration {chosen:.3f} m/s² RMS; Q = 1 "
            "{constant:.3f}, t² {squared:.3f}, 1/(tf-t+0.5)² {inverse:.3f}",
            shake | {"turned": turned},
            turned <= 1,
            "it sinks faster and then slower, once; of the four it is not the smoothest, because it stays high longest",
            "smooth, not smoothest: the descent speeds up once and slows down once",
        ),
        _claim(
            (7,),
            "Remark 2: all four come down gradually from a height",
            "heights 10 s before the arrival {constant:.1f}, {squared:.1f}, {chosen:.1f}, {inverse:.1f} m; none rises "
            "in the last 20 s by more than {rise:.4f} m from one twentieth of a second to the next",
            high | {"rise": max(0.0, *rises.values())},
            min(high.values()) > 5.0 and max(rises.values()) < 1e-3,
            "the height term asks for it, the end of Eq. 16 for the rest",
        ),
        _claim(
            (7,),
            "Q = 1 loses more height in the last minute than the others",
            "{constant:.1f} m until 10 s before the arrival; {squared:.1f}, {chosen:.1f}, {inverse:.1f} m the others",
            lost,
            lost["constant"] > max(lost["squared"], lost["chosen"], lost["inverse"]),
            "nothing tells it that late heights count more",
        ),
    ]


def _claim(
    figures: tuple[int, ...], says: str, measured: str, numbers: dict[str, float], holds: bool, why: str, read: str = ""
) -> Claim:
    return Claim("§2.5.3", figures, says, measured, numbers, holds, why, read)


def _key(q: str) -> str:
    return {CONSTANT: "constant", SQUARED: "squared", CHOSEN: "chosen", INVERSE: "inverse"}[q]


def _descent_s(track: Track) -> float:
    """From the last instant at nine tenths of its height to the arrival."""
    return float(track.end_s - track.t_s[track.height_m >= 0.9 * track.height_m.max()].max())


def _from_above(tracks: dict[str, Track], bent: dict[str, Track]) -> Figure:
    figure = Figure(figsize=(12.0, 4.4), layout="constrained")
    whole, end, other = figure.subplots(1, 3)
    for row, (q, track) in enumerate(tracks.items()):
        everything = track.t_s >= 0.0
        for axes, flown, part in (
            (whole, track, everything),
            (end, track, track.last(60.0)),
            (other, bent[q], everything),
        ):
            axes.plot(flown.states[part, 1], flown.states[part, 0], color=colour(row), lw=1.5, label=f"Q = {q}")
    titles = ("whole flight", "last 60 s", f"whole flight, heading scale {SCALES_DEG[0]:g}°")
    for axes, title in zip((whole, end, other), titles, strict=True):
        axes.set(xlabel="east, m", ylabel="north, m", title=title)
        axes.grid(alpha=0.3)
    whole.set_aspect("equal")
    other.set_aspect("equal")
    whole.legend(fontsize=8)
    return figure


def _heights(tracks: dict[str, Track]) -> Figure:
    figure = Figure(figsize=(9.0, 4.4), layout="constrained")
    above: Any = figure.add_subplot(1, 2, 1, projection="3d")
    profile = figure.add_subplot(1, 2, 2)
    for row, (q, track) in enumerate(tracks.items()):
        every = slice(None, None, 20)
        above.plot(
            track.states[every, 1], track.states[every, 0], track.height_m[every], color=colour(row), label=f"Q = {q}"
        )
        part = track.last(60.0)
        profile.plot(track.end_s - track.t_s[part], track.height_m[part], color=colour(row), label=f"Q = {q}")
    above.set(xlabel="east, m", ylabel="north, m", zlabel="height, m")
    above.set_box_aspect((1, 1, 0.6), zoom=0.85)
    profile.set(xlabel="time before the arrival, s", ylabel="height, m", xlim=(60.0, 0.0))
    profile.grid(alpha=0.3)
    profile.legend(fontsize=8)
    return figure
