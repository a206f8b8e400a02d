"""`gcs campaign` at work: its bar or lines of progress, and what it prints in the end."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from gcs.campaign.campaign_flight import ABORTED, FAILED, HELD, NO_PLAN, prepare
from gcs.campaign.campaign_options import CampaignOptions
from gcs.campaign.campaign_runner import locked, run_campaign
from gcs.campaign.cluster_address import Cluster
from gcs.campaign.records import INFRASTRUCTURE, CampaignFolder
from gcs.cli.flights.campaign_report import show_report
from gcs.cli.shared.console import Screen
from gcs.errors import counted
from gcs.flight.monitoring.progress import Watcher
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import Report

_LINE_EVERY_S = 10.0
_ORDER = (HELD, FAILED, ABORTED, NO_PLAN, INFRASTRUCTURE)


class _Says(Watcher):
    def __init__(self, screen: Screen) -> None:
        self._screen = screen

    def say(self, text: str) -> None:
        self._screen.say(text)


def fly_campaign(
    screen: Screen, asked: CampaignOptions, plan: Plan, report: Report, cluster: Cluster, to: Path, worst: int
) -> int:
    """Fly what is left of a campaign in its folder, and print its report. Raises as `run_campaign`."""
    folder = CampaignFolder(to)
    with locked(to):
        folder.begin(asked.record(plan), asked.design(plan))
        shared = prepare(plan, report, asked.keeping, asked.choices, _Says(screen))

        def on_workers(count: int, dashboard: str) -> None:
            workers = counted(count, "worker")
            screen.say(f"flying {asked.flights} flights in {to}, on {workers}; Ctrl-C keeps what has ended")
            if cluster.dashboard:
                screen.say(f"dashboard: {dashboard}")

        with _progress(screen, asked.flights) as on_progress:
            run_campaign(
                folder,
                shared,
                cluster,
                worst=worst,
                until=asked.width,
                on_progress=on_progress,
                on_workers=on_workers,
            )
    show_report(screen, to)
    return 0


def words(counts: Counter[str]) -> str:
    """Return the outcomes in words: "12 held, 1 failed"."""
    return ", ".join(f"{counts[name]} {name}" for name in _ORDER if counts[name]) or "none has ended"


@contextmanager
def _progress(screen: Screen, flights: int) -> Iterator[Callable[[Counter[str]], None]]:
    """What is called with the outcomes so far: it moves a bar on a terminal, else it prints a line now and then."""
    if not screen.is_watched:
        due_s = 0.0

        def line(counts: Counter[str]) -> None:
            nonlocal due_s
            if (now_s := time.monotonic()) >= due_s:
                due_s = now_s + _LINE_EVERY_S
                screen.say(f"{counts.total()} of {flights} flights: {words(counts)}")

        yield line
        return
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"))
    with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=screen.console) as bar:
        task = bar.add_task("starting workers", total=flights)
        yield lambda counts: bar.update(task, completed=counts.total(), description=words(counts))
