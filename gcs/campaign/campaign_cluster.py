"""The workers of a campaign: processes on this machine's cores, or those of a Dask scheduler elsewhere.

Every worker gets the plan once, and must have the same code of Skein.
"""

from __future__ import annotations

import logging
import os
import signal
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from tempfile import TemporaryDirectory

import dask
from distributed import Client, LocalCluster, Security, Worker, WorkerPlugin, get_worker

from gcs.campaign.campaign_flight import CampaignPlan, FlightResult, KeepRule, code_digest, fly_row
from gcs.campaign.cluster_address import CERTIFICATES, Cluster
from gcs.campaign.records import INDEX, INFRASTRUCTURE, OUTCOME, Row
from gcs.errors import LinkError, UsageError

_CONNECT_S = 10.0
_CONFIG = {
    "distributed.scheduler.worker-saturation": 1.0,  # a worker holds one flight; the others wait at the scheduler
    "distributed.scheduler.allowed-failures": 1,
    "distributed.worker.daemon": True,  # nothing of a worker outlives the campaign
    # At the lowest priority beside other work, processes of this machine may say nothing for minutes.
    "distributed.scheduler.worker-ttl": "1h",
    "distributed.comm.timeouts.connect": "10m",
    "distributed.admin.tick.limit": "1h",  # a flight holds Python's lock longer than Dask finds usual
}
_KEY = "skein_campaign"
_PACKAGE = "skein-gcs"


@contextmanager
def connected(cluster: Cluster, shared: CampaignPlan, scratch: Path) -> Iterator[Client]:
    """Yield a client whose workers have the plan. Raises LinkError without them, UsageError for another version.

    `scratch` is where workers on this machine write. All processes that were started end with the block.
    """
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(_CONFIG))
        local: LocalCluster | None = None
        if cluster.scheduler is None:
            at = "127.0.0.1:0" if cluster.dashboard else None
            local = LocalCluster(
                n_workers=cluster.workers or os.cpu_count() or 1,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address=at,
                worker_dashboard_address=None,
                silence_logs=logging.CRITICAL,
                local_directory=str(scratch),
            )
            client = stack.enter_context(Client(stack.enter_context(local), set_as_default=False))
            stack.callback(_kill_workers, local)
        else:
            security = None
            if cluster.certificates is not None:
                ca, cert, key = (str(cluster.certificates / name) for name in CERTIFICATES)
                security = Security(tls_ca_file=ca, tls_client_cert=cert, tls_client_key=key, require_encryption=True)
            try:
                opened = Client(cluster.scheduler, timeout=_CONNECT_S, security=security, set_as_default=False)
            except (OSError, ValueError) as problem:
                raise LinkError(
                    f"no scheduler answers at {cluster.scheduler}: {problem}.",
                    hint="start one with `dask scheduler`, or leave --scheduler out for this machine",
                ) from problem
            client = stack.enter_context(opened)
            if not client.nthreads():
                raise LinkError(
                    f"the scheduler at {cluster.scheduler} has no workers.",
                    hint=f"start some with `dask worker {cluster.scheduler} --nthreads 1`",
                )
        # A function of the standard library: a worker without Skein could not read one of ours.
        versions = client.run(version, _PACKAGE, on_error="return")
        _refuse_workers({where: version_problem(found) for where, found in versions.items()})
        client.register_plugin(PlanForWorkers(shared, local=local is not None))
        _refuse_workers(client.run(worker_problem))
        yield client


def _refuse_workers(problems: Mapping[str, str]) -> None:
    if wrong := {where: text for where, text in problems.items() if text}:
        where, text = sorted(wrong.items())[0]
        others = f" ({len(wrong)} of {len(problems)} workers are of no use)" if len(problems) > 1 else ""
        raise UsageError(f"worker {where}: {text}{others}", hint="install the same version of Skein on every machine")


def version_problem(found: object) -> str:
    """Return what is wrong with what a worker answers when it is asked for Skein's version; empty if nothing is."""
    if isinstance(found, PackageNotFoundError):
        return "Skein is not installed there"
    if isinstance(found, BaseException):
        return f"it does not tell its version of Skein: {found}"
    own = version(_PACKAGE)
    return "" if found == own else f"it has Skein {found}, this machine has {own}"


def _kill_workers(local: LocalCluster) -> None:
    """End flights under way: Dask would wait for them. Their simulators end with the workers' pipes."""
    for nanny in local.workers.values():
        nanny.auto_restart = False
        with suppress(ProcessLookupError):
            if nanny.pid:
                os.kill(nanny.pid, signal.SIGKILL)


class PlanForWorkers(WorkerPlugin):  # type: ignore[misc]
    """Gives the plan to every worker, also to those that come later."""

    name = _KEY

    def __init__(self, shared: CampaignPlan, *, local: bool) -> None:
        self._shared, self._local = shared, local

    def setup(self, worker: Worker) -> None:
        """Keep the plan at the worker."""
        setattr(worker, _KEY, self._shared)
        if self._local and threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends Ctrl-C to all; the driver ends its workers


@cache
def _own_code() -> str:
    return code_digest()


def worker_problem(dask_worker: Worker) -> str:
    """Return why a worker cannot fly the campaign; empty if it can. Dask gives the argument by its name."""
    shared = getattr(dask_worker, _KEY, None)
    if shared is None:
        return "it has no plan"
    return "" if shared.code == _own_code() else "its Skein has the same version but other code"


def fly_at_worker(row: Row, rule: KeepRule) -> FlightResult:
    """Fly a row of the design at a worker that has the plan."""
    worker = get_worker()
    if problem := worker_problem(worker):
        return FlightResult({INDEX: row[INDEX], OUTCOME: INFRASTRUCTURE, "reason": problem})
    with TemporaryDirectory(dir=worker.local_directory) as scratch:
        return fly_row(getattr(worker, _KEY), row, rule, Path(scratch))
