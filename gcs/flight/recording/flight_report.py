"""The report of a flight: the verdict, the conditions of the flight, and what every figure means.

`report.json` is for programs, `report.md` for people: with it the flight can be cited, and flown again.
"""

import json
import math
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

from gcs.flight.assessment.criterion import Criterion
from gcs.flight.assessment.judge import Verdict
from gcs.flight.recording.flight_folder import OUTCOMES, TRUE_STATES, limit_text
from gcs.flight.setup.simulator_process import Emulated
from gcs.physics.wind import GUSTS_MPS
from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.si import autopilots
from gcs.types import JsonObject
from gcs.util.atomic_write import atomic_write

_TRUE = "True positions are those of the emulated bodies; vehicles and Skein know estimates only."
_REPORTED = (
    "Positions are those that the vehicles reported. The true ones may be elsewhere: by 3 sigma of what receiver and "
    "estimator tell of their accuracy, by what a vehicle may move between two reports, and by the error of its clock. "
    "A criterion whose limit lies within that range is not known."
)
FORMATION_ERROR = (
    "Definition 1 of the paper: distance of a true position from its place in the formation, wherever the formation "
    "is; the largest of any vehicle from T0 to the planned arrival"
)
REPEAT = "gcs refly ."
SKEW = "difference of the delays of two vehicles behind the plan, from telemetry"


def emulation_data(scenario: Scenario, emulated: Emulated) -> JsonObject:
    """Return the conditions of an emulated flight as plain values, for `report.json`."""
    return {
        "skein": version("skein-gcs"),
        "autopilots": sorted({known.key for known in autopilots(scenario)}),
        "sensors": scenario.sensors.grade,
        "planned_wind": None if scenario.wind is None else scenario.wind.model_dump(),
        "gusts_mps": _deviation_mps(emulated.gusts),
        **asdict(emulated),
        "faults": list(emulated.faults),
    }


def write_report(folder: Path, data: JsonObject, verdict: Verdict) -> None:
    """Write `report.json` for programs and `report.md` for readers."""
    atomic_write(folder / "report.json", json.dumps(data, indent=2) + "\n")
    navigator = f" with the {data['navigator']} navigator" if data.get("navigator") else ""
    lines = [
        f"# Flight of {data['mission']}",
        "",
        f"{OUTCOMES[verdict.outcome]} Plan `{data['plan_hash'][:12]}`, mode {data['mode']}{navigator}.",
        "",
        *_conditions(data),
        f"## Criteria, from the {data['judged']}",
        "",
        "| criterion | measured | limit | verdict |",
        "| --- | --- | --- | --- |",
        *(
            f"| {c.name} | {c.value:.3f} {c.unit}{_where(c)} | {limit_text(c)} | {c.verdict} |"
            for c in verdict.criteria
        ),
        f"| formation error | {verdict.formation_error_m:.3f} m | – | – |",
    ]
    if (skew_s := data.get("skew_s")) is not None and len(verdict.rms_m) > 1:
        lines.append(f"| time skew (telemetry) | {1e3 * skew_s:.1f} ms | – | – |")
    if verdict.off_plan_s:
        lines += ["", f"{verdict.not_counted}."]
    lines += [
        "",
        "| vehicle | position error RMS, m | maximum, m |",
        "| --- | --- | --- |",
        *(f"| {sysid} | {rms:.3f} | {verdict.max_m[sysid]:.3f} |" for sysid, rms in verdict.rms_m.items()),
        "",
        "`gcs report` on this folder divides each of these errors: plan less estimate, which is the control's, and "
        "estimate less truth, which is the sensors'.",
        "",
    ]
    if rows := data.get("separation_reported"):
        lines += ["| least separation, from telemetry | m |", "| --- | --- |"]
        lines += [
            f"| {row['part']} (vehicles {row['vehicles'][0]}, {row['vehicles'][1]}) at t = {row['t_s']:.1f} s "
            f"| {row['distance_m']:.3f} |"
            for row in rows
        ]
        lines.append("")
    lines += _definitions(verdict, data["judged"])
    atomic_write(folder / "report.md", "\n".join(lines))


def _conditions(data: JsonObject) -> list[str]:
    found = data.get("emulation")
    if found is None:
        return []
    rows = [
        ("vehicles", f"{len(data['position_rms_m'])}, emulated, {', '.join(found['autopilots'])}"),
        ("sensors", found["sensors"]),
        ("wind", _wind_in_words(found)),
        ("gusts", _gusts_in_words(found)),
        ("faults", ", ".join(found["faults"]) or "none"),
        ("seed of noise and gusts", str(found["seed"])),
        ("Skein", found["skein"]),
    ]
    return [
        "## Conditions",
        "",
        "| condition | value |",
        "| --- | --- |",
        *(f"| {name} | {value} |" for name, value in rows),
        "",
        f"To fly it again in this folder, the same to the last bit: `{data['repeat']}`",
        "",
    ]


def _wind_in_words(found: JsonObject) -> str:
    planned = found["planned_wind"]
    expected = "none" if planned is None else f"{planned['speed_mps']:g} m/s from {planned['from_deg']:g} degrees"
    if found["wind"] is None:
        return "none" if planned is None else f"{expected} at {planned['height_m']:g} m height, as planned"
    speed, _, origin = found["wind"].partition("@")
    return f"{speed} m/s from {origin} degrees (the plan assumes: {expected})"


def _gusts_in_words(found: JsonObject) -> str:
    deviation_mps = found["gusts_mps"]
    if not deviation_mps:
        return "none"
    name = f"{found['gusts']}: " if found["gusts"] in GUSTS_MPS else ""
    return f"{name}Dryden, standard deviation {deviation_mps:g} m/s along and across the wind"


def _deviation_mps(gusts: str | None) -> float:
    if not gusts:
        return 0.0
    deviation = GUSTS_MPS[gusts] if gusts in GUSTS_MPS else float(gusts)
    return deviation if math.isfinite(deviation) else 0.0


def _definitions(verdict: Verdict, judged: str) -> list[str]:
    known = [(str(c.name), c.name.definition) for c in verdict.criteria]
    known += [("formation error", FORMATION_ERROR), ("time skew", SKEW)]
    return [
        "## Definitions",
        "",
        f"{_TRUE if judged == TRUE_STATES else _REPORTED} T0 is plan time 0; while vehicles were led back to the plan "
        "after a standstill, it waited. The measured figure is that of the worst vehicle or pair.",
        "",
        *(f"- **{name}**: {text}." for name, text in known),
        "",
    ]


def _where(criterion: Criterion) -> str:
    vehicle = f" ({criterion.vehicles})" if criterion.vehicles else ""
    return vehicle if criterion.t_s is None else f"{vehicle} at t = {criterion.t_s:.1f} s"
