"""Records of benchmarks as tables, ratios first.

Knows: what each benchmark's record looks like. Does not know: how it is run, or what it measures.
"""

from __future__ import annotations

import math
import statistics
from typing import Any

Table = list[list[str]]


def planner(found: Any) -> Table:
    """Goals, then every solver's times over the first peer's."""
    rows = [["ratio", "measured", "asked", ""]]
    for goal in found["goals"]:
        sign = "at least" if goal["at_least"] else "at most"
        rows.append(
            [goal["name"], f"{goal['value']:.3g}", f"{sign} {goal['bound']:g}", "met" if goal["met"] else "missed"]
        )
    return rows


def planner_times(found: Any) -> Table:
    """Every solver on every mesh, with its version."""
    rows = [["mesh", "solver", "over yapss", "cold", "verified between its nodes", "version"]]
    for record in found["records"]:
        first = next(
            (r for r in found["records"] if r["contender"].startswith("yapss") and r["mesh"] == record["mesh"]), None
        )
        if not record["runs"]:
            rows.append([record["mesh"], record["contender"], "", record["failure"], "", ""])
            continue
        own = [f"{name} {number}" for name, number in record["versions"].items() if name not in ("casadi", "numpy")]
        cold = _middle(record)
        ratio = f"{cold / _middle(first):.2f}" if first is not None and first["runs"] else ""
        verified = (record["findings"] or {}).get("verified")
        rows.append(
            [
                record["mesh"],
                record["contender"],
                ratio,
                f"{cold:.3f} s",
                {True: "yes", False: "no", None: ""}[verified],
                ", ".join(own),
            ]
        )
    return rows


def scale(found: Any) -> Table:
    """Over the smallest formation."""
    rows = [["vehicles", "time ×", "memory ×", "verifier ×", "planning", "memory", "verified"]]
    least = found["medians"][0]
    for row in found["medians"]:
        ratios = [f"{row[key] / least[key]:.2f}" for key in ("plan_s", "memory_mb", "verify_s")]
        absolute = [f"{row['plan_s']:.2f} s", f"{row['memory_mb']:.0f} MB", "yes" if row["verified"] else "**no**"]
        rows.append([f"{row['vehicles']:.0f}", *ratios, *absolute])
    return rows


def export(found: Any) -> Table:
    """Each format for the largest fleet over the smallest."""
    least, most = found["medians"][0], found["medians"][-1]
    rows = [
        [
            "format",
            f"{most['vehicles']} vehicles over {least['vehicles']}",
            f"{least['vehicles']}",
            f"{most['vehicles']}",
        ]
    ]
    for name, cell in most["formats"].items():
        small = least["formats"][name]["seconds"]
        rows.append([name, f"{cell['seconds'] / small:.1f}", f"{small:.2f} s", f"{cell['seconds']:.2f} s"])
    return rows


def readers(found: Any) -> Table:
    """Reading missions, over the fastest reader."""
    most = found["medians"][-1]
    fastest = min(most["readers"].values())
    rows = [["reader", "over the fastest", f"all {most['vehicles']} missions"]]
    return rows + [[name, f"{s / fastest:.1f}", f"{s:.3f} s"] for name, s in most["readers"].items()]


def bridge(found: Any) -> Table:
    """Emulated vehicles on one core."""
    rows = [["vehicles", "times real time", "steps/s", "messages/s"]]
    return rows + [
        [f"{r['vehicles']}", f"{r['times_real_time']:.2f}", f"{r['steps_per_s']:.0f}", f"{r['messages_per_s']:.0f}"]
        for r in found
    ]


def stream(found: Any) -> Table:
    """Punctuality of setpoints, in parts of a period."""
    rows = [
        ["case", "interval p99, of a period", "interval p50 / p99 / max", "late p50 / p99 / max", "CPU of one core"]
    ]
    for r in found:
        spread = [
            " / ".join(f"{r[f'{what}_{word}_ms']:.2f}" for word in ("p50", "p99", "max")) + " ms"
            if f"{what}_p50_ms" in r
            else "no deadlines"
            for what in ("interval", "late")
        ]
        rows.append([r["case"], f"{r['interval_p99_ms'] * r['rate_hz'] / 1e3:.3f}", *spread, f"{100 * r['cpu']:.0f} %"])
    return rows


def upload(found: Any) -> Table:
    """Deliveries on a fake clock."""
    rows = [
        ["autopilot", "sent as", "round trip", "loss", "over the floor", "sent", "read back equal", "errors", "wrong"]
    ]
    for r in found["cells"]:
        over = "" if r["of_floor"] is None else f"{r['of_floor']:.2f}"
        absolute = (f"{r['sent_s']:.2f} s", f"{r['held_s']:.2f} s", f"{r['errors']}", f"{r['wrong']}")
        rows.append(
            [
                r["autopilot"],
                r["transfer"],
                f"{1e3 * r['round_trip_s']:.0f} ms",
                f"{100 * r['loss']:.0f} %",
                over,
                *absolute,
            ]
        )
    return rows


def race(found: Any) -> Table:
    """Fleets over sockets, ours and MAVSDK: over the protocol's floor, over one vehicle alone, over MAVSDK."""
    head = [
        "autopilot",
        "round trip",
        "loss",
        "client",
        "vehicles",
        "over the floor",
        "over one vehicle",
        "over MAVSDK",
    ]
    rows = [[*head, "sent", "failed", "wrong"]]
    for r in found["race"]:
        ratios = ("" if r[key] is None else f"{r[key]:.2f}" for key in ("of_floor", "of_one", "of_mavsdk"))
        echo = "" if r["echo_s"] is None else f", {1e3 * r['echo_s']:.0f} measured"
        link = (f"{1e3 * r['round_trip_s']:.0f} ms{echo}", f"{100 * r['loss']:.0f} %")
        counts = (f"{r['sent_s']:.1f} s", f"{r['failures']:g}", f"{r['wrong']:g}")
        rows.append([r["autopilot"], *link, r["client"], f"{r['vehicles']}", *ratios, *counts])
    return rows


def replan(found: Any) -> Table:
    """Re-plans over the first plan's time, by mission and by whether a new zone stands in the way."""
    heads = (
        "mission",
        "re-plans",
        "median, of the first plan",
        "p95",
        "verified",
        "no way left",
        "median",
        "built later",
    )
    rows = [list(heads)]
    for name, record in found.items():
        first_s = statistics.median(record["cold_s"])
        for words, zones in (("no new zone", (False,)), ("a new zone", (True,)), ("all", (False, True))):
            chosen = [o for o in record["replans"] if o["zone"] in zones]
            seconds = sorted(o["seconds"] for o in chosen if o["kind"] == "verified")
            if not seconds:
                continue
            middle_s, most_s = statistics.median(seconds), seconds[min(len(seconds) - 1, int(0.95 * len(seconds)))]
            without = sum(o["kind"] == "infeasible" for o in chosen)
            ratios = (f"{middle_s / first_s:.2f}", f"{most_s / first_s:.2f}")
            counts = (f"{len(seconds)} of {len(chosen)}", f"{without}", f"{middle_s:.2f} s", f"{record['built']}")
            rows.append([name, words, *ratios, *counts])
    return rows


def first_share(found: Any) -> float:
    """Median time of a mission's verified re-plans over that of its first plan."""
    seconds = [o["seconds"] for o in found["replans"] if o["kind"] == "verified"]
    return float(statistics.median(seconds) / statistics.median(found["cold_s"]))


def maps(found: Any) -> Table:
    """How many random maps get a plan."""
    possible = [o for o in found if o["kind"] != "no way"]
    verified = [o for o in possible if o["kind"] == "verified"]
    straight = sum(o["straight"] for o in possible)
    seconds = [o["seconds"] for o in verified] or [0.0]
    return [
        ["maps with a way", "verified plans", "by a straight-line guess", "median", "worst"],
        [
            f"{len(possible)} of {len(found)}",
            f"{100 * len(verified) / len(possible):.0f} %",
            f"{100 * straight / len(possible):.0f} %",
            f"{statistics.median(seconds):.1f} s",
            f"{max(seconds):.1f} s",
        ],
    ]


def _middle(record: dict[str, Any]) -> float:
    return float(statistics.median(run["cold_s"] for run in record["runs"]))


def route(found: Any) -> Table:
    """What drawn routes cost, over the flight from A to B."""
    alone_s = next(row["plan_s"] for row in found if not row["points"])
    return [
        ["points", "over A to B", "CPU time", "solves", "iterations", "memory", "verified"],
        *(
            [
                str(row["points"] or "A to B"),
                f"{row['plan_s'] / alone_s:.2f}",
                f"{row['plan_s']:.1f} s",
                str(row["solves"]),
                str(row["iterations"]),
                f"{row['memory_MB']:.0f} MB",
                "yes" if row["verified"] else "no",
            ]
            for row in found
        ),
    ]


def legs(found: Any) -> Table:
    """CPU times of contenders that were given a route of five points, over that of the fastest peer."""
    times = {
        record["contender"]: {
            key: statistics.median(run[key] for run in record["runs"] if key in run)
            for key in ("cold_cpu_s", "verified_cpu_s")
            if any(key in run for run in record["runs"])
        }
        for record in found["records"]
        if record["runs"]
    }
    peers = [first["cold_cpu_s"] for name, first in times.items() if not name.startswith("skein")]
    least_s = min(peers, default=math.nan)
    rows = []
    for name, one in times.items():
        cells = [(one.get(key), one.get(key, math.nan) / least_s) for key in ("cold_cpu_s", "verified_cpu_s")]
        rows.append([name, *(f"{ratio:.2f} ({seconds:.2f} s)" if seconds else "" for seconds, ratio in cells)])
    return [["contender", "first solution, over the fastest peer's", "plan verified, over the same"], *rows]
