"""What the sections of the page share: plans, where pictures go, how much is measured.

Knows: missions, and that a plan is made once. Does not know: sections.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gcs
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import Report

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
CORES = 2  # processes at a time: their own seconds are what counts
Log = Callable[[str], None]


@dataclass
class Run:
    """One making of the page into `folder`; `short` draws and measures everything, but little of it."""

    folder: Path
    short: bool = False
    log: Log = print
    plans: dict[str, Plan] = field(default_factory=dict)
    reports: dict[str, Report] = field(default_factory=dict)

    @property
    def pictures(self) -> Path:
        """Folder of the figures, beside the page."""
        return self.folder / "paper"

    def plan(self, name: str) -> Plan:
        """The plan of missions/`name`, made when it is first asked for."""
        if name not in self.plans:
            self.log(f"plan {name}")
            self.plans[name] = gcs.make_plan(gcs.load_scenario(ROOT / "missions" / name))
        return self.plans[name]

    def report(self, name: str) -> Report:
        """The verifier's report on that plan."""
        if name not in self.reports:
            self.reports[name] = gcs.verify(self.plan(name))
        return self.reports[name]


def about() -> dict[str, Any]:
    """Version, machine and date of a run, and how busy the machine was when it began."""
    packages = ("skein-gcs", "casadi", "numpy", "scipy")
    return {
        "date": f"{datetime.now().astimezone():%Y-%m-%d %H:%M %Z}",
        "versions": {name: version(name) for name in packages},
        "python": platform.python_version(),
        "system": platform.system(),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 2),
    }


def about_line(about: dict[str, Any]) -> str:
    """The same for people."""
    versions = ", ".join(f"{name} {number}" for name, number in about["versions"].items())
    return (
        f"{about['date']}; {versions}; Python {about['python']}; {about['system']}, {about['processor']}, "
        f"{about['cores']} cores, load {about['load']:g} when it began"
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "unknown processor")
