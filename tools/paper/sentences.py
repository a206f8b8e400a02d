"""The paper's sentences (`sentences.md`), each with the function that measures it and says whether it holds.

W speaks of the four flights of Figs. 6 and 7 by their weights Q; A of Simulation 1; B of both simulations; C of PSO.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gcs.scenario.environment.terrain import ground_height_m
from gcs.types import Array
from tools.paper.track import STEP_S, Track, turns

Found = tuple[Any, ...]  # does it hold, and the numbers of `measured` in its order
SETTLED_S, LATE_S, CREEP_S = 20.0, 10.0, 3.0  # before the arrival; in the last seconds it creeps into its stop
ASKED_DEG, TOWARDS_DEG, MOVING_MPS = 90.0, 10.0, 0.5  # slower, a radius means little
JUMP_S = 0.1  # a jump of a control is what it does in a tenth of a second


@dataclass(frozen=True)
class Sentence:
    """A row of the table: `measured` is a format of the numbers found, `read` the sense in which it is judged."""

    id: str
    place: str
    figures: str
    says: str
    read: str
    measured: str
    why: str

    def verdict(self, found: list[Any]) -> str:
        """The verdict on what was found."""
        return ("confirmed as read" if self.read else "confirmed") if found[0] else "**not confirmed**"

    def row(self, found: list[Any], decided_by: str) -> str:
        """The row of the page."""
        says = f"{self.place}: {self.says}" + (f"<br>*read as:* {self.read}" if self.read else "")
        measured = self.measured.format(*found[1:])
        return f"| {self.id} | {says} | {measured} | {self.verdict(found)} | {self.why} | {decided_by} |"


HEAD = "| | the paper says | measured | | why | unstated values that decide it |\n| --- | --- | --- | --- | --- | --- |"
_ROWS = Path(__file__).with_name("sentences.md").read_text(encoding="utf-8").split("| --- |\n")[1].splitlines()
TABLE = {s.id: s for s in (Sentence(*(cell.strip() for cell in row.strip("|").split("|"))) for row in _ROWS)}


def judge(group: str, *of: Any) -> dict[str, list[Any]]:
    """Every sentence of a group on these flights: whether it holds, and the numbers measured."""
    found = {name: judged(*of) for name, judged in JUDGES.items() if name[0] == group}
    return {name: [bool(holds), *map(float, numbers)] for name, (holds, *numbers) in found.items()}


def _off_deg(t: Track) -> float:
    """How far the course is off the one asked for, late in the flight."""
    return float(np.abs(t.course_deg[t.last(LATE_S, CREEP_S)] - ASKED_DEG).max())


def _late_m(*tracks: Track) -> list[float]:
    return [t.at_to_go(t.height_m, LATE_S) for t in tracks]


def _descent_s(*tracks: Track) -> list[float]:
    """From the last instant at nine tenths of its height to the arrival."""
    return [t.end_s - t.t_s[t.height_m >= 0.9 * t.height_m.max()].max() for t in tracks]


def _shake(t: Track) -> float:
    return float(np.sqrt(np.mean(t.acceleration_ned_mps2[t.last(60.0), 2] ** 2)))


def _nearest_mountain(t: Track) -> Found:
    summits = np.column_stack([t.terrain.mountains.north_m, t.terrain.mountains.east_m])
    nearest = summits[np.argmin(np.linalg.norm(summits - t.states[0, :2], axis=1))]
    summit_m, ceiling_m = float(ground_height_m(t.terrain, *nearest[:, None])[0]), t.limits.height_m[1]
    passed_m = np.linalg.norm(t.states[:, :2] - nearest, axis=1).min()
    return summit_m + t.limits.clearance_min_m < ceiling_m, summit_m, ceiling_m, passed_m


def _room(t: Track) -> Found:
    own, others = t.clearance_m[t.plan.leader].min(), np.delete(t.clearance_m, t.plan.leader, axis=0).min()
    return own > others, own, others


def _turn(t: Track) -> Found:
    load, limit, v = t.load_factor.max(), t.limits.load_factor_max, np.hypot(*t.v_cruise[:, :2].T)
    normal = np.maximum(t.load_factor[t.cruise] * t.plan.quadrotor.gravity_mps2, 1e-12)
    return load <= 1.001 * limit, (v**2 / normal)[v > MOVING_MPS].min(), load, limit


def _climb_by_pitch(t: Track) -> Found:
    pitch, climb = t.pitch_deg[t.cruise], -t.v_cruise[:, 2]
    fastest, mean = pitch[np.argmax(climb)], pitch.mean()
    return abs(fastest - mean) < 2.0, np.corrcoef(pitch, climb)[0, 1], fastest, mean


def _jumps(t: Track) -> Found:
    every, (low, high) = round(JUMP_S / STEP_S), t.limits.thrust_N
    jump = 100.0 * np.abs(t.controls[every:] - t.controls[:-every]).max(axis=0) / [high - low, *(2.0 * t.torque)]
    return jump.max() < 20.0, *jump


def _typical(t: Track) -> Array:
    """U2, U3 and U4 between the ends, RMS (3,)."""
    return np.asarray(np.sqrt((t.u_cruise[:, 1:] ** 2).mean(axis=0)))


def _small(t: Track, axis: int) -> Found:
    typical = 100.0 * (_typical(t) / t.torque)[axis]
    return typical < 5.0, typical, 100.0 * np.abs(t.controls[:, 1 + axis]).max() / t.torque[axis]


def _moments(t: Track) -> Found:
    arm_m, (u2, u3, u4) = t.plan.quadrotor.arm_m, 100.0 * _typical(t) / t.torque
    m2, m3, m4 = 1e6 * _typical(t) * [arm_m, arm_m, 1.0]
    return m4 > max(m2, m3), m4, m2, m3, u4, u2, u3


def _lands(t: Track) -> Found:
    late = t.last(60.0)
    at_s, height_m, sinks = t.t_s[late], t.height_m[late], t.velocity_ned_mps[late, 2]
    slowly_s = at_s[np.argmax(sinks)] - at_s[sinks > sinks[0] + 0.02][0]
    holds = sinks.max() - sinks[0] > 0.5 and slowly_s > 5.0 and abs(sinks[-1]) < 1e-3
    return holds, sinks[0], sinks.max(), slowly_s, abs(sinks[-1]), height_m.max() - height_m[0]


def _round(_: Track, two: Track) -> Found:
    start, end = two.plan.scenario.start.position_m[:2], two.plan.scenario.end.position_m[:2]
    across = ground_height_m(two.terrain, *np.linspace(start, end, 3001).T).max()
    ceiling, passed = two.limits.height_m[1], two.ground_m.max()
    return across > ceiling > passed, across, ceiling, two.aside_m(), passed


def _less(measure: Callable[[Track], Any]) -> Callable[[Track, Track], Found]:
    """Simulation 2 against Simulation 1."""
    return lambda one, two: ((b := measure(two)) < (a := measure(one)), b, a)


def _towards(_: Track, two: Track) -> Found:
    goal = two.states[-1, :2] - two.states[two.last(30.0), :2][0]
    off = abs(two.at_to_go(two.course_deg, 30.0) - np.degrees(np.arctan2(goal[1], goal[0])))
    return off < TOWARDS_DEG, off, TOWARDS_DEG


def _bigger(*tracks: Track) -> Found:
    one, two = (t.u_cruise[:, 1:].std(axis=0) for t in tracks)
    more = 100.0 * (two - one) / tracks[0].torque
    return more.min() > 0.0 and more.max() < 2.0, *more, *(two / one)


JUDGES: dict[str, Callable[..., Found]] = {
    "W1": lambda *q: (max(bends := [t.aside_m(t.last(SETTLED_S)) for t in q]) < 3.0, *bends),
    "W2": lambda *q: ((off := max(abs(t.yaw_deg[-1] - ASKED_DEG) for t in q)) < 0.1, off, *map(_off_deg, q)),
    "W3": lambda c, s, x, i: ((h := _late_m(c, s, x))[0] < min(h[1:]) - 1.5, *h),
    "W4": lambda c, s, x, i: (min((h := _late_m(s, i, x))[:2]) > h[2], *h),
    "W5": lambda c, s, x, i: (min((d := _descent_s(s, i, x))[:2]) > d[2], *d),
    "W6": lambda c, s, x, i: ((h := [t.height_m.max() for t in (x, s, i)])[0] < min(h[1:]), *h),
    "W7": lambda c, s, x, i: ((n := turns(x.velocity_ned_mps[x.last(60.0), 2])) <= 1, n, *map(_shake, (x, c, s, i))),
    "W8": lambda *q: (
        min(h := _late_m(*q)) > 5.0 and max(np.diff(t.height_m[t.last(SETTLED_S)]).max() for t in q) < 1e-3,
        *h,
        max(0.0, *(np.diff(t.height_m[t.last(SETTLED_S)]).max() for t in q)),
    ),
    "W9": lambda *q: ((lost := [t.at_to_go(t.height_m, 60.0) - _late_m(t)[0] for t in q])[0] > max(lost[1:]), *lost),
    "A1": lambda t: ((clearance := t.report.clearance_min_m) > 0.0, clearance),
    "A2": lambda t: ((r := t.report).ok, len(r.checks), len(r.failures), r.separation_min_m or np.nan),
    "A3": lambda t: ((error := t.report.terminal_error_m) < 1e-3, error, t.end_s),
    "A4": lambda t: ((bend := t.aside_m(t.last(SETTLED_S))) < 3.0, bend),
    "A5": lambda t: (
        (r := np.diff(h := t.height_m[t.last(15.0)]).max()) < 1e-6 and h.max() > 5.0,
        h.max(),
        max(0.0, r),
    ),
    "A6": _nearest_mountain,
    "A7": lambda t: ((change := np.abs((o := t.plan.offsets(t.t_s)) - o[:, :1]).max()) < 1e-9, change),
    "A8": lambda t: (t.level[1] > 0.5 * t.end_s, t.level[1], t.end_s, t.level[0]),
    "A9": lambda t: (t.longer > 1.05, 100.0 * (t.longer - 1.0), (v := t.speed_mps[t.cruise]).mean(), v.std()),
    "A10": lambda t: (
        (rate := np.degrees(np.abs(t.states[:, 11])).max()) <= 1.001 * (limit := t.limits.rates_degps[2]),
        *(rate, limit, np.abs(np.diff(t.yaw_deg)).max()),
    ),
    "A11": _turn,
    "A12": lambda t: (t.mountain_aside_m > 0.0, t.mountain_aside_m),
    "A13": _room,
    "A14": lambda t: (
        max(most := [np.ptp(angle[t.cruise]) for angle in (t.pitch_deg, t.roll_deg)]) < 10.0,
        *(*most, np.degrees(np.abs(t.states[:, 6:8]).max())),
    ),
    "A15": _climb_by_pitch,
    "A16": lambda t: ((r := np.abs(t.roll_deg[t.cruise]).max()) < 3.0, r, t.ground_m[t.plan.leader].max()),
    "A17": _jumps,
    "A18": lambda t: (
        (u := t.controls)[:, 0].min() > (most := np.abs(u[:, 1:]).max()),
        *(u[:, 0].mean(), t.plan.quadrotor.weight_N, most),
    ),
    "A19": lambda t: ((u := np.ptp(t.u_cruise[:, 0])) > 0.01, u, 100.0 * u / t.plan.quadrotor.weight_N),
    "A20": lambda t: ((s := _small(t, 0))[0], s[2], s[1]),
    "A21": lambda t: _small(t, 1),
    "A22": _moments,
    "A23": lambda t: ((s := np.sign((d := np.diff(t.height_m)) * t.states[:-1, 5])[np.abs(d) > 1e-3].max()) < 0.0, s),
    "A24": lambda t: ((most := np.abs(t.v_cruise[:, 2]).max()) > 0.1, t.v_cruise[:, 2].std(), most),
    "A25": lambda t: (min(v := t.v_cruise[:, :2].std(axis=0)) > 0.25, *v),
    "A26": _lands,
    "B1": _round,
    "B2": _less(lambda t: np.ptp(t.height_m[t.cruise])),
    "B3": _less(lambda t: t.height_m[t.cruise].mean()),
    "B4": lambda _, two: ((clearance := two.report.clearance_min_m) > 0.0, clearance),
    "B5": lambda _, two: (two.mountain_aside_m > 0.0, two.mountain_aside_m),
    "B6": lambda _, two: _room(two),
    "B7": lambda *both: ((span := [np.ptp(t.course_deg[t.cruise]) for t in both])[1] > 1.5 * span[0], *span[::-1]),
    "B8": _towards,
    "B9": lambda one, two: (
        (x := two.longer) > 1.05,
        100.0 * (x - 1.0),
        *(t.speed_mps[t.cruise].mean() for t in (two, one)),
    ),
    "B10": lambda _, two: _turn(two),
    "B11": lambda _, two: ((pitch := np.ptp(two.pitch_deg[two.cruise])) < 10.0, pitch),
    "B12": lambda *both: ((roll := [np.abs(t.roll_deg[t.cruise]).max() for t in both])[1] > roll[0], *roll[::-1]),
    "B13": _less(lambda t: t.v_cruise[:, 2].std()),
    "B14": lambda *both: (all(np.less(*(v := [t.v_cruise[:, :2].std(axis=0) for t in both]))), *v[1], *v[0]),
    "B15": lambda *both: (
        (n := [turns(t.u_cruise[:, 0]) for t in both])[1] > n[0],
        *(*n[::-1], *(t.u_cruise[:, 0].std() for t in both[::-1])),
    ),
    "B16": _less(lambda t: t.u_cruise[:, 0].mean()),
    "B17": _bigger,
    "B18": lambda _, two: (
        (r := two.report).ok,
        *(two.end_s, r.terminal_error_m, (-two.places_ned_m[..., 2]).max()),
        *(r.separation_min_m or np.nan, len(r.failures)),
    ),
    "C1": lambda ours, theirs, aside: (np.median(aside) < 50.0, min(aside), max(aside), np.median(aside)),
    "C2": lambda ours, theirs, _: (theirs["one_s"] < ours["six_s"], theirs["one_s"], ours["six_s"]),
    "C3": lambda ours, theirs, _: (theirs["six_s"] > ours["six_s"], theirs["six_s"], ours["six_s"]),
    "C4": lambda ours, theirs, _: (theirs["course_off_deg"] > 5.0, theirs["course_off_deg"]),
    "C5": lambda ours, theirs, _: (theirs["late_s"] > 1.0, theirs["late_s"], ours["late_s"]),
}
