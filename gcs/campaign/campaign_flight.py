"""One flight of a campaign, on whichever machine: its row of the design becomes a row of results, never an exception.

An outcome is `held` (all criteria), `failed` (one of them), `aborted` (the flight did not come to its end), `no plan`
(a varied scenario has none), or `infrastructure`: the machine failed, which says nothing about the plan.
"""

from __future__ import annotations

import hashlib
import io
import math
import os
import re
import time
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Timer

from gcs.campaign.design import plain
from gcs.campaign.records import INDEX, INFRASTRUCTURE, MARGIN, OUTCOME, TEXT, Row, margins, of_fault
from gcs.campaign.varied_plan import planned_anew, varied_keys
from gcs.errors import (
    FlightError,
    GcsError,
    OutOfTime,
    PeerError,
    PlanningError,
    ScenarioError,
    VerificationError,
)
from gcs.flight.assessment.criterion import Criterion
from gcs.flight.contingency.choices import TimeKeeping
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.monitoring.progress import Watcher
from gcs.flight.run import Exported, FlightRun, fly_run
from gcs.flight.setup.build_loads import export_for_flight
from gcs.flight.setup.simulator_process import Emulated
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import Report

HELD, FAILED, ABORTED, NO_PLAN = "held", "failed", "aborted", "no plan"
MACHINE = ("took_s", "attempts")  # columns that another run of the same campaign has otherwise
FLIGHT_LIMIT_S = 1800.0  # wall time: a flight takes half a minute, much more where many processes share a core
_NONE = ("none", "0", "0.0")


@dataclass(frozen=True)
class CampaignPlan:
    """What all flights of a campaign share, made once and sent to every worker."""

    plan: Plan
    report: Report
    keeping: TimeKeeping
    options: FlightOptions
    exported: Exported
    code: str  # digest of the code that flies: another one flies otherwise


@dataclass(frozen=True)
class FlightResult:
    """The row of results of one flight, and its folder as a ZIP archive if it is kept."""

    row: Row
    folder_zip: bytes | None = None


@dataclass(frozen=True)
class KeepRule:
    """Which flights are kept whole: those that did not hold, and those with a margin below the threshold."""

    below: Mapping[str, float] = field(default_factory=dict)  # by criterion; without a threshold all are

    def keeps(self, row: Row) -> bool:
        """Whether a flight with this row is kept whole."""
        if row[OUTCOME] != HELD:
            return bool(row[OUTCOME] != INFRASTRUCTURE)
        return any(one is not None and one <= self.below.get(name, math.inf) for name, one in margins(row).items())


def prepare(plan: Plan, report: Report, keeping: TimeKeeping, options: FlightOptions, say: Watcher) -> CampaignPlan:
    """Export the missions once, for all flights. Raises `NotWritten` where they cannot be flown."""
    with TemporaryDirectory() as folder:
        exported = export_for_flight(plan, report, Path(folder), keeping, say.say)
    return CampaignPlan(plan, report, keeping, options, exported, code_digest())


def code_digest() -> str:
    """Return the digest of Skein's version and of the code that flies, so that two machines can be compared."""
    package = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256(version("skein-gcs").encode())
    for file in sorted([*package.rglob("*.py"), *(package.parent / "sim_bridge").rglob("*.py")]):
        digest.update(str(file.relative_to(package.parent)).encode() + file.read_bytes())
    return digest.hexdigest()[:16]


def emulated(row: Row) -> Emulated:
    """Return the conditions of the flight of a row of the design, as `gcs fly` takes them."""
    wind = gusts = None
    if "wind_mps" in row:
        wind = f"{plain(row['wind_mps'])}@{plain(row['wind_from_deg'])}"
    if "gusts" in row and (text := plain(row["gusts"])) not in _NONE:
        gusts = text
    faults = [row[name] for name in sorted(row) if of_fault(name)[1] == TEXT and row[name]]
    if row.get("loss"):
        faults.append(f"all:loss={plain(row['loss'])}")
    return Emulated("max", int(row["seed"]), tuple(faults), wind, gusts)


def fly_row(
    shared: CampaignPlan,
    row: Row,
    rule: KeepRule,
    scratch: Path | None = None,
    limit_s: float = FLIGHT_LIMIT_S,
) -> FlightResult:
    """Fly one row of the design; whatever fails is an outcome, also a flight that takes longer than `limit_s`."""
    began_s = time.monotonic()
    result: Row = {INDEX: row[INDEX]}
    with TemporaryDirectory(dir=scratch, prefix="flight-") as name:
        root = Path(name)
        hung = Event()
        try:
            shared = _varied(shared, row)
            run = FlightRun(shared.plan, shared.report, shared.keeping, emulated=emulated(row), root=root)
            run = replace(run, options=shared.options, exported=shared.exported, pictures=False)
            with _ended_after(limit_s, root, hung):
                flown = fly_run(run, Watcher())
            verdict = flown.verdict
            if verdict is None:
                raise RuntimeError("the flight has no verdict")
            failed = [str(one.name) for one in verdict.criteria if not one.ok]
            result |= {OUTCOME: FAILED if failed else HELD, "reason": ", ".join(failed)}
            result |= figures(verdict.criteria)
            result["formation_error_m"] = verdict.formation_error_m
        except (FlightError, PeerError) as failure:
            # A simulator that ended by itself has written no true states: the vehicles did not abort this flight.
            whole = any(root.glob("*/truth.npz"))
            result |= {OUTCOME: ABORTED if whole else INFRASTRUCTURE, "reason": failure.message}
        except OutOfTime as failure:  # another machine may be quicker
            result |= {OUTCOME: INFRASTRUCTURE, "reason": failure.message}
        except (ScenarioError, PlanningError, VerificationError) as failure:
            result |= {OUTCOME: NO_PLAN, "reason": failure.message}
        except GcsError as failure:
            result |= {OUTCOME: INFRASTRUCTURE, "reason": failure.message}
        except Exception as failure:
            result |= {OUTCOME: INFRASTRUCTURE, "reason": f"{type(failure).__name__}: {failure}"}
        if hung.is_set() and result[OUTCOME] in (ABORTED, INFRASTRUCTURE):
            why = f"it did not end within {limit_s:g} s of wall time"
            result |= {OUTCOME: INFRASTRUCTURE, "reason": why}
        result["took_s"] = time.monotonic() - began_s
        found = next(root.iterdir(), None)
        kept = zipped(found) if found is not None and rule.keeps(result) else None
    return FlightResult(result, kept)


def _varied(shared: CampaignPlan, row: Row) -> CampaignPlan:
    """What flies where the row has values of the scenario. Raises as `planned_anew` and `prepare`."""
    values = varied_keys(row)
    if not values:
        return shared
    plan, report = planned_anew(shared.plan.scenario, values)
    return prepare(plan, report, shared.keeping, shared.options, Watcher())


@contextmanager
def _ended_after(limit_s: float, root: Path, hung: Event) -> Iterator[None]:
    """After `limit_s` of wall time kill the simulator that flies a folder of `root`, and set `hung`."""

    def end() -> None:
        import psutil  # noqa: PLC0415 (comes with the extra, as workers do)

        hung.set()
        for child in psutil.Process().children(recursive=True):
            with suppress(psutil.Error):
                if any(word.startswith(os.fspath(root)) for word in child.cmdline()):
                    child.kill()

    timer = Timer(limit_s, end)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def figures(criteria: tuple[Criterion, ...]) -> dict[str, float]:
    """Return the columns of a verdict: the worst measured value of each criterion, and its margin, negative if failed.

    Columns are named by criterion and unit: `separation_m`, `separation_m_margin`.
    """
    found: dict[str, float] = {}
    for one in criteria:
        name = f"{re.sub('[^a-z]+', '_', str(one.name).lower()).strip('_')}_{one.unit}"
        found[name] = one.value
        found[name + MARGIN] = one.value - one.limit if one.at_least else one.limit - one.value
    return found


def zipped(folder: Path) -> bytes:
    """Return the files of a folder as a ZIP archive."""
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for file in sorted(folder.rglob("*")):
            if file.is_file():
                archive.write(file, file.relative_to(folder))
    return held.getvalue()
