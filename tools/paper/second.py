"""What §4.2 says of Simulation 2, much of it against Simulation 1, judged on ours.

Knows: the sentences and what measures them. Does not know: pictures.
"""

from __future__ import annotations

import numpy as np

from gcs.plan.verification.verify import Report
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.si import torque_limits
from tools.paper.claims import Claim
from tools.paper.track import Track, rms, turns

_TOWARDS_DEG = 10.0
_LITTLE = 2.0  # per cent of a control's limit


def claims(first: Track, second: Track, report: Report) -> list[Claim]:
    """In the order of the paper."""
    return [*_path(first, second, report), *_curves(first, second), *_remark(second, report)]


def _path(first: Track, second: Track, report: Report) -> list[Claim]:
    plan, scenario = second.plan, second.plan.scenario
    ends = np.linspace(scenario.start.position_m[:2], scenario.end.position_m[:2], 3001)
    across = ground_height_m(scenario.terrain, *ends.T)
    courses = [float(np.ptp(t.course_deg[t.cruise])) for t in (first, second)]
    goal = second.states[-1, :2] - second.states[second.last(30.0), :2][0]
    bearing = float(np.degrees(np.arctan2(goal[1], goal[0])))
    course = second.at_to_go(second.course_deg, 30.0)
    return [
        _claim(
            (15, 16),
            "under a ceiling below the mountains the formation has to go round them",
            "the straight line meets {ground:.0f} m of ground under a ceiling of {ceiling:g} m; the way is up to "
            "{aside:.0f} m aside, over at most {passed:.1f} m",
            {
                "ground": float(across.max()),
                "ceiling": scenario.limits.height_m[1],
                "aside": float(second.aside_m.max()),
                "passed": float(second.ground_m.max()),
            },
            bool(across.max() > scenario.limits.height_m[1] > second.ground_m.max()),
            "the straight way is closed",
        ),
        _claim(
            (15,),
            "it climbs and sinks less than in Simulation 1",
            "between the ends heights span {two:.1f} m against {one:.1f} m",
            {"one": float(np.ptp(first.height_m[first.cruise])), "two": float(np.ptp(second.height_m[second.cruise]))},
            bool(np.ptp(second.height_m[second.cruise]) < np.ptp(first.height_m[first.cruise])),
            "h_r lies above this ceiling and below that of Simulation 1",
        ),
        _claim(
            (15,),
            "it flies lower",
            "{two:.2f} m on average between the ends, against {one:.2f} m",
            {"one": float(first.height_m[first.cruise].mean()), "two": float(second.height_m[second.cruise].mean())},
            bool(second.height_m[second.cruise].mean() < first.height_m[first.cruise].mean()),
            "the ceiling decides here, h_r in Simulation 1",
        ),
        _claim(
            (15,),
            "and does not touch the ground",
            "verified clearance at least {clearance:.3f} m of any vehicle",
            {"clearance": report.clearance_min_m},
            report.clearance_min_m > 0.0,
            "Eq. 20 for every vehicle's own ground",
        ),
        _claim(
            (15, 16),
            "it passes beside the mountains without touching them",
            "{aside:.1f} m from the nearest ground as high as it flies",
            {"aside": second.mountain_aside_m},
            second.mountain_aside_m > 0.0,
            "clearance over ground that rises gently is distance from where it is as high",
        ),
        _claim(
            (15, 16),
            "the leader leaves room for the formation",
            "its own clearance is at least {own:.2f} m, that of the lowest follower {others:.2f} m",
            {
                "own": float(second.clearance_m[plan.leader].min()),
                "others": float(np.delete(second.clearance_m, plan.leader, axis=0).min()),
            },
            bool(second.clearance_m[plan.leader].min() > np.delete(second.clearance_m, plan.leader, axis=0).min()),
            "which of the six is nearest to the ground depends on the side on which the mountain is passed",
        ),
        _claim(
            (16,),
            "the heading changes between the obstacles, unlike in Simulation 1",
            "between the ends the course spans {two:.0f}° against {one:.0f}°",
            {"one": courses[0], "two": courses[1]},
            courses[1] > 1.5 * courses[0],
            "it has a mountain to pass",
        ),
        _claim(
            (16,),
            "and leads to the target in the end",
            "30 s before the arrival the course is {off:.1f}° off its bearing; {asked:g}° counts as towards",
            {"off": abs(course - bearing), "asked": _TOWARDS_DEG},
            abs(course - bearing) < _TOWARDS_DEG,
            "the heading term pulls the course a little aside, the boundary condition brings it there",
        ),
        _claim(
            (16,),
            "detours use up the time that is left",
            "the way is {longer:.2f} % longer than the straight line; cruising speed {speed:.2f} m/s, in Simulation 1 "
            "{before:.2f} m/s",
            {
                "longer": 100.0 * (second.length_m / second.straight_m - 1.0),
                "speed": float(second.speed_mps[second.cruise].mean()),
                "before": float(first.speed_mps[first.cruise].mean()),
            },
            second.length_m / second.straight_m > 1.05,
            "does not follow from the paper's equations, see A9",
        ),
        _claim(
            (16,),
            "the path is smooth, no turn too tight",
            "least radius {radius:.0f} m between the ends; load factor at most {load:.3f} of {limit:g}",
            {
                "radius": second.radius_min_m,
                "load": float(second.load_factor.max()),
                "limit": scenario.limits.load_factor_max,
            },
            bool(second.load_factor.max() <= scenario.limits.load_factor_max * 1.001),
            "Eqs. 18 and 25",
        ),
    ]


def _curves(first: Track, second: Track) -> list[Claim]:
    one, two = first.cruise, second.cruise
    pitch = float(np.ptp(second.pitch_deg[two]))
    roll = [float(np.abs(t.roll_deg[t.cruise]).max()) for t in (first, second)]
    v = [[rms(t.velocity_ned_mps[t.cruise, axis]) for axis in range(3)] for t in (first, second)]
    u = [[rms(t.controls[t.cruise, axis]) for axis in range(4)] for t in (first, second)]
    torque = torque_limits(first.plan.scenario.limits, first.plan.quadrotor.arm_m)
    more = [100.0 * (u[1][i] - u[0][i]) / torque[i - 1] for i in (1, 2, 3)]
    changes = [turns(t.controls[t.cruise, 0]) for t in (first, second)]
    mean = [float(first.controls[one, 0].mean()), float(second.controls[two, 0].mean())]
    return [
        _claim(
            (17,),
            "pitch changes little",
            "by {pitch:.1f}° between the ends; the start itself asks for -18°",
            {"pitch": pitch},
            pitch < 10.0,
            "as in Simulation 1",
        ),
        _claim(
            (17,),
            "roll is a little larger than in Simulation 1",
            "at most {two:.2f}° against {one:.2f}° between the ends",
            {"one": roll[0], "two": roll[1]},
            roll[1] > roll[0],
            "it turns to get round the mountain",
        ),
        _claim(
            (18,),
            "v_z changes less than in Simulation 1",
            "{two:.3f} m/s RMS against {one:.3f} m/s",
            {"one": v[0][2], "two": v[1][2]},
            v[1][2] < v[0][2],
            "the ceiling leaves less to climb and to sink",
        ),
        _claim(
            (18,),
            "v_x and v_y change more",
            "{x2:.3f} and {y2:.3f} m/s RMS against {x1:.3f} and {y1:.3f} m/s",
            {"x1": v[0][0], "y1": v[0][1], "x2": v[1][0], "y2": v[1][1]},
            v[1][0] > v[0][0] and v[1][1] > v[0][1],
            "it changes its course",
        ),
        _claim(
            (18, 19),
            "U1 changes often",
            "{two:.0f} turning points between the ends against {one:.0f}; {b:.4f} N RMS against {a:.4f} N",
            {"one": changes[0], "two": changes[1], "a": u[0][0], "b": u[1][0]},
            changes[1] > changes[0],
            "turns and saddles under the ceiling move it again and again",
        ),
        _claim(
            (19,),
            "U1 is smaller than in Simulation 1",
            "{two:.4f} N on average against {one:.4f} N",
            {"one": mean[0], "two": mean[1]},
            mean[1] < mean[0],
            "slower flight leans less",
        ),
        _claim(
            (20,),
            "U2, U3 and U4 are a little bit bigger",
            "by {d2:.2f}, {d3:.2f} and {d4:.2f} % of their limits, RMS between the ends: {r2:.1f}, {r3:.1f} and "
            "{r4:.1f} times those of Simulation 1",
            {f"r{i + 1}": u[1][i] / u[0][i] for i in (1, 2, 3)} | {f"d{i + 1}": more[i - 1] for i in (1, 2, 3)},
            bool(min(more) > 0.0 and max(more) < _LITTLE),
            "turns are rolled and yawed; in Simulation 1 there are nearly none",
            "a little beside the limits, not beside the values of Simulation 1",
        ),
    ]


def _remark(second: Track, report: Report) -> list[Claim]:
    return [
        _claim(
            (15, 16),
            "Remark 4: one plan for the leader brings all there smoothly, in time, below the ceiling, unharmed",
            "at {time:g} s with {error:.2g} m of error, at most {height:.2f} m high, separation {separation:.2f} m; "
            "{broken:.0f} checks broken",
            {
                "time": second.end_s,
                "error": report.terminal_error_m,
                "height": float((-second.places_ned_m[..., 2]).max()),
                "separation": report.separation_min_m or np.nan,
                "broken": len(report.failures),
            },
            report.ok,
            "verified vehicle by vehicle",
        )
    ]


def _claim(
    figures: tuple[int, ...], says: str, measured: str, numbers: dict[str, float], holds: bool, why: str, read: str = ""
) -> Claim:
    return Claim("§4.2", figures, says, measured, numbers, holds, why, read)
