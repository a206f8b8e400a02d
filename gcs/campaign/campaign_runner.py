"""Flies what is left of a campaign: submits flights as workers have room, and writes their results as they come.

A process that is killed loses the results of the last seconds, and these flights are flown again.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING

from gcs.campaign.campaign_cluster import connected, fly_at_worker
from gcs.campaign.campaign_flight import CampaignPlan, FlightResult
from gcs.campaign.cluster_address import Cluster
from gcs.campaign.flight_window import FlightWindow
from gcs.campaign.kept_flights import KeptFlights
from gcs.campaign.records import INDEX, INFRASTRUCTURE, OUTCOME, CampaignFolder, Row
from gcs.errors import LinkError, UsageError

if TYPE_CHECKING:
    from distributed import Client, Future

SCRATCH = "scratch"
_FLUSH_S = 2.0  # results wait so long at most before they are written
_ROOM = 2  # flights with the scheduler for each worker: one flies, one waits
_LOOK_S = 0.2
_NO_WORKERS_S = 600.0  # at the lowest priority beside other work, a killed one takes minutes to start again

OnProgress = Callable[[Counter[str]], None]


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder of a campaign, which is made if it is not there, for this process. Raises UsageError."""
    folder.mkdir(parents=True, exist_ok=True)
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UsageError(
                f"another process flies the campaign in {folder}", hint="wait, or use another --to"
            ) from None
        yield
    finally:
        os.close(handle)


def run_campaign(
    folder: CampaignFolder,
    shared: CampaignPlan,
    cluster: Cluster,
    *,
    worst: int,
    until: float | None,
    on_progress: OnProgress,
    on_workers: Callable[[int, str], None],
) -> None:
    """Fly what is left, holding `locked`. Raises LinkError where no workers are left.

    `worst` flights are kept whole for each criterion. `on_progress` gets the number of flights by outcome,
    `on_workers` that of workers, when they are there, and the address of Dask's dashboard.
    """
    results = folder.results()
    done = [row for row in results if row[OUTCOME] != INFRASTRUCTURE]
    window = FlightWindow(folder.left(), done, until)
    scratch = folder.path / SCRATCH
    shutil.rmtree(scratch, ignore_errors=True)
    kept = KeptFlights(folder.path, done, worst)
    kept.tidy()
    counts = Counter(row[OUTCOME] for row in done)
    on_progress(counts)
    if window.is_over:
        return
    scratch.mkdir()
    try:
        with connected(cluster, shared, scratch) as client:
            on_workers(len(client.nthreads()), client.dashboard_link)
            _Driver(folder, client, window, kept, counts, on_progress).run()
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


class _Driver:
    def __init__(
        self,
        folder: CampaignFolder,
        client: Client,
        window: FlightWindow,
        kept: KeptFlights,
        counts: Counter[str],
        on_progress: OnProgress,
    ) -> None:
        self._folder, self._client, self._window, self._kept = folder, client, window, kept
        self._counts, self._on_progress = counts, on_progress
        self._ended: SimpleQueue[tuple[Row, Future]] = SimpleQueue()
        self._futures: dict[int, Future] = {}
        self._unwritten: list[Row] = []
        self._written_s = self._workers_s = time.monotonic()

    def run(self) -> None:
        """Fly until the window is over. What has ended is written however this ends."""
        try:
            while not self._window.is_over:
                self._submit()
                with suppress(Empty):
                    self._take(*self._ended.get(timeout=_LOOK_S))
                    while True:
                        self._take(*self._ended.get_nowait())
                if time.monotonic() - self._written_s >= _FLUSH_S:
                    self._write()
            with suppress(Exception):  # the scheduler may be gone
                self._client.cancel(list(self._futures.values()), force=True)
        finally:
            self._write()

    def _submit(self) -> None:
        workers = len(self._client.nthreads()) if self._client.status == "running" else 0
        now_s = time.monotonic()
        if workers:
            self._workers_s = now_s
        elif now_s - self._workers_s > _NO_WORKERS_S:
            raise LinkError(
                f"no workers for {_NO_WORKERS_S:g} s.", hint="start workers, then give the same command again to go on"
            )
        for row in self._window.next(_ROOM * workers):
            future = self._client.submit(fly_at_worker, row, self._kept.rule, pure=False)
            self._futures[row[INDEX]] = future
            future.add_done_callback(lambda ended, row=row: self._ended.put((row, ended)))

    def _take(self, row: Row, future: Future) -> None:
        del self._futures[row[INDEX]]
        try:
            result: FlightResult = future.result()
        except Exception as failure:  # KilledWorker, or results that were lost on the way
            why = f"{type(failure).__name__}: {str(failure).splitlines()[0] if str(failure) else ''}"
            result = FlightResult({INDEX: row[INDEX], OUTCOME: INFRASTRUCTURE, "reason": why, "took_s": 0.0})
        finally:
            future.release()
        attempts = self._window.ended(result.row)
        if attempts is None:
            return
        self._kept.add(result.row, result.folder_zip)
        self._unwritten.append(result.row | {"attempts": attempts})
        self._counts[result.row[OUTCOME]] += 1
        self._on_progress(self._counts)

    def _write(self) -> None:
        self._written_s = time.monotonic()
        rows, self._unwritten = self._unwritten, []
        if rows:
            self._folder.add(rows)
            self._kept.tidy()
