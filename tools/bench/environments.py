"""One environment per peer, made once under .bench/: they need libraries that contradict each other and ours.

Knows: venv and pip. Does not know: what the peers do.
"""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

CACHE = Path(__file__).resolve().parents[2] / ".bench"
INSTALL_LIMIT_S = 900.0


@dataclass(frozen=True)
class Peer:
    """A package of the index, the module that drives it, and the Pythons it has wheels for (newest first)."""

    name: str
    package: str
    module: str
    arguments: tuple[str, ...] = ()
    pythons: tuple[str, ...] = ()  # none: the one that runs this


PEERS = (
    Peer("yapss-lg", "yapss", "peer_yapss", ("default",)),
    Peer("yapss-lg, monotone mu", "yapss", "peer_yapss", ("monotone",)),
    Peer("mpopt", "mpopt", "peer_mpopt", pythons=("3.10", "3.9", "3.8")),  # pins numpy 1.22
    Peer("maptor", "maptor", "peer_maptor"),
    Peer("rockit", "rockit-meco", "peer_rockit"),
    Peer("pycollo", "pycollo", "peer_pycollo"),
)


class Unavailable(Exception):
    """A peer that cannot take part, and why."""


def environment(peer: Peer) -> Path:
    """The peer's own Python, installed on first use; raises Unavailable."""
    home = CACHE / peer.package
    python = home / "bin" / "python"
    stamp = home / ".installed"  # written last: without it the installation did not finish
    if stamp.exists():
        return python
    print(f"installing {peer.package} into {home.relative_to(CACHE.parent)} (once)", file=sys.stderr)
    _run([*_interpreter(peer), "-m", "venv", "--clear", str(home)])
    # A numerical library built from source takes ten minutes and ends up without its neighbours' binary interface.
    _run([str(python), "-m", "pip", "-q", "install", "--only-binary", "numpy,scipy,casadi", peer.package])
    stamp.touch()
    return python


def _interpreter(peer: Peer) -> list[str]:
    if not peer.pythons:
        return [sys.executable]
    for wanted in peer.pythons:
        command = [f"python{wanted}"]
        try:
            _run([*command, "-c", "pass"])
        except Unavailable:
            continue
        return command
    raise Unavailable(f"needs Python {' or '.join(peer.pythons)}, which is not installed")


def _run(command: list[str]) -> None:
    # Where several Pythons are managed by pyenv, its stand-ins start the newest one of the family by this name.
    family = {"PYENV_VERSION": command[0].removeprefix("python")} if command[0].startswith("python3.") else {}
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=INSTALL_LIMIT_S,
            env=os.environ | family,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise Unavailable(str(error)) from error
    if done.returncode:
        lines = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
        raise Unavailable(next((line for line in lines if line.startswith("ERROR")), lines[-1]))
