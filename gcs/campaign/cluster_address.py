"""Where the workers of a campaign are, as the options say it: on this machine, or at a Dask scheduler.

A scheduler runs the code of whoever reaches it: one that is open to other machines is refused unless it is asked for.
"""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import urlsplit

from gcs.errors import UsageError

CERTIFICATES = ("ca.pem", "cert.pem", "key.pem")


@dataclass(frozen=True)
class Cluster:
    """What the options say about workers."""

    workers: int | None = None  # None: one for each core
    scheduler: str | None = None  # None: this machine
    certificates: Path | None = None  # folder with CERTIFICATES, for tls://
    open_scheduler: bool = False
    dashboard: bool = False


def refuse_without_dask() -> None:
    """Raise UsageError where Dask is not installed. It is looked for, not imported."""
    if find_spec("distributed") is None:
        raise UsageError("gcs campaign needs Dask, which is not installed", hint="pip install 'skein-gcs[campaign]'")


def refuse_open_scheduler(cluster: Cluster) -> None:
    """Raise UsageError for an address that is none, for options that do not fit it, and for an open scheduler."""
    address, folder = cluster.scheduler, cluster.certificates
    if address is None:
        if folder is not None or cluster.open_scheduler:
            raise UsageError("--tls and --open-scheduler are for a --scheduler", hint="leave them out, or name one")
        return
    if cluster.workers is not None:
        raise UsageError("--workers is for this machine; a scheduler has workers of its own", hint="leave one out")
    try:
        parts = urlsplit(address)
        known = parts.scheme in ("tcp", "tls") and parts.hostname and parts.port
    except ValueError:
        known = False
    if not known:
        raise UsageError(f"--scheduler {address}: not an address", hint="write for example tls://192.168.1.5:8786")
    if parts.scheme == "tls":
        if folder is None:
            raise UsageError(f"--scheduler {address} needs certificates", hint="give --tls FOLDER with them")
        if lacking := [name for name in CERTIFICATES if not (folder / name).is_file()]:
            raise UsageError(f"--tls {folder}: there is no {lacking[0]}", hint=f"it needs {', '.join(CERTIFICATES)}")
    elif not _is_loopback(parts.hostname or "") and not cluster.open_scheduler:
        raise UsageError(
            f"--scheduler {address}: whoever reaches this scheduler runs any code on its workers, and on this machine",
            hint="use tls:// (docs/campaigns.md), or add --open-scheduler where you trust everybody in the network",
        )


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
