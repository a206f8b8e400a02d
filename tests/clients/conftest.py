"""Ground stations from the package registry, each in an environment of its own, made once and kept."""

from __future__ import annotations

import os
import subprocess
import sys
import venv
from pathlib import Path

import pytest

KEPT = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "skein-clients"
MAVPROXY = ("MAVProxy==1.8.75",)
MAVPROXY_NEEDS = ("pymavlink==2.4.50", "pyserial>=3.5", "defusedxml>=0.7", "pynmeagps>=1.0", "numpy>=2")


def pip(python: Path, *arguments: str) -> None:
    """Skip the test where the registry is out of reach; that is no fault of the vehicles."""
    done = subprocess.run(
        [python, "-m", "pip", "install", "--disable-pip-version-check", "--quiet", "--retries=1", *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    if done.returncode:
        last = done.stderr.strip().splitlines()[-1:]
        pytest.skip(f"MAVProxy cannot be installed from the registry: {''.join(last)}")


@pytest.fixture(scope="session")
def mavproxy() -> list[str]:
    """The command that starts MAVProxy. Its maps and windows are left out: they need a screen."""
    home = KEPT / f"mavproxy-{sys.version_info.major}.{sys.version_info.minor}"
    python, done = home / "bin" / "python", home / ".installed"
    if not done.exists():
        venv.create(home, with_pip=True, clear=True)
        pip(python, "--no-deps", *MAVPROXY)
        pip(python, *MAVPROXY_NEEDS)
        done.touch()
    return [str(python), str(home / "bin" / "mavproxy.py")]
