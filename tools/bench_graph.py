"""Topologies of the information graph in a closed loop: what a push of one vehicle does to the shape.

./tools/run python -m tools.bench_graph [--topology leader chain tree voronoi] [--delays 0.05 0.5] [--losses 0 0.2 0.4]
    [--json FILE] [--picture FILE]

Six vehicles of `field` follow in virtual time: the station's code, and vehicles that answer as a second-order system
with a delay (the loop of tests/unit/flight/execution). Reports are late by the delay, and lost with the chance named.
The leader is pushed 3 m off, later held up 3 m behind for 12 s; in another run vehicle 2 is pushed, to which others
listen. The formation error is that of Definition 1: RMS over the 30 s from then on, at most, and how long until it
stays below 0.3 m. The gain is the largest of all followers: RMS deviation from the plan over that of whom it listens
to, in the 30 s after the push of the leader.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import gcs
from gcs.plan.trajectory.plan import Plan
from gcs.types import Array
from tests.unit.flight.execution.closed_loop import Followed, Link, follow
from tools.bench.frame import ROOT, finish, options

T_S = np.arange(0.0, 75.0, 0.1)
PUSHED_S, HELD_S, AFTER_S = 5.0, 40.0, 30.0
OFF_M, SETTLED_M = 3.0, 0.3
FOLLOWER = 0  # vehicle 2: the first after the leader in every topology


def bump(at_s: float, rise_s: float, stay_s: float) -> Array:
    """A deviation to the north (N, 6) that rises, stays and fades again, with its rate."""
    off = np.zeros((len(T_S), 6))
    up, down = ((T_S - at_s - begin_s) / rise_s for begin_s in (0.0, rise_s + stay_s))
    off[:, 0] = OFF_M * (_smooth(up) - _smooth(down))
    off[:, 3] = np.gradient(off[:, 0], T_S)
    return off


def _smooth(s: Array) -> Array:
    s = np.clip(s, 0.0, 1.0)
    return s * s * (3.0 - 2.0 * s)


def listening(plan: Plan, topology: str) -> Plan:
    """The plan with this topology."""
    formation = plan.scenario.formation.model_copy(update={"topology": topology})
    return replace(plan, scenario=plan.scenario.model_copy(update={"formation": formation}))


def error_m(flown: Followed) -> Array:
    """The formation error (N,) by Definition 1."""
    everybody = np.concatenate([flown.leader_m[None], flown.followers_m])
    return np.asarray(np.linalg.norm(everybody - everybody.mean(axis=0), axis=-1).max(axis=0))


def measure(plan: Plan, link: Link) -> tuple[dict[str, float], Array, Array]:
    """The figures of a topology on a link, and times and formation errors (N,) of the run with the leader's."""
    still = np.zeros((len(plan.sysids) - 1, len(T_S), 6))
    pushed = still.copy()
    pushed[FOLLOWER] = bump(PUSHED_S, 2.0, 0.0)
    led = follow(plan, T_S, bump(PUSHED_S, 2.0, 0.0) + bump(HELD_S, 3.0, 12.0), still, link=link)
    short = T_S < PUSHED_S + AFTER_S + 1.0
    alone = follow(plan, T_S[short], np.zeros((int(short.sum()), 6)), pushed[:, short], link=link)
    found: dict[str, float] = {}
    for name, flown, at_s in (("pushed", led, PUSHED_S), ("held", led, HELD_S), ("follower", alone, PUSHED_S)):
        after = (flown.t_s >= at_s) & (flown.t_s < at_s + AFTER_S)
        error = error_m(flown)[after]
        found[f"{name} rms_m"], found[f"{name} most_m"] = float(np.sqrt((error**2).mean())), float(error.max())
        found[f"{name} settles_s"] = float(flown.t_s[after][np.flatnonzero(error > SETTLED_M)[-1]] - at_s)
    after = led.t_s < PUSHED_S + AFTER_S
    off = np.concatenate([led.leader_m[None], led.followers_m])[:, after]
    heard = np.einsum("ij,jnk->ink", plan.information_graph(0.0).weights, off)
    sizes = [np.sqrt((one**2).sum(axis=-1).mean(axis=-1)) for one in (off, heard)]
    return found | {"gain": float((sizes[0] / sizes[1])[1:].max())}, led.t_s, error_m(led)


def runs(asked: Any) -> Iterator[tuple[dict[str, Any], Array, Array]]:
    """All measurements, each when it is done."""
    plan = gcs.make_plan(gcs.load_scenario(ROOT / "missions" / "field"))
    for delay_s in asked.delays:
        for loss in asked.losses:
            for topology in asked.topology:
                found, t_s, error = measure(listening(plan, topology), Link(delay_s, loss=loss))
                yield {"topology": topology, "delay_s": delay_s, "loss": loss} | found, t_s, error
                print(f"{topology}, {delay_s:g} s, {loss:.0%}: {found}", flush=True)


def draw(curves: list[tuple[dict[str, Any], Array, Array]], file: Path) -> None:
    """The formation error over time, a panel for each link."""
    links = list(dict.fromkeys((row["delay_s"], row["loss"]) for row, _, _ in curves))
    figure = Figure(figsize=(8.0, 1.0 + 2.2 * len(links)), layout="constrained")
    panels = figure.subplots(len(links), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for panel, link in zip(panels, links, strict=True):
        for row, t_s, error in curves:
            if (row["delay_s"], row["loss"]) == link:
                style = ":" if row["topology"] == "voronoi" else "-"  # it may hide the tree's
                panel.plot(t_s, error, style, label=row["topology"], lw=1.6)
        panel.set(title=f"reports {link[0]:g} s old, {link[1]:.0%} lost", ylabel="formation error, m")
        panel.grid(alpha=0.25)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=len(curves))
    panels[-1].set(xlabel="time, s: the leader is pushed at 5 s, held up from 40 s on")
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110)


def main() -> None:
    """Measure what was asked for."""
    asked = options(
        __doc__,
        topology=["leader", "chain", "tree", "voronoi"],
        delays=[0.05, 0.5],
        losses=[0.0, 0.2, 0.4],
        json=None,
        picture=None,
    )
    curves = list(runs(asked))
    if asked.picture is not None:
        first, last = (asked.delays[0], asked.losses[0]), (asked.delays[-1], asked.losses[-1])
        draw([curve for curve in curves if (curve[0]["delay_s"], curve[0]["loss"]) in (first, last)], asked.picture)
    finish("formation error after a push of one vehicle", [row for row, _, _ in curves], asked.json)


if __name__ == "__main__":
    main()
