"""What §4.1 says of Simulation 1, judged on ours.

Knows: the sentences and what measures them. Does not know: pictures.
"""

from __future__ import annotations

import numpy as np

from gcs.plan.verification.verify import Report
from gcs.scenario.environment.terrain import ground_height_m
from gcs.scenario.si import torque_limits
from tools.paper.claims import Claim
from tools.paper.track import SETTLED_S, Track, rms

_STEP = 0.1  # s: a jump of a control is what it does in a tenth of a second


def claims(track: Track, report: Report) -> list[Claim]:
    """In the order of the paper."""
    return [*_path(track, report), *_attitude(track), *_controls(track), *_velocities(track)]


def _path(track: Track, report: Report) -> list[Claim]:
    plan, scenario = track.plan, track.plan.scenario
    mountains = scenario.terrain.mountains
    summits = np.column_stack([mountains.north_m, mountains.east_m])
    nearest = int(np.argmin(np.linalg.norm(summits - track.states[0, :2], axis=1)))
    passed = np.linalg.norm(track.states[:, :2] - summits[nearest], axis=1)
    summit_m = float(ground_height_m(scenario.terrain, summits[nearest, :1], summits[nearest, 1:])[0])
    level_m, level_s = track.level
    descent = track.last(15.0)
    offsets = plan.offsets(track.t_s)
    yaw_rate = np.degrees(np.abs(track.states[:, 11]))
    return [
        _claim(
            (8, 9),
            "no vehicle touches an obstacle",
            "verified clearance at least {clearance:.3f} m, of any vehicle, over the exact ground",
            {"clearance": report.clearance_min_m},
            report.clearance_min_m > 0.0,
            "h_min is a constraint of every vehicle, at every instant",
        ),
        _claim(
            (8, 9),
            "all meet the constraints",
            "{checks:.0f} checks of the verifier, {broken:.0f} broken; separation at least {separation:.2f} m",
            {
                "checks": len(report.checks),
                "broken": len(report.failures),
                "separation": report.separation_min_m or np.nan,
            },
            report.ok,
            "every limit of Eq. 51 is a constraint of every vehicle",
        ),
        _claim(
            (8, 9),
            "they get from start to end; the end is met without any error, being a constraint",
            "{error:.2g} m off at {time:g} s",
            {"error": report.terminal_error_m, "time": track.end_s},
            report.terminal_error_m < 1e-3,
            "Eq. 16 is a bound of the program; what is left is the solver's tolerance",
        ),
        _claim(
            (8, 9),
            "towards the end they fly straight to the target",
            "the last 20 s bend by {bend:.2f} m, seen from above",
            {"bend": track.bend_m(SETTLED_S)},
            track.bend_m(SETTLED_S) < 3.0,
            "nothing stands in the way there",
        ),
        _claim(
            (8,),
            "and come down gradually from a height",
            "from {height:.1f} m, sinking all the last 15 s; {rise:.1g} m at most the other way",
            {
                "height": float(track.height_m[descent].max()),
                "rise": float(max(0.0, np.diff(track.height_m[descent]).max())),
            },
            bool(np.diff(track.height_m[descent]).max() < 1e-6 and track.height_m[descent].max() > 5.0),
            "Q grows until the end, and h_r is above it",
        ),
        _claim(
            (8, 9),
            "with this ceiling the obstacle nearest to the take-off can be flown over directly",
            "its summit is {summit:.0f} m high, the ceiling {ceiling:g} m; the way passes {distance:.0f} m beside it",
            {"summit": summit_m, "ceiling": scenario.limits.height_m[1], "distance": float(passed.min())},
            bool(summit_m + scenario.limits.clearance_min_m < scenario.limits.height_m[1]),
            "it could be; the straight way does not lead over it",
            "can be, not is",
        ),
        _claim(
            (8, 11),
            "the formation keeps its shape",
            "offsets change by at most {change:.1g} m",
            {"change": float(np.abs(offsets - offsets[:, :1]).max())},
            float(np.abs(offsets - offsets[:, :1]).max()) < 1e-9,
            "a rigid body has no other choice",
        ),
        _claim(
            (8,),
            "and then keeps a certain height",
            "{time:.0f} s of {whole:g} s within 1 m of {height:.1f} m, without a break",
            {"time": level_s, "whole": track.end_s, "height": level_m},
            bool(level_s > 0.5 * track.end_s),
            "h_r asks for it and climbing costs energy",
            "then: after the climb, until the descent",
        ),
        _claim(
            (8, 9),
            "with time to spare, it is used up by changes of direction and height",
            "the way is {longer:.2f} % longer than the straight line; cruising speed {speed:.2f} m/s within "
            "{spread:.2f} m/s RMS",
            {
                "longer": 100.0 * (track.length_m / track.straight_m - 1.0),
                "speed": float(track.speed_mps[track.cruise].mean()),
                "spread": rms(track.speed_mps[track.cruise]),
            },
            track.length_m / track.straight_m > 1.05,
            "does not follow from the paper's equations: t_f is given, and by Eq. 32 the energy is the integral of "
            "k_f v³. That is convex in v, so the shortest way at constant speed costs least; a detour must be flown "
            "faster. Here, as in A25 and B9, time is used up by flying slower",
        ),
        _claim(
            (9,),
            "the heading changes smoothly",
            "yaw rate at most {rate:.2f} deg/s of {limit:g}; between two samples at most {step:.3f}°",
            {
                "rate": float(yaw_rate.max()),
                "limit": scenario.limits.rates_degps[2],
                "step": float(np.abs(np.diff(track.yaw_deg)).max()),
            },
            float(yaw_rate.max()) <= scenario.limits.rates_degps[2] * 1.001,
            "yaw is a state of Eq. 1 with a limited rate",
        ),
        _claim(
            (9,),
            "no turn is very tight",
            "least radius {radius:.0f} m between the ends; load factor at most {load:.3f} of {limit:g}",
            {
                "radius": track.radius_min_m,
                "load": float(track.load_factor.max()),
                "limit": scenario.limits.load_factor_max,
            },
            float(track.load_factor.max()) <= scenario.limits.load_factor_max * 1.001,
            "Eq. 18, written without the radius",
        ),
        _claim(
            (8, 9),
            "they keep a horizontal distance to whatever is as high as they fly",
            "{aside:.0f} m for the nearest of the six",
            {"aside": track.mountain_aside_m},
            track.mountain_aside_m > 0.0,
            "clearance over ground that rises gently is distance from where it is as high",
        ),
        _claim(
            (8, 9),
            "the leader leaves more room than it needs itself, for the followers",
            "its own clearance is at least {own:.2f} m, that of the lowest follower {others:.2f} m",
            {
                "own": float(track.clearance_m[plan.leader].min()),
                "others": float(np.delete(track.clearance_m, plan.leader, axis=0).min()),
            },
            bool(track.clearance_m[plan.leader].min() > np.delete(track.clearance_m, plan.leader, axis=0).min()),
            "Eqs. 23 and 24 put the followers' ground under it",
        ),
    ]


def _attitude(track: Track) -> list[Claim]:
    pitch, roll = track.pitch_deg[track.cruise], track.roll_deg[track.cruise]
    climb = -track.velocity_ned_mps[track.cruise, 2]
    ground = ground_height_m(track.plan.scenario.terrain, track.states[:, 0], track.states[:, 1])
    return [
        _claim(
            (10,),
            "pitch and roll change little in the whole flight",
            "between the ends pitch stays within {pitch:.1f}°, roll within {roll:.1f}°; at the ends {whole:.1f}°",
            {
                "pitch": float(np.ptp(pitch)),
                "roll": float(np.ptp(roll)),
                "whole": float(np.abs(track.states[:, 6:8]).max() * 180.0 / np.pi),
            },
            float(max(np.ptp(pitch), np.ptp(roll))) < 10.0,
            "accelerations are small where time is not short; stopping takes more",
        ),
        _claim(
            (10,),
            "climbing and sinking do not need pitch",
            "correlation of pitch with climb rate between the ends {r:.2f}; pitch {pitch:.1f}° where it climbs "
            "fastest, {mean:.1f}° on average",
            {
                "r": float(np.corrcoef(pitch, climb)[0, 1]),
                "pitch": float(pitch[int(np.argmax(climb))]),
                "mean": float(pitch.mean()),
            },
            abs(float(pitch[int(np.argmax(climb))] - pitch.mean())) < 2.0,
            "thrust alone does it in Eq. 1",
        ),
        _claim(
            (10,),
            "there is no need to roll for obstacles, the air above being free",
            "roll at most {roll:.2f}° between the ends, over {ground:.1f} m of ground at the highest",
            {"roll": float(np.abs(roll).max()), "ground": float(ground.max())},
            float(np.abs(roll).max()) < 3.0,
            "the way bends by a few metres in hundreds",
        ),
    ]


def _controls(track: Track) -> list[Claim]:
    limits = track.plan.scenario.limits
    torque = torque_limits(limits, track.plan.quadrotor.arm_m)
    u = track.controls
    span = np.array([limits.thrust_N[1] - limits.thrust_N[0], *(2.0 * t for t in torque)])
    every = max(1, round(_STEP / (track.t_s[1] - track.t_s[0])))
    jump = 100.0 * np.abs(u[every:] - u[:-every]).max(axis=0) / span
    share = 100.0 * np.abs(u[:, 1:]).max(axis=0) / np.array(torque)
    arms_m = np.array([track.plan.quadrotor.arm_m, track.plan.quadrotor.arm_m, 1.0])
    moment = 1e6 * arms_m * np.sqrt((u[track.cruise, 1:] ** 2).mean(axis=0))
    typical = 100.0 * np.sqrt((u[track.cruise, 1:] ** 2).mean(axis=0)) / np.array(torque)
    return [
        _claim(
            (10, 12, 13),
            "no control jumps",
            "within a tenth of a second U1..U4 move by at most {j1:.1f}, {j2:.1f}, {j3:.1f}, {j4:.1f} % of their range",
            {f"j{i + 1}": jump[i] for i in range(4)},
            float(jump.max()) < 20.0,
            "controls are lines between values inside the box of Eq. 19; the quickest are at start and stop",
        ),
        _claim(
            (12, 13),
            "U1 is larger than U2, U3, U4: it carries the weight",
            "on average {mean:.3f} N, the weight is {weight:.3f} N; the others at most {most:.4f}",
            {
                "mean": float(u[:, 0].mean()),
                "weight": track.plan.quadrotor.weight_N,
                "most": float(np.abs(u[:, 1:]).max()),
            },
            float(u[:, 0].min()) > float(np.abs(u[:, 1:]).max()),
            "Eq. 2: a sum of four against differences",
        ),
        _claim(
            (12,),
            "U1 changes to lead the way over obstacles",
            "between the ends it stays within {span:.3f} N of itself, {share:.1f} % of the weight",
            {
                "span": float(np.ptp(u[track.cruise, 0])),
                "share": float(100.0 * np.ptp(u[track.cruise, 0]) / track.plan.quadrotor.weight_N),
            },
            float(np.ptp(u[track.cruise, 0])) > 0.01,
            "little: the climb is gentle",
        ),
        _claim(
            (13,),
            "U2 stays small, and with it roll",
            "at most {share:.1f} % of its limit; {typical:.2f} % RMS between the ends",
            {"share": share[0], "typical": typical[0]},
            bool(typical[0] < 5.0),
            "the course hardly changes",
        ),
        _claim(
            (13,),
            "U3 is small as well, though it goes up and down",
            "{typical:.2f} % of its limit RMS between the ends; {share:.0f} % at most, at start or stop",
            {"share": share[1], "typical": typical[1]},
            bool(typical[1] < 5.0),
            "speeding up and stopping are by pitch, and use all that the plan may",
        ),
        _claim(
            (13,),
            "the change of U4 is bigger, because the heading has to change",
            "between the ends {m4:.2f} µN m RMS; l U2 {m2:.2f}, l U3 {m3:.2f} µN m. Of their limits: U4 {u4:.3f} %, "
            "U2 {u2:.3f} %, U3 {u3:.3f} %",
            {"u2": typical[0], "u3": typical[1], "u4": typical[2]} | {f"m{i + 2}": m for i, m in enumerate(moment)},
            bool(moment[2] > max(moment[0], moment[1])),
            "as a moment U4 is the largest; as a share of its limit it need not be",
            "moments are compared: U4 with l U2 and l U3",
        ),
    ]


def _velocities(track: Track) -> list[Claim]:
    v = track.velocity_ned_mps[track.cruise]
    rises = np.diff(track.height_m)
    wrong = float(
        (np.sign(rises[np.abs(rises) > 1e-3]) * np.sign(track.velocity_ned_mps[:-1, 2][np.abs(rises) > 1e-3])).max()
    )
    late = track.last(60.0)
    top = float(track.height_m[late].max())
    before = float(track.height_m[late][0])
    sinks = track.velocity_ned_mps[late, 2]
    slowly_s = float(track.t_s[late][int(np.argmax(sinks))] - track.t_s[late][sinks > sinks[0] + 0.02][0])
    return [
        _claim(
            (14,),
            "v_z counts downwards",
            "the sign of v_z times that of climbing is {sign:g} wherever it moves",
            {"sign": wrong},
            wrong < 0.0,
            "NED",
        ),
        _claim(
            (14,),
            "v_z varies to get over obstacles",
            "{spread:.3f} m/s RMS between the ends, {most:.2f} m/s at most",
            {"spread": rms(v[:, 2]), "most": float(np.abs(v[:, 2]).max())},
            float(np.abs(v[:, 2]).max()) > 0.1,
            "by the climb to h_r and the descent from it; the ground it crosses stays far below",
        ),
        _claim(
            (14,),
            "v_x and v_y change to use up time or to get round obstacles",
            "{x:.3f} and {y:.3f} m/s RMS between the ends",
            {"x": rms(v[:, 0]), "y": rms(v[:, 1])},
            bool(min(rms(v[:, 0]), rms(v[:, 1])) > 0.25),
            "does not follow from the paper's equations, see A9; no obstacle stands in the way",
        ),
        _claim(
            (14,),
            "at the end v_z rises slowly, and then it lands",
            "in the last minute v_z rises from {before:.2f} to {most:.2f} m/s in {time:.0f} s, and is {last:.1g} m/s "
            "at the arrival; the height rises by {rise:.2f} m",
            {"before": sinks[0], "most": sinks.max(), "last": abs(sinks[-1]), "time": slowly_s, "rise": top - before},
            bool(sinks.max() - sinks[0] > 0.5 and slowly_s > 5.0 and abs(sinks[-1]) < 1e-3),
            "the descent begins gently and ends at rest",
            "v_z is NED: where it rises, the vehicle sinks",
        ),
    ]


def _claim(
    figures: tuple[int, ...], says: str, measured: str, numbers: dict[str, float], holds: bool, why: str, read: str = ""
) -> Claim:
    return Claim("§4.1", figures, says, measured, numbers, holds, why, read)
